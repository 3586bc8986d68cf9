"""Faults of recordings as data: which, where, how many samples."""

from __future__ import annotations

from typing import Any

from deatwin.ident.mismatch.gate.gate import Gate
from deatwin.plant.recording import label


def faults_of(checked: Gate) -> tuple[dict[str, Any], ...]:
    """The field ``faults`` of ``diagnosis.json``.

    Parameters
    ----------
    checked : Gate
        Recordings with the samples at fault.

    Returns
    -------
    tuple of dict
        One for each kind of fault in a recording: ``experiment`` and ``recording`` count from 1, ``file`` is its
        name or its times, ``fault`` says what it is, ``samples`` how many, ``from_s`` and ``to_s`` where on the clock.
    """
    found: list[dict[str, Any]] = []
    kinds = (("the reading is stuck", checked.stuck), ("the reading has outliers", checked.outliers))
    for number, experiment in enumerate(checked.experiments):
        for place, record in enumerate(experiment.recordings):
            for fault, masks in kinds:
                bad = record.timepts[masks[number][place]]
                if bad.size:
                    found.append(
                        {
                            "experiment": number + 1,
                            "recording": place + 1,
                            "file": label(record),
                            "fault": fault,
                            "samples": int(bad.size),
                            "from_s": float(bad[0]),
                            "to_s": float(bad[-1]),
                        }
                    )
    return tuple(found)
