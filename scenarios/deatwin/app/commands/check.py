"""``deatwin check``."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from deatwin.app import options
from deatwin.app.working import results
from deatwin.studies.voice import Voice


class DesignName(StrEnum):
    """Names of `deatwin.control.design.named`, repeated here so that help is fast."""

    PI = "pi"
    PID = "pid"
    INVERSE = "inverse"
    LQG = "lqg"
    HINF = "hinf"
    SHAPED = "shaped"
    SCHEDULED = "scheduled"


ModelFile = Annotated[Path, typer.Argument(metavar="NARX.json", help="An identified model.")]
PlantSource = Annotated[
    str, typer.Option("--plant", metavar="RIG", help="Rig file, model.json or module:function: the plant to control.")
]
DesignOption = Annotated[
    DesignName,
    typer.Option(
        help="pi, pid: lambda tuning; inverse: pi with the inverse of the static curve; lqg; hinf: mixed "
        "sensitivity; shaped: pi by loop shaping; scheduled: pi for several operating points."
    ),
]
ClosedLoopTime = Annotated[
    float | None,
    typer.Option(
        callback=options.positive("give a positive number of seconds"),
        metavar="SECONDS",
        help="Desired time constant of the closed loop; by default as fast as model and recording allow.",
    ),
]
OperatingInput = Annotated[
    float | None,
    typer.Option(
        metavar="VALUE",
        help="Constant input; by default the middle of the operating range, or the mean input of the training data.",
    ),
]
OperatingRange = Annotated[
    tuple[float, float] | None,
    typer.Option(
        metavar="LOW HIGH",
        help="Range of constant inputs in which margins are computed, at nine points and at the controller's own input.",
    ),
]
RecordingFile = Annotated[
    Path | None,
    typer.Option(
        "--recording",
        metavar="REC.csv",
        help="Recording of the actuator, preferably one to which the model was not fitted. It shows the excited band and "
        "the model's free-run error; by default the model file states both.",
    ),
]
DiagnosisFolder = Annotated[
    Path | None,
    typer.Option(
        "--diagnosis",
        metavar="DIR",
        help="Result folder of deatwin diagnose. The controller is also tested on the plant in this folder, and on every "
        "alternative that the diagnosis could not rule out.",
    ),
]
Rivals = Annotated[
    list[str] | None,
    typer.Option("--rival", metavar="RIG", help="Another plant model that may describe the actuator; repeatable."),
]


def check(
    context: typer.Context,
    model: ModelFile,
    plant: PlantSource,
    out: options.OutFolder,
    design: DesignOption = DesignName.PI,
    closed_loop_time: ClosedLoopTime = None,
    operating_input: OperatingInput = None,
    operating_range: OperatingRange = None,
    recording: RecordingFile = None,
    diagnosis: DiagnosisFolder = None,
    rival: Rivals = None,
    input_column: options.InputColumn = None,
    output_column: options.OutputColumn = None,
    time_column: options.TimeColumn = None,
    allow_gaps: options.AllowGaps = False,
    dt: options.SampleTime = None,
    resample: options.Resample = None,
    jobs: options.Jobs = -1,
    seed: options.Seed = 0,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Design a controller on an identified model, simulate the loop with a plant model, and give a verdict.

    Writes check.json, report.html, the figures' data and run.json into DIR. A controller that fails is an answer, not
    an error: the exit status is 0.

    Example: deatwin check narx.json --plant result/model.json --out control

    With a recording and a diagnosis: deatwin check narx.json --plant result/model.json --diagnosis result --recording noise.csv
    --design inverse --operating-range 1.5 3.2 --out control
    """
    from deatwin.app.check_report.page import written_gains
    from deatwin.app.checking import CheckTask, rival_files
    from deatwin.app.given import GivenPlant, clock_notes, narx_model
    from deatwin.plant.readoptions import ReadOptions
    from deatwin.plant.sources import load_plant

    voice = Voice(as_json=as_json, quiet=quiet)
    narx = narx_model(model).deterministic
    given = GivenPlant.load(plant, ReadOptions.of(context.params))
    rivals = rival_files(plant, diagnosis, rival or [])
    pieces = () if recording is None else given.experiment([recording]).recordings
    record = max(pieces, key=lambda piece: piece.n_samples, default=None)
    for note in clock_notes([] if record is None else [record]):
        voice.say(note)
    task = CheckTask(
        model=narx,
        plant=given.model,
        design=design,
        closed_loop_time=closed_loop_time,
        operating_input=operating_input,
        operating_range=operating_range,
        recording=record,
        rivals={name: load_plant(source) for name, source in rivals.items()},
        files=[model, plant, *([] if recording is None else [recording]), *rivals.values()],
        command=context.obj,
        jobs=jobs,
        seed=seed,
    )
    with results(out, voice, "closing the loop") as (folder, progress):
        found = task.run(folder, progress)
    voice.say(found.sentence)
    if gains := written_gains(found):
        voice.say(", ".join(f"{name} {value}" for name, value in gains))
    voice.say(f"report: {folder.path / 'report.html'}")
    voice.result(json.loads((folder.path / "check.json").read_text(encoding="utf-8")))
