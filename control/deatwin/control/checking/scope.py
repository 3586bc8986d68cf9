"""Judge if the loop stays within the band and range of the data from which its model was identified."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.control.checking.specification import Verdict
from deatwin.control.checking.verdict import Finding, Runs
from deatwin.control.linear.model import LinearModel
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.excited import Excitation
from deatwin.plant.amplitudes import written_amplitude


def judge_band(crossovers_Hz: Sequence[float], excited: Excitation) -> Finding:
    """Judge whether the recording knew the frequencies that the controller works at. `crossovers_Hz` of the model's
    loops, Hz.
    """
    crossover, band = max(crossovers_Hz), excited.highest_Hz
    if crossover > band:
        text = (
            f"the highest crossover, {crossover:.2f} Hz, lies outside the band that the recording excited, up to "
            f"{band:.2f} Hz: the margins there are extrapolated; a recording excited up to {2 * crossover:.2g} Hz "
            "would settle it"
        )
        return Finding(subject="excitation", value=crossover, verdict=Verdict.MARGINAL, text=text)
    for inside in sorted(crossovers_Hz, reverse=True):
        if (hole := excited.hole_at(inside)) is not None:
            low, high = hole
            text = (
                f"a crossover, {inside:.2g} Hz, lies in a hole of what the recording excited, {low:.2g} to "
                f"{high:.2g} Hz: nothing backs the margins there; a recording with power there, such as noise up to "
                f"{max(2 * inside, band):.2g} Hz, would settle it"
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
    """Find that a plant cannot follow the references since it rests elsewhere than the model; None where it can.
    Shapes: `rests` (3,).
    """
    centre = linear.operating_output
    if centre is None or not np.isfinite(rests).all():
        return None
    if rests.min() <= centre - amplitude and centre + amplitude <= rests.max():
        return None
    unit, size = written_amplitude(linear.output_unit)
    text = (
        f"at the input {linear.operating_input:.3g} the model rests at {centre / size:.3g} {unit} and the plant at "
        f"{rests[1] / size:.3g} {unit}, {abs(centre - rests[1]) / size:.3g} {unit} apart: no controller takes the plant "
        f"to the model's steps, for within the command's limits it rests from {rests.min() / size:.3g} to "
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
        f"{'beyond' if outside else 'inside'} the training data, which go from {low:.3g} to {high:.3g}"
    )
    verdict = Verdict.MARGINAL if outside else Verdict.PASS
    return Finding(subject="training data", value=None, verdict=verdict, text=text)


def judge_unknown_band() -> Finding:
    """The finding where nobody knows what the recording excited."""
    text = (
        "it is not known up to which frequency the recording excited the actuator: give the recording, or a model of "
        "`deatwin identify`, which notes it"
    )
    return Finding(subject="excitation", value=None, verdict=Verdict.MARGINAL, text=text)
