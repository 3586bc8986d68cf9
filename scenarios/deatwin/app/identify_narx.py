"""``deatwin identify`` with a method that chooses the terms of a NARX model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.app.identify_lags import OUTPUT_LAGS, bounded, choose_input_lags, disagreements
from deatwin.app.identify_periodic import degree_remarks
from deatwin.app.identify_report import Data, Identified, Tested, interruptible
from deatwin.app.thinning import LEAST, lost
from deatwin.ident.narx import (
    FitStatus,
    Frols,
    Grow,
    Lasso,
    NarxIdentifier,
    NarxModel,
    Reliance,
    Semp,
    SvbNarx,
    refine,
    validate,
)
from deatwin.ident.narx.excited import BAND_KEY
from deatwin.ident.narx.levels import remarks_on_levels
from deatwin.ident.narx.preprocess.findings import FEWEST, FindingKind, inspect_recordings
from deatwin.ident.narx.reliance import assessed, band_excited, hold_out
from deatwin.ident.narx.semp_search import worse
from deatwin.ident.narx.unstable import recorded_once, unstable_model
from deatwin.ident.narx.variables import symbols_of
from deatwin.ident.narx.written import origins, shown_units
from deatwin.plant.errors import ModelError
from deatwin.plant.prefixes import with_unit
from deatwin.plant.recording import Recording, label
from deatwin.studies.voice import Voice

_SEARCHES = {"frols": Frols, "lasso": Lasso, "semp": Semp, "grow": Grow}
_AHEAD = ("svb", "frols")
"""Methods that choose the terms by the prediction one step ahead; the others use the free run."""
_SECTIONS = 10  # Parts of the held-out data whose squared errors are compared
_LEVEL = 0.05  # Probability that a free-run fit without any gain appears better
_WORTH_SAYING = 0.01
"""Least gain that is reported, in the output's standard deviations, and least share of the output's squares in a single
reading: as for an excess of the one-step error, 1 % changes no decision."""


@dataclass(frozen=True, kw_only=True)
class Search:
    """Options of the search for terms; lags that are None are chosen from the data."""

    method: str
    output_lags: int | None
    input_lags: int | None
    first_input_lag: int | None
    degree: int
    max_terms: int
    functions: tuple[str, ...]

    def identifier(self, input_lags: tuple[int, ...]) -> NarxIdentifier:
        """Return the estimator."""
        lags = {"output_lags": self.output_lags or OUTPUT_LAGS, "input_lags": input_lags}
        candidates: dict[str, Any] = {**lags, "degree": self.degree, "functions": self.functions}
        if self.method == "svb":
            return SvbNarx(**candidates)
        return _SEARCHES[self.method](**candidates, max_terms=self.max_terms)


def identify_narx(data: Data, search: Search, out: Path, voice: Voice) -> tuple[Identified, dict[str, Any]]:
    """Fit, save and judge a model; return it for the report, and as plain data."""
    chosen = choose_input_lags(data.training, search.first_input_lag, search.input_lags)
    identifier = search.identifier(chosen.lags)
    _fit(identifier, data, voice)
    identifier, diverged = bounded(
        identifier, data.training, lambda one: _fit(one, data, voice), may_choose=search.output_lags is None
    )
    for sentence in (*data.notes, *chosen.sentences):
        voice.say(sentence)
    tested = _tested(identifier.model_, data.unseen)
    reliance = Reliance.of(identifier.model_, tested.validation)
    model = assessed(identifier.model_, data.records, data.unseen, reliance=reliance)
    model.save(out)
    alone = [tested] if len(data.unseen) == 1 else [_tested(model, [part]) for part in data.unseen]
    errors = [_errors(model, part, own) for part, own in zip(data.unseen, alone, strict=True)]
    _say(voice, model, errors, [label(record) for record in data.records])
    complete = identifier.status_ is not FitStatus.INTERRUPTED
    found = [
        *diverged,
        *lost(model, data.unseen, data.whole),
        *outlying(data.training),
        *disagreements(model, chosen, by_free_run=search.method not in _AHEAD),
        *([] if search.method == "semp" else biased_by_noise(model, data.training, data.unseen)),
        *reliance.remarks,
        *identifier.notes_,
        *(() if tested.validation is None else tested.validation.notes),
        *(() if BAND_KEY in model.provenance else band_excited(data.records)[1]),
        *degree_remarks(data.periodic, search.degree),
        *([identifier.status_.value] if complete and not identifier.status_.ok else []),
    ]
    found = list(dict.fromkeys(found))
    for line in (*(f"note: {note}" for note in found), *remarks_on_levels(hold_out(data.whole)[0], search.degree)):
        voice.say(line)
    if not complete:
        voice.say(identifier.status_.value)
    judged = Identified(
        model=model,
        told=f"A NARX model of {len(model.terms)} terms (method {search.method})",
        data=data,
        tested=tested,
        complete=complete,
        notes=found,
        input_lags=chosen.lags,
        output_lags=search.output_lags or OUTPUT_LAGS,
    )
    signals = model.input_names + model.output_names
    document = {
        "terms": {str(term): float(value) for term, value in zip(model.terms, model.theta, strict=True)},
        "origins": dict(zip(signals, [*model.input_origin.tolist(), *model.output_origin.tolist()], strict=True)),
        "complete": complete,
        "notes": found,
        "unseen": errors,
        "input_lags": chosen.lags,
        "dead_times": chosen.document,
    }
    return judged, document


def _fit(identifier: NarxIdentifier, data: Data, voice: Voice) -> None:
    """Fit the model; if recordings are too short, name their files in the error."""
    with voice.progress("choosing terms") as progress, interruptible():
        progress(0.0, "choosing terms")
        try:
            identifier.fit(data.training, progress=progress)
        except ModelError as error:
            if sum(part.n_samples for part in data.training) >= LEAST:
                raise
            raise ModelError(f"{', '.join(dict.fromkeys(map(label, data.records)))}: {error}") from None


def _say(voice: Voice, model: NarxModel, errors: list[dict[str, Any]], labels: list[str]) -> None:
    """Print the terms with their intervals, and the errors on held-out data."""
    unit = model.output_units[0]
    shown, symbols = shown_units(model), symbols_of(model.input_names, model.output_names)
    half = 1.96 * np.sqrt(model.theta_cov.diagonal()) * shown.factors
    for term, value, width in zip(model.terms, model.theta * shown.factors, half, strict=True):
        voice.say(f"{value:>14.6g} ± {width:<12.3g} {term.written(symbols)}")
    if said := origins(model):
        voice.say(said.strip())
    if shown.legend:
        voice.say(f"  ({shown.legend})")
    for name, error in zip(labels, errors, strict=True):
        free = (
            f", error of the free run {with_unit(error['free_run'], unit)} rms"
            if error["finished"]
            else "; the free run diverges"
        )
        ahead = f"error of the prediction one step ahead {with_unit(error['one_step'], unit)} rms"
        voice.say(f"{name}, held-out part: {ahead}{free}")
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
    try:
        return Tested(validation=validate(model, unseen))
    except ModelError as error:
        diverged = any(not model.simulate(part).status.ok for part in unseen)
        unstable = unstable_model(model, unseen, recorded_once(model, unseen), diverged=diverged)
        return Tested(why_not=str(error), unstable=unstable)


def outlying(training: Sequence[Recording]) -> list[str]:
    """Return a sentence for each output with isolated outliers that affect a fit by least squares."""
    said = []
    for record in training:
        if record.n_samples < FEWEST:
            continue
        squares = record.outputs[0].var() * record.n_samples
        for found in inspect_recordings(record):
            if found.kind is FindingKind.OUTLIERS and found.size**2 > _WORTH_SAYING * squares:
                said.append(f"{found}: {found.kind.value}; these samples bias the fit")
    return said


def biased_by_noise(model: NarxModel, training: Sequence[Recording], unseen: Sequence[Recording]) -> list[str]:
    """Return a sentence if the free-run fit of the same terms is significantly better on held-out data."""
    try:
        refined = refine(model, training, tolerance=1e-4)
    except ModelError:  # no terms, or a free run that diverges
        return []
    runs = [(model.simulate(part), refined.simulate(part)) for part in unseen]
    if not all(own.status.ok and other.status.ok for own, other in runs):
        return []
    own, other = (np.concatenate([pair[i].residuals[0] for pair in runs]) for i in (0, 1))
    parts = [np.array([part @ part for part in np.array_split(errors, _SECTIONS)]) for errors in (own, other)]
    before, after = (float(np.sqrt(np.mean(errors**2))) for errors in (own, other))
    size = float(np.concatenate([part.outputs[0] for part in unseen]).std())
    if before - after < _WORTH_SAYING * size or not worse(parts[0], parts[1], _LEVEL):
        return []
    own_error, other_error = (with_unit(error, model.output_units[0]) for error in (before, after))
    return [
        f"the fit is biased by noise on the readings or by missing dynamics; use --method semp (a fit of the same terms to the "
        f"free run has an error of only {other_error} rms on held-out data, and this model {own_error} rms)"
    ]
