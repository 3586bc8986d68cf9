"""Make a plan from input files to output files, for ``deatwin plan`` and the live view."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from deatwin.studies.voice import Progress

if TYPE_CHECKING:
    from deatwin.ident.mismatch import ExperimentPlan
    from deatwin.studies.folder import ResultFolder


def plan_into(
    folder: ResultFolder, command: Sequence[str], asked: Mapping[str, Any], progress: Progress
) -> ExperimentPlan:
    """Plan with the arguments of ``deatwin plan``, and write the results into the folder."""
    from deatwin.app.given import GivenPlant
    from deatwin.app.plan_report import write_plan
    from deatwin.ident.mismatch import plan_experiment
    from deatwin.plant.readoptions import ReadOptions
    from deatwin.studies.provenance import RunRecord, hashes

    rig, commands, seed, jobs = asked["rig"], asked["commands"], asked["seed"], asked["jobs"]
    plant = GivenPlant.load(rig, ReadOptions.of(asked))
    record = None if commands is None else plant.commands(commands)
    files = [Path(name) for name in (rig, commands) if name is not None and Path(name).is_file()]
    run = RunRecord(command=command, inputs=hashes(files), seed=seed, jobs=jobs)
    found = plan_experiment(
        plant.model.plant, record, seconds=asked["seconds"], jobs=jobs, seed=seed, progress=progress
    )
    write_plan(found, folder, run)
    return found
