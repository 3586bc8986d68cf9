"""Goals for the models, and the values reached."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from deatwin.ident.frequency.removal import remove
from deatwin.ident.narx import one_step_band
from deatwin.ident.narx.fleet.records import FILM, STEADY
from deatwin.scenarios.fleet_models import WORDS
from deatwin.scenarios.fleet_models.study import FROLS, LINEAR, SEMP, SVB, Study
from deatwin.studies.report.story import Measure
from deatwin.studies.report.words import Each, Span

HALF = 0.5  # Share of the linear model's error that a nonlinear one must stay below
AS_GOOD = 1.1  # Error of SVB that is allowed, over that of SEMP
RISE = 1e-9  # Share of itself by which a lower bound may seem to fall, by rounding


def judge_semp(study: Study) -> list[Measure]:
    """Compare the models of SEMP with the goals."""
    runs = [[float(b.models[m].training.free_run.rms[0]) for m in (SEMP, FROLS)] for b in study.recorded]
    better = sum(own < other for own, other in runs)
    sound = [bench for bench in study.recorded if not bench.models[SEMP].held_out.diverged]
    worst = max((remove(bench.models[SEMP].model, bench.sections[1]).error for bench in sound), default=0.0)
    return [
        *_of_method(study, SEMP),
        WORDS.measure("fro", better > len(runs) / 2, pairs=Each((1e6 * a, 1e6 * b) for a, b in runs)),
        WORDS.measure("dc", worst < 1e-9, worst=worst),
    ]


def judge_svb(study: Study) -> list[Measure]:
    """Compare the models of SVB and their posteriors with the goals."""
    shares = [bench.models[SVB].error / bench.models[SEMP].error for bench in study.recorded]
    fall = max(
        float(np.max(-np.diff(step.bounds), initial=0.0)) / abs(step.lower_bound)
        for bench in study.recorded
        for step in bench.models[SVB].search.path_
    )
    bands = [one_step_band(bench.models[SVB].model, bench.sections[1]) for bench in study.benches[FILM]]
    within = [100 * float(band.coverage[0]) for band in bands]
    median, middle = float(np.median(shares)), float(np.median(within))
    return [
        *_of_method(study, SVB),
        WORDS.measure("semp", median <= AS_GOOD, AS_GOOD=AS_GOOD, shares=Each(shares), median=median),
        WORDS.measure("bounds", fall <= RISE, RISE=RISE, fall=fall),
        WORDS.measure("band", 90 <= middle <= 99, shares=Span(within), median=middle),
    ]


def _of_method(study: Study, method: str) -> Iterable[Measure]:
    """Return the goals for either method."""
    models = {variant: [bench.models[method] for bench in benches] for variant, benches in study.benches.items()}
    found = [bench.models[method] for bench in study.recorded]
    finite = [not one.held_out.diverged for one in found]
    yield WORDS.measure("sound", all(finite), method=method, count=sum(finite), total=len(finite))

    linear = [float(bench.models[LINEAR].held_out.free_run.nrmse[0]) for bench in study.recorded]
    shares = [float(one.held_out.free_run.nrmse[0]) / other for one, other in zip(found, linear, strict=True)]
    fits = Span(one.fit for one in found)
    yield WORDS.measure("linear", max(shares) < HALF, method=method, HALF=HALF, shares=Span(shares), fits=fits)

    whole = [one.passed == len(one.held_out.tests) for one in found]
    total, passed = sum(len(one.held_out.tests) for one in found), sum(one.passed for one in found)
    yield WORDS.measure("tests", all(whole), method=method, passed=passed, total=total, whole=sum(whole))

    gains = [without.fit - one.fit for one, without in zip(found, models[STEADY], strict=True)]
    drifting = float(np.median(gains[:5]))  # the sixth shifts before its sections and stands still in them
    yield WORDS.measure("history", drifting > 0, method=method, gains=Each(gains))

    losses = [one.error / film.error for one, film in zip(models[STEADY], models[FILM], strict=True)]
    median = float(np.median(losses))
    yield WORDS.measure("hysteresis", median > 1, method=method, losses=Span(losses), median=median)
