"""``deatwin identify --method nss``: a nonlinear state space, and its free run on held-out data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from deatwin.studies.voice import Voice, complain

if TYPE_CHECKING:
    from deatwin.app.identify_report import Identified
    from deatwin.ident.look import BestLinearApproximation
    from deatwin.ident.nss import Pnlss
    from deatwin.plant.recording import Recording

_USELESS = (
    "no better than the mean of the readings; take fewer states or a lower degree, record longer, or try --method frols, "
    "which also suits unstable and integrating actuators"
)


def identify_states(
    out: Path,
    identifier: Pnlss,
    training: Sequence[Recording],
    unseen: Sequence[Recording],
    periodic: BestLinearApproximation | None,
    notes: Sequence[str],
    voice: Voice,
    report_of: Callable[[Identified], None],
) -> bool:
    """Fit, save, judge and report; return whether the search was completed."""
    import numpy as np
    import typer

    from deatwin.app.identify_report import Identified, Tested, linear_errors
    from deatwin.ident.narx import FitStatus
    from deatwin.ident.narx.unstable import recorded_pole, unstable_pole_lacked
    from deatwin.plant.prefixes import with_unit
    from deatwin.plant.recording import label

    with voice.progress("fitting a nonlinear state space") as progress:
        try:
            identifier.fit(training, progress=progress)
        except KeyboardInterrupt:
            complain("interrupted before a model was found; nothing was written")
            raise typer.Exit(130) from None
    model = identifier.model_
    model.save(out)
    unit = model.output_units[0]
    lines = [*notes, str(model)]
    errors, found = [], []
    for record in unseen:
        run = model.simulate(record)
        finished = run.status.ok
        errors.append({"free_run": run.rms_error, "finished": finished, "unit": model.output_units[0]})
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
    if np.all(np.abs(model.poles) <= 1.0) and (lacked := unstable_pole_lacked(recorded_pole(training), training)):
        found.append(lacked)
    complete = identifier.status_ is not FitStatus.INTERRUPTED
    if complete and identifier.status_ is not FitStatus.DONE:
        found.append(identifier.status_.value)
    lines += [f"note: {note}" for note in found]
    if not complete:
        lines.append(identifier.status_.value)
    for line in (*lines, f"model: {out}"):
        voice.say(line)
    states = model.n_states
    report_of(
        Identified(
            model=model,
            told=f"A nonlinear state space of order {states} with {model.theta.size} parameters",
            unseen=unseen,
            tested=Tested(
                why_not="the model was fitted to its free run, so the error of the free run already shows what the model lacks"
            ),
            complete=complete,
            notes=found,
            clocks=notes,
            linear=linear_errors(range(states + 1), states, training, unseen),
            linear_as="of the same order",
            best_linear=periodic,
        )
    )
    document = {"out": str(out), "complete": complete, "notes": found, "unseen": errors}
    voice.result({**document, "clocks": list(notes)})
    return complete
