"""Faults of recordings as data: kind, place, number of samples."""

from __future__ import annotations

from deatwin.ident.mismatch.quality.quality import DataQuality
from deatwin.ident.mismatch.result import Fault
from deatwin.plant.recording import label
from deatwin.plant.words import spaced

OF_READING = ("the reading is stuck", "the reading has outliers")
"""Faults of the first reading, which decide the verdict."""


def faults_of(checked: DataQuality) -> tuple[Fault, ...]:
    """Return one entry for each kind of fault in a recording."""
    found: list[Fault] = []
    kinds = list(zip(OF_READING, (checked.stuck, checked.outliers), strict=True))
    kinds += [(f"the {spaced(name)} is stuck", masks) for name, masks in checked.stuck_further.items()]
    for number, experiment in enumerate(checked.experiments):
        for place, record in enumerate(experiment.recordings):
            for fault, masks in kinds:
                bad = record.timepts[masks[number][place]]
                if bad.size:
                    found.append(
                        Fault(
                            experiment=number + 1,
                            recording=place + 1,
                            file=label(record),
                            fault=fault,
                            samples=int(bad.size),
                            from_s=float(bad[0]),
                            to_s=float(bad[-1]),
                        )
                    )
    return tuple(found)
