"""Judge whether the loop stays where its model is valid: in band and range of the data, with the film in tension."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.control.checking.specification import Verdict
from deatwin.control.checking.verdict import Finding, Runs
from deatwin.control.controllers.base import Controller
from deatwin.control.linear.model import LinearModel
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.excited import Excitation
from deatwin.plant.amplitudes import written_amplitude
from deatwin.plant.model import Plant
from deatwin.plant.rest_path import rest_under

_HOLD = 2.0  # Time at the largest command, and at the smallest one, s


def judge_band(crossovers_Hz: Sequence[float], excited: Excitation) -> Finding:
    """Judge whether the recording excited the crossover frequencies of the model's loops, Hz."""
    crossover, band = max(crossovers_Hz), excited.highest_Hz
    if crossover > band:
        text = (
            f"the highest crossover, {crossover:.2f} Hz, lies outside the band that the recording excited, up to "
            f"{band:.2f} Hz: the margins there are extrapolated; a recording excited up to {2 * crossover:.2g} Hz "
            "would decide"
        )
        return Finding(subject="excitation", value=crossover, verdict=Verdict.MARGINAL, text=text)
    for inside in sorted(crossovers_Hz, reverse=True):
        if (hole := excited.hole_at(inside)) is not None:
            low, high = hole
            text = (
                f"a crossover, {inside:.2g} Hz, lies in a gap of the excited band, {low:.2g} to {high:.2g} Hz, where "
                f"nothing supports the margins; a recording with power there, such as noise up to "
                f"{max(2 * inside, band):.2g} Hz, would decide"
            )
            return Finding(subject="excitation", value=inside, verdict=Verdict.MARGINAL, text=text)
    text = (
        f"the highest crossover, {crossover:.2f} Hz, lies inside the band that the recording excited, up to "
        f"{band:.2f} Hz"
    )
    return Finding(subject="excitation", value=crossover, verdict=Verdict.PASS, text=text)


def judge_rests(
    linear: LinearModel, amplitude: float, rests: NDArray[np.float64], runs: Runs, verdict: Verdict
) -> Finding | None:
    """Return a finding if the plant's positions at rest, `rests` (3,), do not allow it to follow the references."""
    centre = linear.operating_output
    if centre is None or not np.isfinite(rests).all():
        return None
    if rests.min() <= centre - amplitude and centre + amplitude <= rests.max():
        return None
    unit, size = written_amplitude(linear.output_unit)
    text = (
        f"at the input {linear.operating_input:.3g} the model rests at {centre / size:.3g} {unit} and the plant at "
        f"{rests[1] / size:.3g} {unit}, {abs(centre - rests[1]) / size:.3g} {unit} apart: no controller can move the "
        f"plant to the model's steps, because within the limits of the command it rests from {rests.min() / size:.3g} to "
        f"{rests.max() / size:.3g} {unit}"
    )
    return Finding(subject=runs.subject("operating point"), value=float(rests[1] - centre), verdict=verdict, text=text)


def judge_training(model: NarxModel, points: Sequence[float], commands: NDArray[np.float64]) -> Finding | None:
    """Judge whether the loop stays where the model was trained. Shapes: `commands` (n,)."""
    if model.operating is None:
        return None
    low, high = float(model.operating.input_min[0]), float(model.operating.input_max[0])
    least, most = min(*points, *commands), max(*points, *commands)
    outside = least < low or most > high
    text = (
        f"the loop works from {least:.3g} to {most:.3g}, "
        f"{'beyond' if outside else 'inside'} the training data, which range from {low:.3g} to {high:.3g}"
    )
    verdict = Verdict.MARGINAL if outside else Verdict.PASS
    return Finding(subject="training data", value=None, verdict=verdict, text=text)


def judge_unknown_band() -> Finding:
    """Return the finding for a recording whose excited band is unknown."""
    text = (
        "the frequencies that the recording excited are unknown: give the recording, or a model from `deatwin "
        "identify`, which states them"
    )
    return Finding(subject="excitation", value=None, verdict=Verdict.MARGINAL, text=text)


def judge_film(source: str, plants: Sequence[Plant], commands: NDArray[np.float64], controller: Controller) -> Finding:
    """Judge whether the film tolerates the commands of the controller, given and possible. Shapes: `commands` (n,)."""
    # A run may jump across a pull-in within a sample, so the plant must also have a state of rest at the largest and at
    # the smallest command.
    from deatwin.ident.mismatch.advise.waveforms import HEADROOM, bears  # importing it takes half a second

    rig = plants[0].rig
    rest = rig.start.rest_command
    used = sum(not (_rests(plant, commands, HEADROOM) and bears(plant, commands, rest)) for plant in plants)
    many = "plants inside the calibration's intervals" if len(plants) > 1 else "plant"
    who = f"of {len(plants)} {many}" + ("" if source == "plant" else f" of {source}")
    subject = "film" if source == "plant" else f"film ({source})"
    if used:
        text = f"{used} {who} would pull in, break down or lose tension with {100 * (HEADROOM - 1):.0f} % more voltage"
        return Finding(subject=subject, value=float(used), verdict=Verdict.FAIL, text=text)
    count = max(round(_HOLD / rig.sample_time), 2)
    ends = np.repeat([controller.command_max, controller.command_min], count)
    lost = sum(not (_rests(plant, ends, 1.0) and bears(plant, ends, rest, headroom=1.0)) for plant in plants)
    if lost:
        text = f"{lost} {who} would pull in, break down or lose tension at the controller's own limits"
        return Finding(subject=subject, value=float(lost), verdict=Verdict.MARGINAL, text=text)
    text = f"none {who} pulls in, breaks down or loses tension, even at the controller's limits"
    return Finding(subject=subject, value=0.0, verdict=Verdict.PASS, text=text)


def _rests(plant: Plant, commands: NDArray[np.float64], headroom: float) -> bool:
    """Return whether a plant has a state of rest at the largest and at the smallest command."""
    rest = plant.rig.start.rest_command
    ends = rest + headroom * (np.array([commands.min(), commands.max()]) - rest)
    return all(rest_under(plant, float(end)) is not None for end in ends)
