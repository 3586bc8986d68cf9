"""``deatwin frequency``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deatwin.scenarios.options import Json, OutFolder, Quiet
from deatwin.scenarios.voice import Voice

__all__ = ["frequency"]

POINTS = 200
DECADES = 3

ModelFile = Annotated[Path, typer.Argument(metavar="NARX.json", help="An identified model.")]
OperatingInput = Annotated[
    float | None,
    typer.Option(metavar="VALUE", help="Constant input; by default the centre of the training data."),
]


def frequency(
    model: ModelFile,
    out: OutFolder,
    order: Annotated[int, typer.Option(min=1, help="Order of the response.")] = 1,
    operating_input: OperatingInput = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Frequency response of an identified model at an operating point, with its 95 % band.

    Example: deatwin frequency narx.json --order 1 --out response
    """
    import numpy as np

    from deatwin.ident.frequency.gfrf import gfrf
    from deatwin.ident.narx import NarxModel
    from deatwin.scenarios.folder import ResultFolder
    from deatwin.scenarios.report.svg import draw, standalone

    voice = Voice(as_json=as_json, quiet=quiet)
    narx = NarxModel.load(model).deterministic
    highest = np.pi / narx.sample_time
    response = gfrf(narx, order, np.geomspace(highest / 10**DECADES, highest, POINTS), operating_input=operating_input)
    folder = ResultFolder(out)
    band = response.band()
    table = {
        "frequency_Hz": response.frequency_Hz,
        "real": response.values.real, "imaginary": response.values.imag,
        "gain": response.gain, "gain_low": band.low, "gain_high": band.high, "phase_deg": response.phase_deg,
    }  # fmt: skip
    folder.csv("frequency.csv", table)
    with draw((6.4, 3.6)) as figure:
        response.plot(figure.add_subplot())
        folder.text("frequency.svg", standalone(figure))
    point = float(response.point.operating_input[0])
    voice.say(f"operating input {point:.4g} {narx.input_units[0]}: {response.status.value}")
    voice.say(folder.summary)
    voice.result({
        "out": str(out), "operating_input": point, "stable": response.status.ok,
        **{name: column.tolist() for name, column in table.items()},
    })  # fmt: skip
