"""``deatwin identify``."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deatwin.app import options
from deatwin.studies.voice import Voice, complain

if TYPE_CHECKING:
    from deatwin.app.identify_report import Tested
    from deatwin.ident.narx import NarxIdentifier, NarxModel
    from deatwin.plant.recording import Recording


class Method(StrEnum):
    """Method that chooses the terms."""

    SVB = "svb"
    FROLS = "frols"
    LASSO = "lasso"
    SEMP = "semp"
    GROW = "grow"
    NSS = "nss"


_AHEAD = (Method.SVB, Method.FROLS)
"""Methods that choose the terms by the prediction one step ahead; the others use the free run."""

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
    from deatwin.app.identify_lags import FIRST, LAST, OUTPUT_LAGS, bounded, choose_input_lags, disagreements
    from deatwin.app.identify_noise import biased_by_noise, outlying
    from deatwin.app.identify_periodic import approximated, degree_remarks
    from deatwin.app.identify_report import Identified, linear_errors, write_identified
    from deatwin.app.identify_states import identify_states
    from deatwin.app.thinning import lost, thinned
    from deatwin.ident.narx import FitStatus, Reliance
    from deatwin.ident.narx.excited import BAND_KEY
    from deatwin.ident.narx.levels import remarks_on_levels
    from deatwin.ident.narx.reliance import HELD_OUT, assessed, band_excited, hold_out
    from deatwin.ident.nss import Pnlss
    from deatwin.plant.checks import require_excitation
    from deatwin.plant.files import read_recordings
    from deatwin.plant.recording import label
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
        records = [record for path in recordings for record in read_recordings(path, reading=reading, **asked)]
        notes = clock_notes(records)
        require_excitation(records)
        fewer = thinned(records, decimation, reading, held_out=HELD_OUT)
        whole, records, notes = records, fewer.records, [*notes, *fewer.notes]
        training, unseen = hold_out(records)

        def report_of(found: Identified) -> None:
            if folder is not None:
                write_identified(found, folder, record)
                voice.say(f"report: {folder.path / 'report.html'}")

        if method is Method.NSS:
            space = Pnlss(states=states, degrees=tuple(range(2, degree + 1)), terms=tuple(functions or ()))
            complete = identify_states(out, space, training, unseen, approximated(whole), notes, voice, report_of)
            if not complete:
                raise typer.Exit(130)
            return
        chosen = choose_input_lags(training, first_input_lag, input_lags)
        lags = {"output_lags": output_lags or OUTPUT_LAGS, "input_lags": chosen.lags, "degree": degree}
        lags["functions"] = tuple(functions or ())
        identifier = _identifier(method, lags, max_terms)
        _fit(identifier, training, records, voice)
        identifier, diverged = bounded(
            identifier, training, lambda one: _fit(one, training, records, voice), may_choose=output_lags is None
        )
        for sentence in (*notes, *chosen.sentences):
            voice.say(sentence)
        tested = _tested(identifier.model_, unseen)
        reliance = Reliance.of(identifier.model_, tested.validation)
        model = assessed(identifier.model_, records, unseen, reliance=reliance)
        unexcited = () if BAND_KEY in model.provenance else band_excited(records)[1]
        model.save(out)
        alone = [tested] if len(unseen) == 1 else [_tested(model, [part]) for part in unseen]
        errors = [_errors(model, part, own) for part, own in zip(unseen, alone, strict=True)]
        _say(voice, model, errors, [label(record) for record in records])
        apart = [*outlying(training), *disagreements(model, chosen, by_free_run=method not in _AHEAD)]
        apart += [] if method is Method.SEMP else biased_by_noise(model, training, unseen)
        told = () if tested.validation is None else tested.validation.notes
        periodic = approximated(whole)
        found = [
            *diverged,
            *lost(model, unseen, whole),
            *apart,
            *reliance.remarks,
            *identifier.notes_,
            *told,
            *unexcited,
            *degree_remarks(periodic, degree),
        ]
        complete = identifier.status_ is not FitStatus.INTERRUPTED
        if complete and not identifier.status_.ok:
            found.append(identifier.status_.value)
        found = list(dict.fromkeys(found))
        for line in (*(f"note: {note}" for note in found), *remarks_on_levels(hold_out(whole)[0], degree)):
            voice.say(line)
        if not complete:
            voice.say(identifier.status_.value)
        voice.say(f"model: {out}")
        if folder is not None:
            linear = (
                linear_errors(chosen.lags, output_lags or OUTPUT_LAGS, training, unseen) if tested.pole is None else []
            )
            report_of(
                Identified(
                    model=model,
                    told=f"A NARX model of {len(model.terms)} terms (method {method})",
                    unseen=unseen,
                    tested=tested,
                    complete=complete,
                    notes=found,
                    clocks=notes,
                    linear=linear,
                    best_linear=periodic,
                )
            )
        terms = {str(term): float(value) for term, value in zip(model.terms, model.theta, strict=True)}
        origins = [*model.input_origin.tolist(), *model.output_origin.tolist()]
        voice.result(
            {
                "out": str(out),
                "terms": terms,
                "origins": dict(zip(model.input_names + model.output_names, origins, strict=True)),
                "complete": complete,
                "notes": found,
                "unseen": errors,
                "input_lags": chosen.lags,
                "dead_times": chosen.document,
                "clocks": notes,
            }
        )
        if not complete:
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


def _fit(identifier: NarxIdentifier, training: Sequence[Recording], records: Sequence[Recording], voice: Voice) -> None:
    """Fit the model; if recordings are too short, name their files in the error."""
    from deatwin.app.thinning import LEAST
    from deatwin.plant.errors import ModelError
    from deatwin.plant.recording import label

    with voice.progress("choosing terms") as progress:
        progress(0.0, "choosing terms")
        try:
            identifier.fit(training, progress=progress)
        except KeyboardInterrupt:
            complain("interrupted before a model was found; nothing was written")
            raise typer.Exit(130) from None
        except ModelError as error:
            if sum(part.n_samples for part in training) >= LEAST:
                raise
            raise ModelError(f"{', '.join(dict.fromkeys(label(record) for record in records))}: {error}") from None


def _identifier(method: Method, lags: dict[str, Any], max_terms: int) -> NarxIdentifier:
    from deatwin.ident.narx import Frols, Grow, Lasso, Semp, SvbNarx

    if method is Method.SVB:
        return SvbNarx(**lags)
    searches = {Method.FROLS: Frols, Method.LASSO: Lasso, Method.SEMP: Semp, Method.GROW: Grow}
    return searches[method](**lags, max_terms=max_terms)


def _say(voice: Voice, model: NarxModel, errors: list[dict[str, Any]], labels: list[str]) -> None:
    """Print the terms with their intervals, and the errors on held-out data."""
    import numpy as np

    from deatwin.ident.narx.variables import symbols_of
    from deatwin.ident.narx.written import origins, shown_units
    from deatwin.plant.prefixes import with_unit

    unit = model.output_units[0]
    shown, symbols = shown_units(model), symbols_of(model.input_names, model.output_names)
    half = 1.96 * np.sqrt(model.theta_cov.diagonal()) * shown.factors
    for term, value, width in zip(model.terms, model.theta * shown.factors, half, strict=True):
        voice.say(f"{value:>14.6g} ± {width:<12.3g} {term.written(symbols)}")
    if said := origins(model):
        voice.say(said.strip())
    if shown.legend:
        voice.say(f"  ({shown.legend})")
    for label, error in zip(labels, errors, strict=True):
        free = (
            f", error of the free run {with_unit(error['free_run'], unit)} rms"
            if error["finished"]
            else "; the free run diverges"
        )
        ahead = f"error of the prediction one step ahead {with_unit(error['one_step'], unit)} rms"
        voice.say(f"{label}, held-out part: {ahead}{free}")
        voice.say(f"  {error['validation']}")
        for sentence in error["unstable"]:
            voice.say(f"  {sentence}")


def _errors(model: NarxModel, unseen: Recording, tested: Tested) -> dict[str, Any]:
    """Return errors and residual tests of the model on one held-out part."""
    free, found = model.simulate(unseen), tested.validation
    return {
        "one_step": model.predict(unseen).rms_error,
        "free_run": free.rms_error,
        "finished": free.status.ok,
        "unit": model.output_units[0],
        "validation": f"residuals not tested: {tested.why_not}" if found is None else found.status.value,
        "failed_tests": None if found is None else [test.name for test in found.failed],
        "unstable": [] if tested.pole is None else tested.pole.sentences(model.output_units),
    }


def _tested(model: NarxModel, unseen: Sequence[Recording]) -> Tested:
    """Validate the model on held-out parts, or return the reason why that is impossible."""
    from deatwin.app.identify_report import Tested
    from deatwin.ident.narx import validate
    from deatwin.ident.narx.unstable import recorded_once, unstable_model
    from deatwin.plant.errors import ModelError

    try:
        return Tested(validation=validate(model, unseen))
    except ModelError as error:
        diverged = any(not model.simulate(part).status.ok for part in unseen)
        unstable = unstable_model(model, unseen, recorded_once(model, unseen), diverged=diverged)
        return Tested(why_not=str(error), unstable=unstable)
