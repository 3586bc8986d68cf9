"""Judge whether the loop stays where its model is valid: in band and range of the data, with the film in tension."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.control.checking.amounts import three_digits
from deatwin.control.checking.specification import Verdict
from deatwin.control.checking.verdict import Finding, Runs
from deatwin.control.controllers.base import Controller
from deatwin.control.linear.model import LinearModel
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.excited import Excitation
from deatwin.plant.amplitudes import amount, written_amplitude
from deatwin.plant.model import Plant
from deatwin.plant.rest_path import rest_under

_HOLD = 2.0  # Time at the largest command, and at the smallest one, s


def judge_band(crossovers_Hz: Sequence[float], excited: Excitation) -> Finding:
    """Judge whether the recording excited the crossover frequencies of the model's loops, Hz."""
    crossover, band = max(crossovers_Hz), excited.highest_Hz
    if crossover > band:
        text = (
            f"the highest crossover frequency is {crossover:.2f} Hz, but the recording excited the actuator only up to "
            f"{band:.2f} Hz, so the margins are extrapolated; record with an input up to {2 * crossover:.2g} Hz"
        )
        return Finding(subject="excitation", value=crossover, verdict=Verdict.MARGINAL, text=text)
    for inside in sorted(crossovers_Hz, reverse=True):
        if (hole := excited.hole_at(inside)) is not None:
            low, high = hole
            text = (
                f"a crossover frequency is {inside:.2g} Hz, but the input of the recording has no power from {low:.2g} to "
                f"{high:.2g} Hz, so the margins are extrapolated; record with an input that has power there, such as noise "
                f"up to {max(2 * inside, band):.2g} Hz"
            )
            return Finding(subject="excitation", value=inside, verdict=Verdict.MARGINAL, text=text)
    text = (
        f"the recording excited the actuator up to {band:.2f} Hz, and the highest crossover frequency is only "
        f"{crossover:.2f} Hz"
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
        f"at a constant input of {amount(three_digits(linear.operating_input), linear.input_unit)} the model's output is "
        f"{centre / size:.3g} {unit} and the plant's is {rests[1] / size:.3g} {unit}, a difference of "
        f"{abs(centre - rests[1]) / size:.3g} {unit}; within the limits of the command, the plant reaches only "
        f"{rests.min() / size:.3g} to {rests.max() / size:.3g} {unit}, so it cannot follow the steps planned with the model"
    )
    return Finding(subject=runs.subject("operating point"), value=float(rests[1] - centre), verdict=verdict, text=text)


def judge_training(model: NarxModel, points: Sequence[float], commands: NDArray[np.float64]) -> Finding | None:
    """Judge whether the loop stays where the model was trained. Shapes: `commands` (n,)."""
    if model.operating is None:
        return None
    low, high = float(model.operating.input_min[0]), float(model.operating.input_max[0])
    least, most = min(*points, *commands), max(*points, *commands)
    outside, unit = least < low or most > high, model.input_units[0]
    text = (
        f"the closed loop uses commands from {amount(f'{three_digits(least)} to {three_digits(most)}', unit)}, "
        f"{'beyond' if outside else 'inside'} the range of the training data, {amount(f'{three_digits(low)} to {three_digits(high)}', unit)}"
    )
    verdict = Verdict.MARGINAL if outside else Verdict.PASS
    return Finding(subject="training data", value=None, verdict=verdict, text=text)


def judge_unknown_band() -> Finding:
    """Return the finding for a recording whose excited band is unknown."""
    text = (
        "it is unknown up to which frequency the recording excited the actuator; give the recording (--recording), or a "
        "model from `deatwin identify`, which states this frequency"
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
    own = "the plant model" if source == "plant" else source
    many = len(plants) > 1
    who = f"of {len(plants)} simulated actuators (parameters within the calibration's intervals)" if many else ""
    who += f" of {source}" if many and source != "plant" else ""
    subject = "film" if source == "plant" else f"film ({source})"

    def film(of: int) -> str:
        return f"in {of} {who}, the film" if many else f"the film in {own}"

    if used:
        text = f"{film(used)} would pull in, break down or lose tension with {100 * (HEADROOM - 1):.0f} % more voltage"
        return Finding(subject=subject, value=float(used), verdict=Verdict.FAIL, text=text)
    count = max(round(_HOLD / rig.sample_time), 2)
    ends = np.repeat([controller.command_max, controller.command_min], count)
    lost = sum(not (_rests(plant, ends, 1.0) and bears(plant, ends, rest, headroom=1.0)) for plant in plants)
    if lost:
        text = f"{film(lost)} would pull in, break down or lose tension if the command reached the controller's limits"
        return Finding(subject=subject, value=float(lost), verdict=Verdict.MARGINAL, text=text)
    none = f"in none {who} does the film" if many else f"the film in {own} does not"
    text = f"{none} pull in, break down or lose tension, even if the command reaches the controller's limits"
    return Finding(subject=subject, value=0.0, verdict=Verdict.PASS, text=text)


def _rests(plant: Plant, commands: NDArray[np.float64], headroom: float) -> bool:
    """Return whether a plant has a state of rest at the largest and at the smallest command."""
    rest = plant.rig.start.rest_command
    ends = rest + headroom * (np.array([commands.min(), commands.max()]) - rest)
    return all(rest_under(plant, float(end)) is not None for end in ends)
