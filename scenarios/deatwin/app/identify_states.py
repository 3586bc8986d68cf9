"""``deatwin identify --method nss``: a nonlinear state space, and its free run on held-out data."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from deatwin.app.identify_report import Data, Identified, Tested, interruptible
from deatwin.ident.narx import FitStatus
from deatwin.ident.narx.unstable import recorded_pole, unstable_pole_lacked
from deatwin.ident.nss import Pnlss
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import label
from deatwin.studies.voice import Voice

_USELESS = (
    "no better than the mean of the readings; take fewer states or a lower degree, record longer, or try --method frols, "
    "which also suits unstable and integrating actuators"
)


def identify_states(data: Data, identifier: Pnlss, out: Path, voice: Voice) -> tuple[Identified, dict[str, Any]]:
    """Fit, save and judge a model; return it for the report, and as plain data."""
    with voice.progress("fitting a nonlinear state space") as progress, interruptible():
        identifier.fit(data.training, progress=progress)
    model = identifier.model_
    model.save(out)
    unit, states = model.output_units[0], model.n_states
    lines = [*data.notes, str(model)]
    errors, found = [], []
    for record in data.unseen:
        run = model.simulate(record)
        finished = run.status.ok
        errors.append({"free_run": run.rms_error, "finished": finished, "unit": unit})
        if not finished or run.rms_error > record.outputs[:, run.first :].std():
            found.append(
                f"{label(record)}, held-out part: the free run {'' if finished else 'diverges, and '}is {_USELESS}"
            )
        free = f"error of the free run {with_unit(run.rms_error, unit)} rms" if finished else "the free run diverges"
        lines.append(f"{label(record)}, held-out part: {free}")
    linear, own = (float(np.sqrt(np.mean(error**2))) for error in (identifier.linear_error_, identifier.error_))
    lines.append(
        f"on the fitted part: error of the free run {with_unit(own, unit)} rms; error of a linear state space "
        f"{with_unit(linear, unit)} rms"
    )
    is_stable = np.all(np.abs(model.poles) <= 1.0)
    if is_stable and (lacked := unstable_pole_lacked(recorded_pole(data.training), data.training)):
        found.append(lacked)
    complete = identifier.status_ is not FitStatus.INTERRUPTED
    if complete and identifier.status_ is not FitStatus.DONE:
        found.append(identifier.status_.value)
    lines += [f"note: {note}" for note in found]
    if not complete:
        lines.append(identifier.status_.value)
    for line in lines:
        voice.say(line)
    judged = Identified(
        model=model,
        told=f"A nonlinear state space of order {states} with {model.theta.size} parameters",
        data=data,
        tested=Tested(
            why_not="the model was fitted to its free run, so the error of the free run already shows what the model lacks"
        ),
        complete=complete,
        notes=found,
        input_lags=range(states + 1),
        output_lags=states,
        linear_as="of the same order",
    )
    return judged, {"complete": complete, "notes": found, "unseen": errors}
