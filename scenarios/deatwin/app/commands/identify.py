"""``deatwin identify``."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from deatwin.app import options
from deatwin.studies.voice import Voice


class Method(StrEnum):
    """Method that chooses the terms."""

    SVB = "svb"
    FROLS = "frols"
    LASSO = "lasso"
    SEMP = "semp"
    GROW = "grow"
    NSS = "nss"


Recordings = Annotated[list[Path], typer.Argument(metavar="REC...", help="Recordings with the same sample time.")]
ModelFile = Annotated[Path, typer.Option("--out", metavar="NARX.json", help="The model.")]
MethodOption = Annotated[
    Method,
    typer.Option(
        help="svb: sparse variational Bayes; frols: forward regression; lasso; semp: least free-run error (slower); "
        "grow: starts from a linear model, for noisy readings; nss: nonlinear state space, fitted to the free run."
    ),
]
InputLag = Annotated[
    int | None, typer.Option(min=0, help="Last lag of the input, in samples; by default 2, or the dead time plus 2.")
]
OutputLags = Annotated[
    int | None,
    typer.Option(
        min=1, help="Last lag of the output, in samples; by default 2, or 1 if 2 lags lead to a spurious unstable pole."
    ),
]
FirstInputLag = Annotated[
    int | None,
    typer.Option(
        min=0,
        help="First lag of the input, in samples: 0 if each reading is taken at the end of its sample interval, else 1; by "
        "default 0, or the dead time.",
    ),
]


def _decimation(value: str | None) -> str | None:
    if value not in (None, "auto") and not (value.isascii() and value.isdigit() and int(value) > 0):
        raise typer.BadParameter(f"{value} is neither auto nor a whole number of at least 1")
    return value


Decimation = Annotated[
    str | None,
    typer.Option(
        "--decimate",
        metavar="auto|N",
        callback=_decimation,
        help="Keep every N-th sample after a low-pass filter; auto chooses N by the output's autocorrelation.",
    ),
]
Functions = Annotated[
    list[str] | None,
    typer.Option(
        "--function",
        metavar="TEXT",
        help="A function of a lagged signal that terms may contain, such as '|u(k-1)|', 'sat(u(k-1),0.5)' or "
        "'sign(y(k-1)-y(k-2))'; with nss a further term, such as '|x1|' or 'sat(u,0.5)'; repeatable.",
    ),
]
States = Annotated[int, typer.Option(min=1, help="Number of states (only for nss).")]
MaxTerms = Annotated[int, typer.Option(min=1, help="Largest number of terms (not for svb).")]


ReportFolder = Annotated[
    Path | None, typer.Option("--report", metavar="DIR", help="Also write a report with figures into this folder.")
]


def identify(
    context: typer.Context,
    recordings: Recordings,
    out: ModelFile,
    method: MethodOption = Method.SVB,
    output_lags: OutputLags = None,
    input_lags: InputLag = None,
    first_input_lag: FirstInputLag = None,
    degree: Annotated[int, typer.Option(min=1, help="Largest degree of a term.")] = 2,
    max_terms: MaxTerms = 15,
    states: States = 2,
    functions: Functions = None,
    input_column: options.InputColumn = None,
    output_column: options.OutputColumn = None,
    time_column: options.TimeColumn = None,
    allow_gaps: options.AllowGaps = False,
    dt: options.SampleTime = None,
    resample: options.Resample = None,
    decimation: Decimation = None,
    report: ReportFolder = None,
    as_json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Identify a polynomial NARX model, or a nonlinear state space, and test it on the last 30 % of each recording.

    Example: deatwin identify noise.csv --method svb --out narx.json

    With a report: deatwin identify noise.csv --out narx.json --report identified
    """
    from contextlib import nullcontext

    from deatwin.app.given import clock_notes
    from deatwin.app.identify_lags import FIRST, LAST
    from deatwin.app.identify_narx import Search, identify_narx
    from deatwin.app.identify_periodic import approximated
    from deatwin.app.identify_report import Data, write_identified
    from deatwin.app.identify_states import identify_states
    from deatwin.app.thinning import thinned
    from deatwin.ident.narx.reliance import HELD_OUT, hold_out
    from deatwin.ident.nss import Pnlss
    from deatwin.plant.checks import require_excitation
    from deatwin.plant.files import read_recordings
    from deatwin.plant.rigs.base import ReadingTime
    from deatwin.studies.folder import ResultFolder, require_place
    from deatwin.studies.provenance import RunRecord, hashes

    first, last = FIRST if first_input_lag is None else first_input_lag, LAST if input_lags is None else input_lags
    if last < first:
        raise typer.BadParameter(f"the last lag, {last}, lies before the first, {first}", param_hint="--input-lags")
    _refuse_idle(context, method)
    reading = ReadingTime.START_OF_HOLD if first else ReadingTime.END_OF_HOLD
    voice = Voice(as_json=as_json, quiet=quiet)
    require_place(out, recordings)
    with nullcontext() if report is None else ResultFolder(report) as folder:
        record = RunRecord(command=context.obj or [], inputs=hashes(recordings), seed=0, jobs=1)
        columns = {"input_column": input_column, "output_column": output_column, "time_column": time_column}
        asked: dict[str, Any] = {**columns, "allow_gaps": allow_gaps, "dt": dt, "resample": resample}
        whole = [record for path in recordings for record in read_recordings(path, reading=reading, **asked)]
        require_excitation(whole)
        fewer = thinned(whole, decimation, reading, held_out=HELD_OUT)
        training, unseen = hold_out(fewer.records)
        data = Data(
            whole=whole,
            records=fewer.records,
            training=training,
            unseen=unseen,
            notes=[*clock_notes(whole), *fewer.notes],
            periodic=approximated(whole),
        )
        further = tuple(functions or ())
        if method is Method.NSS:
            space = Pnlss(states=states, degrees=tuple(range(2, degree + 1)), terms=further)
            found, document = identify_states(data, space, out, voice)
        else:
            search = Search(
                method=method.value,
                output_lags=output_lags,
                input_lags=input_lags,
                first_input_lag=first_input_lag,
                degree=degree,
                max_terms=max_terms,
                functions=further,
            )
            found, document = identify_narx(data, search, out, voice)
        voice.say(f"model: {out}")
        if folder is not None:
            write_identified(found, folder, record)
            voice.say(f"report: {folder.path / 'report.html'}")
        voice.result({"out": str(out), **document, "clocks": data.notes})
        if not found.complete:
            raise typer.Exit(130)


def _refuse_idle(context: typer.Context, method: Method) -> None:
    """Raise an error for a given option that the method does not use."""
    idle = {"states": "only nss has states"}
    if method is Method.SVB:
        idle["max_terms"] = "sparse variational Bayes has no limit on the number of terms"
    if method is Method.NSS:
        why = "a nonlinear state space has no lags and uses all terms"
        idle = dict.fromkeys(("output_lags", "input_lags", "first_input_lag", "max_terms"), why)
    for name, why in idle.items():
        source = context.get_parameter_source(name)
        if source is not None and source.name == "COMMANDLINE":
            hint = f"--{name.replace('_', '-')}"
            raise typer.BadParameter(f"{why}; leave this option out with --method {method}", param_hint=hint)
