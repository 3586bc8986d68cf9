"""Judge if the film stays in tension under the commands, on all plants drawn from the calibration."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deatwin.control.checking.specification import Verdict
from deatwin.control.checking.verdict import Finding
from deatwin.control.controllers.base import Controller
from deatwin.plant.model import Plant
from deatwin.plant.rest_path import rest_under

_HOLD = 2.0  # s at the largest command


def judge_film(source: str, plants: Sequence[Plant], commands: NDArray[np.float64], controller: Controller) -> Finding:
    """Judge whether the film bears what the controller commands, and what it might command. Shapes: `commands` (n,)."""
    from deatwin.ident.mismatch.advise.waveforms import HEADROOM, bears  # which takes half a second

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
    text = f"none {who} pulls in, breaks down or loses tension, at the controller's limits either"
    return Finding(subject=subject, value=0.0, verdict=Verdict.PASS, text=text)


def _rests(plant: Plant, commands: NDArray[np.float64], headroom: float) -> bool:
    """True if a plant has a state of rest at the largest and the smallest command."""
    rest = plant.rig.start.rest_command
    ends = rest + headroom * (np.array([commands.min(), commands.max()]) - rest)
    return all(rest_under(plant, float(end)) is not None for end in ends)
