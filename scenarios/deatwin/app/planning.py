"""Make a plan from input files to output files, for ``deatwin plan`` and the live view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from deatwin.ident.mismatch import ExperimentPlan
    from deatwin.plant import Plant
    from deatwin.studies.folder import ResultFolder
    from deatwin.studies.voice import Progress


def plan_into(
    folder: ResultFolder, command: Sequence[str], asked: Mapping[str, Any], progress: Progress
) -> ExperimentPlan:
    """Plan with the arguments of ``deatwin plan``, and write the results into the folder."""
    from deatwin.app.given import GivenPlant
    from deatwin.app.plan_report import write_plan
    from deatwin.ident.mismatch import plan_experiment
    from deatwin.plant.errors import SimulationError
    from deatwin.plant.readoptions import ReadOptions
    from deatwin.studies.provenance import RunRecord, hashes

    rig, commands, seed, jobs = asked["rig"], asked["commands"], asked["seed"], asked["jobs"]
    plant = GivenPlant.load(rig, ReadOptions.of(asked))
    record = None if commands is None else plant.commands(commands)
    files = [Path(name) for name in (rig, commands) if name is not None and Path(name).is_file()]
    run = RunRecord(command=command, inputs=hashes(files), seed=seed, jobs=jobs)
    try:
        found = plan_experiment(
            plant.model.plant, record, seconds=asked["seconds"], jobs=jobs, seed=seed, progress=progress
        )
    except SimulationError as error:
        raise SimulationError(f"{error}{'' if record else _borne(plant.model.plant)}") from None
    write_plan(found, folder, run)
    return found


def _borne(plant: Plant) -> str:
    """Return the end of an error text that says up to which command the film bears the voltage."""
    import numpy as np

    from deatwin.plant import actuation_curve

    rig = plant.rig
    if rig.command_range is None or rig.start.rest_command >= rig.command_range[1]:
        return ""
    curve = actuation_curve(plant, np.linspace(rig.start.rest_command, rig.command_range[1], 100))
    ends = {"breaks down": curve.breakdown_command, "goes slack": curve.slack_command}
    ends["pulls in"] = None if curve.end.ok else float(curve.commands[-1])
    command, verb = min(((at, verb) for verb, at in ends.items() if at is not None), default=(None, ""))
    if command is None:
        return ""
    return (
        f"; the film {verb} at {command:.3g} {rig.input_unit}, and the range ends at {rig.command_range[1]:g}: lower it"
    )
