"""Goals and tables: requirements on theory, tools and fleet, and the values reached."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from deatwin.ident.frequency.closed_forms import SYSTEMS
from deatwin.ident.frequency.output_responses.powers import AMPLIFICATION
from deatwin.ident.narx.fleet import BAND
from deatwin.scenarios.frequency_analysis.actuators import FREQUENCIES, ORDERS, Actuators, Analysed, Anchor
from deatwin.scenarios.frequency_analysis.known import Known
from deatwin.studies.report.story import Measure, Table
from deatwin.studies.report.tables import parameters_by_term
from deatwin.studies.report.words import Each, Span, Words

WORDS = Words(__package__)
ROUNDING = 1e-12
SOLVED = 1e-6
EMPTY = 1e-20
LOW, HIGH = 0.01, 1.0  # Frequencies between which the noise had its power, Hz
HALF = 0.5


def judge(known: Known, found: Actuators, truth: Anchor) -> list[Measure]:
    """Compare the analysis with its goals."""
    return [*_known(known), *_dc(found.each), *_gfrfs(found.each), *_nofrfs(found), *_bands(found, truth)]


def spread(each: Iterable[Analysed], frequency_Hz: float) -> float:
    """Return the largest first-order gain divided by the smallest, minus one."""
    place = int(np.argmin(np.abs(FREQUENCIES - frequency_Hz)))
    gains = [float(one.first.gain[place]) for one in each]
    return max(gains) / min(gains) - 1


def _known(known: Known) -> Iterable[Measure]:
    closed = max(error for errors in known.errors.values() for error in errors.values())
    yield WORDS.measure("closed", closed < ROUNDING, ROUNDING=ROUNDING, closed=closed)

    (finite, three), (endless, duffing) = known.evaluated.items()
    own, simulated = max(one.outside for one in known.ranges.values()), known.ranges[finite].simulated_outside
    names = {"finite": finite.name, "endless": endless.name}
    yield WORDS.measure("ranges", max(own, simulated) < EMPTY, EMPTY=EMPTY, own=own, simulated=simulated, **names)

    error, sum_error = float(three.line_errors.max()), three.sum_error
    numbers = {"SOLVED": SOLVED, "error": error, "sum_error": sum_error}
    yield WORDS.measure("finite", max(error, sum_error) < SOLVED, name=finite.name, **numbers)
    error, sum_error = float(duffing.line_errors.max()), duffing.sum_error
    numbers = {"SOLVED": SOLVED, "error": error, "sum_error": sum_error, "highest": duffing.fitted.highest}
    yield WORDS.measure("endless", sum_error < SOLVED and error < 0.01, name=endless.name, **numbers)

    coverage, recordings = known.identified.coverage, known.identified.recordings
    passed = bool(np.all((coverage >= 0.92) & (coverage <= 0.98)))
    yield WORDS.measure("coverage", passed, recordings=recordings, coverage=Each(100 * coverage))


def _dc(each: Iterable[Analysed]) -> list[Measure]:
    removals = [one.removal for one in each]
    kept, off = max(removal.error for removal in removals), [removal.deleted_error for removal in removals]
    own = [float(np.std(removal.section.outputs[0] - removal.run) / removal.run.std()) for removal in removals]
    wrong = all(a > b for a, b in zip(off, own, strict=True))
    return [
        WORDS.measure("removal", kept < 1e-10, kept=kept),
        WORDS.measure("deletion", wrong, off=Span(off), own=Span(own)),
    ]


def _gfrfs(each: Sequence[Analysed]) -> list[Measure]:
    low, high, ridges = spread(each, LOW), spread(each, HIGH), [one.ridge for one in each]
    return [
        WORDS.measure("spread", low <= HALF * high, LOW=LOW, HIGH=HIGH, low=100 * low, high=100 * high),
        WORDS.measure("ridge", min(ridges) > 1, ridges=Span(ridges)),
    ]


def _nofrfs(found: Actuators) -> Iterable[Measure]:
    designed = max(u.largest_amplification for u in found.side.designed_inputs)
    random = [u.largest_amplification for u in found.side.random_inputs[1:]]
    passed = designed <= AMPLIFICATION < min(random)
    yield WORDS.measure("amplification", passed, AMPLIFICATION=AMPLIFICATION, designed=designed, random=random)

    sums = [one.nofrfs.sum_error for one in found.each]
    errors = np.array([one.nofrfs.errors[:ORDERS] for one in found.each]).max(axis=0)
    left, outside = max(float(one.left[-1]) for one in found.each), max(_outside(one) for one in found.each)
    yield WORDS.measure("sum", max(sums) < SOLVED, SOLVED=SOLVED, sums=Span(sums))
    yield WORDS.measure("fitted", bool(errors.max() < SOLVED), SOLVED=SOLVED, errors=Each(errors))
    yield WORDS.measure("left", left < SOLVED, SOLVED=SOLVED, left=left)
    yield WORDS.measure("outside", outside < EMPTY, EMPTY=EMPTY, highest=BAND[1], outside=outside)


def _outside(one: Analysed) -> float:
    """Return the largest share of an order's energy outside its range."""
    powers = [(y.gain**2, y.frequency_Hz > y.order * BAND[1] + 1e-9) for y in one.outputs]
    return max(float(power[beyond].sum() / (power.sum() or 1.0)) for power, beyond in powers)


def _bands(found: Actuators, truth: Anchor) -> list[Measure]:
    ratios = np.concatenate([found.sampled.ratios(order) for order in range(1, ORDERS + 1)])
    refined, squares = truth.error(truth.refined), truth.error(truth.least_squares)
    equal = bool(ratios.size and 0.85 < ratios.min() < ratios.max() < 1.15)
    draws = {"name": found.shown.name, "draws": len(found.sampled.draws), "ratios": Span(ratios)}
    return [
        WORDS.measure("draws", equal, **draws),
        WORDS.measure("film", refined < 0.05, name=truth.name, refined=100 * refined, squares=100 * squares),
    ]


def tables(known: Known, found: Actuators) -> list[Table]:
    """Make all tables."""
    shown = found.shown.removal
    point, terms = shown.shifted.point, parameters_by_term(shown.model, shown.shifted.model)
    closed = [
        [one.name, one.shown, *(_error(known.errors[one.name].get(order)) for order in (1, 2, 3, 4))] for one in SYSTEMS
    ]
    return [
        WORDS.table("closed", closed),
        WORDS.table("removal", terms, name=found.shown.name, level=point.operating_input[0], rest=1e3 * point.output),
        WORDS.table("deviations", [_deviations(one) for one in found.each]),
    ]


def _error(error: float | None) -> str:
    return "–" if error is None else f"{error:.0e}" if error else "0"


def _deviations(one: Analysed) -> list[str]:
    """The operating point, and what the removal and the deletion of the constant do."""
    removal, point = one.removal, one.removal.shifted.point
    rest = [f"{point.operating_input[0]:.3f} V", f"{1e3 * point.output:.3f} mm"]
    terms = f"{len(removal.model.terms)} and {len(removal.shifted.model.terms)}"
    errors = [f"{removal.error:.0e}", f"{removal.deleted_error:.2f}", f"{one.alike.fit_percent:.1f} %"]
    return [one.name, *rest, "stable" if point.is_stable else "unstable", terms, *errors]
