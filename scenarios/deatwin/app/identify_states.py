"""``deatwin identify --method nss``: a nonlinear state space, and its free run on held-out data."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from deatwin.plant.recording import Recording
    from deatwin.studies.voice import Voice


def identify_states(
    out: Path,
    training: Sequence[Recording],
    unseen: Sequence[Recording],
    *,
    states: int,
    degree: int,
    functions: Sequence[str],
    notes: Sequence[str],
    voice: Voice,
) -> bool:
    """Fit, save and judge; return whether the search was completed."""
    import numpy as np

    from deatwin.ident.nss import Pnlss
    from deatwin.plant.recording import label

    identifier = Pnlss(states=states, degrees=tuple(range(2, degree + 1)), terms=tuple(functions))
    with voice.progress("fitting a nonlinear state space") as progress:
        identifier.fit(training, progress=progress)
    model = identifier.model_
    model.save(out)
    unit = f" {model.output_units[0]}" if model.output_units[0] not in ("", "1") else ""
    lines = [*notes, str(model)]
    errors = []
    for record in unseen:
        run = model.simulate(record)
        finished = run.status.ok
        errors.append({"free_run": run.rms_error, "finished": finished, "unit": model.output_units[0]})
        ended = "" if finished else " (diverged)"
        lines.append(f"{label(record)}, held-out part: free run {run.rms_error:.4g}{unit}{ended} rms")
    linear, own = (float(np.sqrt(np.mean(error**2))) for error in (identifier.linear_error_, identifier.error_))
    lines.append(f"on what was fitted: free run {own:.4g}{unit} rms, that of a linear state space {linear:.4g}{unit}")
    if not identifier.status_.ok:
        lines.append(identifier.status_.value)
    for line in (*lines, f"model: {out}"):
        voice.say(line)
    voice.result({"out": str(out), "complete": identifier.status_.ok, "unseen": errors, "clocks": list(notes)})
    return identifier.status_.ok
