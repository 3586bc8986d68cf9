"""Goals of the scenario, and the values reached."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from deatwin.ident.frequency.varying.short_time import BANDS
from deatwin.ident.narx.fleet import DRIFTING, MOVES
from deatwin.ident.narx.varying_systems import CONSTANT, LIKELIEST, REFINED, VARYING
from deatwin.scenarios.time_varying.study import Driven, FrozenRun, Known, Study
from deatwin.studies.report.story import Measure
from deatwin.studies.report.words import Each, Span, Words

WORDS = Words(__package__)
HELD = 0.9
"""Share of the instants at which a single 95 % band is to hold the truth: of one realisation, whose errors are alike
over long stretches."""
ERRORS = {1: 0.05, 2: 0.1, 3: 0.1}  # Errors of a map over its rms, by order
COVERED = (0.92, 0.98)
SMALL = 0.1  # Frozen-time errors below this share of the response are held against their estimate
RATIO = (0.8, 1.25)
GROWTH = 3.0  # Growth of what the correction leaves, when the rate doubles: the square would be 4
CHANCE = 0.01  # Below it a change in the sliding mean or gain is not put down to chance
SERIES = 1e-9
BAND_DB = (1.0, 1.0, 1.0, 3.0)  # Mean magnitude of the difference in power that is allowed in each of `BANDS`


def judge(study: Study) -> list[Measure]:
    """Compare the study with its goals."""
    shares = [100 * share for one in study.shown for share in one.frozen.values()]
    return [
        *_known(study.known),
        *_frozen(study.known.frozen),
        *_coverage(study.known),
        *_drifts(study),
        *_unseen(study.driven),
        *_spectra(study.driven),
        WORDS.measure("standing", max(shares) < 1.0, shares=Span(shares)),
    ]


def _known(known: Known) -> Iterable[Measure]:
    """Parameters and maps against the truth, and a constant that drifts."""
    held = np.concatenate([one.covered for one in known.followed])
    yield WORDS.measure("bands", held.min() >= HELD, HELD=100 * HELD, count=held.size, held=Span(100 * held))
    for order, limit in ERRORS.items():
        errors = [one.error(name) for one in known.followed for name in one.true if name[1] == str(order)]
        shown = Span(100 * error for error in errors)
        yield WORDS.measure("maps", max(errors) < limit, order=order, limit=100 * limit, errors=shown)
    solved, still = (
        [float(np.ptp(20 * np.log10(side.gain))) for side in sides.values()] for sides in (known.solved, known.held)
    )
    yield WORDS.measure("dc", min(solved) > 3 and max(still) < 1e-9, solved=Each(solved), held=max(still))


def _frozen(runs: Sequence[FrozenRun]) -> list[Measure]:
    """The estimate of the frozen-time error, and what its correction leaves."""
    small = [run for run in runs if run.error < SMALL]
    ratios = [run.estimate / run.error for run in small]
    growths = []
    for kind in {(run.system, run.response) for run in runs}:
        of_kind = [run for run in small if (run.system, run.response) == kind]
        growths += [later.corrected / run.corrected for run, later in pairwise(of_kind)]
    inside = min(ratios) > RATIO[0] and max(ratios) < RATIO[1]
    return [
        WORDS.measure("frozen", inside, SMALL=100 * SMALL, RATIO=RATIO, ratios=Span(ratios)),
        WORDS.measure("corrected", min(growths) > GROWTH, GROWTH=GROWTH, growths=Span(growths)),
    ]


def _coverage(known: Known) -> Iterable[Measure]:
    """Ellipses of random walks against the truth."""
    for order, held in known.coverage.items():
        each = held.mean(axis=(1, 2))
        mean, error = float(each.mean()), float(each.std(ddof=1)) / np.sqrt(each.size)
        goal = {"low": 100 * COVERED[0], "high": 100 * COVERED[1]}
        found = {"mean": 100 * mean, "error": 100 * error, "count": each.size}
        yield WORDS.measure("coverage", COVERED[0] <= mean <= COVERED[1], order=order, **goal, **found)


def _drifts(study: Study) -> Iterable[Measure]:
    """Drifts before any fit, in the equilibrium and in the gain."""
    chances = {one.name: one.chance for one in study.driven}
    texts = ", ".join(f"{name}: {chance:.2g}" for name, chance in chances.items())
    yield WORDS.measure("sliding", all(chances[n] < CHANCE for n in DRIFTING), CHANCE=CHANCE, chances=texts)

    moves = []
    for move in MOVES:
        found = study.driven[move.number - 1].equilibrium
        early, late = (
            float(found.equilibria[(found.timepts >= first) & (found.timepts < last)].mean())
            for first, last in (move.early, move.late)
        )
        moves.append((move, late - early))
    signs = " ".join("+" if move.sign > 0 else "−" for move in MOVES)
    texts = ", ".join(f"DEA {move.number}: {1e6 * size:+.0f}" for move, size in moves)
    yield WORDS.measure("moves", all(size * move.sign > 0 for move, size in moves), signs=signs, moves=texts)

    changes = {}
    for one in study.shown:
        gain = one.maps["H1"].gain[:, 0]
        tenth = gain.size // 10
        changes[one.name] = 20 * float(np.log10(gain[-tenth:].mean() / gain[:tenth].mean()))
    first, second, *_ = changes.values()
    texts = ", ".join(f"{name}: {change:+.2f} dB" for name, change in changes.items())
    yield WORDS.measure("opposed", first < 0 < second, changes=texts)


def _unseen(driven: Sequence[Driven]) -> Iterable[Measure]:
    """Errors with varying and with constant parameters."""
    seen = [(100 * (1 - one.track.seen[CONSTANT]), 100 * (1 - one.track.seen[VARYING])) for one in driven]
    yield WORDS.measure("whole", all(a < b for a, b in seen), pairs=Each(seen))
    for kind, way, which in (
        ("unseen", CONSTANT, "held-out blocks: first with constant parameters (least squares)"),
        ("unseen", REFINED, "held-out blocks: first with constant parameters (fitted to the free run)"),
        ("ahead", CONSTANT, "blocks after the fitted data: first with constant parameters (least squares)"),
    ):
        which += ", then with varying parameters"
        errors = [getattr(one.track, kind) for one in driven]
        pairs = [(100 * error[way], 100 * error[VARYING]) for error in errors]
        yield WORDS.measure("better", all(b < a for a, b in pairs), which=which, pairs=Each(pairs))
    fits = [100 * (1 - one.track.seen[LIKELIEST]) for one in driven]
    worse = sum(one.track.unseen[LIKELIEST] > one.track.unseen[CONSTANT] for one in driven)
    passed = min(fits) > 99 and worse > len(driven) / 2
    yield WORDS.measure("likeliest", passed, seen=Span(fits), worse=worse, total=len(driven))


def _spectra(driven: Sequence[Driven]) -> Iterable[Measure]:
    """Series of orders against free runs, and short-time spectra against those recorded."""
    errors = [one.series_error for one in driven]
    yield WORDS.measure("series", max(errors) < SERIES, SERIES=SERIES, errors=Span(errors))
    for band, limit in zip(BANDS, BAND_DB, strict=True):
        differences = [np.abs(one.judged.power_ratio_dB(VARYING, band)) for one in driven]
        means, largest = [float(each.mean()) for each in differences], max(float(each.max()) for each in differences)
        lines = Span(100 * one.judged.error(VARYING, band) for one in driven)
        numbers = {"low": band[0], "high": band[1], "limit": limit, "largest": largest, "lines": lines}
        yield WORDS.measure("spectrum", max(means) < limit, **numbers, means=Span(means))
    band = (BANDS[0][0], BANDS[1][1])
    pairs = {
        one.name: tuple(float(np.abs(one.judged.power_ratio_dB(way, band)).mean()) for way in (CONSTANT, VARYING))
        for one in driven
    }
    closer = all(pairs[name][1] < pairs[name][0] for name in DRIFTING)
    yield WORDS.measure("closer", closer, low=band[0], high=band[1], pairs=Each(pairs.values()))
