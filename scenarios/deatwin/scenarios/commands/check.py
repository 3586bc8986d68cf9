"""``deatwin check``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from deatwin.scenarios.options import Jobs, Json, OutFolder, Quiet, Seed
from deatwin.scenarios.voice import Voice

__all__ = ["check"]

ModelFile = Annotated[Path, typer.Argument(metavar="NARX.json", help="An identified model.")]
PlantSource = Annotated[
    str,
    typer.Option("--plant", metavar="RIG", help="Rig file, model.json or module:function: the plant to control."),
]
OperatingInput = Annotated[
    float | None,
    typer.Option(metavar="VALUE", help="Constant input; by default the centre of the training data."),
]


def check(
    context: typer.Context,
    model: ModelFile,
    plant: PlantSource,
    out: OutFolder,
    operating_input: OperatingInput = None,
    jobs: Jobs = -1,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Design a controller on an identified model, close the loop on the physics plant, and give a verdict.

    Example: deatwin check narx.json --plant result/model.json --out control
    """
    import numpy as np

    from deatwin.control import check as check_design
    from deatwin.ident.narx import NarxModel
    from deatwin.plant.sources import load_plant
    from deatwin.scenarios.folder import ResultFolder
    from deatwin.scenarios.provenance import RunRecord, hashes
    from deatwin.scenarios.report.svg import draw, standalone

    voice = Voice(as_json=as_json, quiet=quiet)
    narx, physics = NarxModel.load(model).deterministic, load_plant(plant)
    folder = ResultFolder(out)
    record = RunRecord(command=context.obj, inputs=hashes([model, plant]), seed=seed, jobs=jobs)
    with voice.progress("closing the loop") as progress:
        result = check_design(
            narx, physics.plant, operating_input=operating_input,
            command_limits=physics.plant.rig.command_range, rng=np.random.default_rng(seed),
            progress=lambda share: progress(share, "closing the loop"),
        )  # fmt: skip
    folder.save("check.json", result.save)
    with draw((6.4, 3.6)) as figure:
        result.plot(figure.add_subplot())
        folder.text("check.svg", standalone(figure))
    folder.text("run.json", json.dumps(record.finished([*folder.written, "run.json"]), indent=1) + "\n")
    voice.say(result.sentence)
    voice.say(folder.summary)
    voice.result(json.loads((folder.path / "check.json").read_text(encoding="utf-8")))
