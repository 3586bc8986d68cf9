"""``deatwin frequency``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deatwin.app.options import Json, OutFolder, Quiet, positive
from deatwin.studies.voice import Voice

FORMER = r"figures/((frequency|gfrf[2-8])(_\w+)?|nofrf[1-8]?|test_signal)\.(csv|svg)"
"""Files that a run may write or not, depending on its model and order."""


ModelFile = Annotated[Path, typer.Argument(metavar="NARX.json", help="An identified model.")]
Order = Annotated[int, typer.Option(min=1, max=8, help="Highest order of the responses.")]
OperatingInput = Annotated[
    list[float] | None,
    typer.Option(
        metavar="VALUE",
        help="Constant input of the operating point, once for each input in the order of the model; by default the mean input "
        "of the training data.",
    ),
]
Band = Annotated[
    tuple[float, float] | None,
    typer.Option(
        metavar="LOW HIGH",
        help="Frequencies of the input, Hz; by default from 0 to the highest that the training input excited, and for H1 up "
        "to half the sampling rate.",
    ),
]
Level = Annotated[
    float, typer.Option(help="Probability of the confidence bands in the CSV files; the figures show 95 % bands.")
]
Amplitude = Annotated[
    float | None,
    typer.Option(
        metavar="VALUE",
        callback=positive("give a positive number"),
        help="Largest deviation of the NOFRFs' test signal from the operating input, with --order 2 or more; by default at "
        "most as large as the training data allow.",
    ),
]


def frequency(
    context: typer.Context,
    model: ModelFile,
    out: OutFolder,
    order: Order = 1,
    operating_input: OperatingInput = None,
    band: Band = None,
    level: Level = 0.95,
    amplitude: Amplitude = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Compute frequency responses (FRF, GFRFs, NOFRFs) of an identified model at an operating point, with confidence bands.

    With several inputs, each has its own responses, and every choice of inputs has a cross kernel; NOFRFs are left out.

    Writes report.html, figures and their data (figures/*.svg and *.csv) and run.json into DIR.

    Example: deatwin frequency narx.json --order 3 --out response
    """
    if amplitude is not None and order == 1:
        raise typer.BadParameter(
            "this is the amplitude of the test signal of the NOFRFs, but --order 1 computes no NOFRFs: give --order 2 or more",
            param_hint="--amplitude",
        )
    from deatwin.app.frequency_report import write_responses
    from deatwin.app.frequency_responses import respond
    from deatwin.app.given import narx_model
    from deatwin.studies.folder import ResultFolder
    from deatwin.studies.provenance import RunRecord, hashes

    voice = Voice(as_json=as_json, quiet=quiet)
    narx = narx_model(model).deterministic
    record = RunRecord(command=context.obj or [], inputs=hashes([model]), seed=0, jobs=1)
    with ResultFolder(out) as folder, voice.progress("computing frequency responses"):
        point = operating_input[0] if operating_input and len(operating_input) == 1 else operating_input or None
        found = respond(narx, order, operating_input=point, band_Hz=band, level=level, amplitude=amplitude)
        write_responses(found, folder, record)
    folder.remove_former(FORMER)
    record.save(folder)
    for line in found.lines:
        voice.say(line)
    voice.say(folder.summary)
    voice.result({"out": str(out), **found.to_json()})
