"""The stated measures: what is demanded of the story, what it reaches."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise

import numpy as np

from deatwin.ident.frequency.varying.short_time import BANDS
from deatwin.ident.narx.fleet.records import MOVES
from deatwin.ident.narx.wander import CONSTANT, LIKELIEST, REFINED, VARYING
from deatwin.scenarios.time_varying.benchmark import Benchmark, FrozenRun
from deatwin.scenarios.time_varying.study import Driven, Study
from deatwin.studies.report.story import Row

HELD = 0.9
"""Share of the instants at which a single 95 % band is to hold the truth: of one realisation, whose errors are alike
over long stretches."""
ERRORS = {1: 0.05, 2: 0.1, 3: 0.1}
"""Of a map, over its rms, by order."""
COVERED = (0.92, 0.98)
SMALL = 0.1
"""Frozen-time errors below this share of the response are held against their estimate."""
RATIO = (0.8, 1.25)
GROWTH = 3.0
"""Of what the correction leaves, when the rate doubles: the square would be 4."""
DRIFTING = ("DEA 1", "DEA 2", "DEA 3", "DEA 4", "DEA 5")
"""Those that drift throughout; the sixth shifts once, at 45 s, and then stands still."""
CHANCE = 0.01
"""Below it a change in the sliding mean or gain is not put down to chance."""
SERIES = 1e-9
BAND_DB = (1.0, 1.0, 1.0, 3.0)
"""Mean magnitude of the difference in power that is allowed in each of `BANDS`."""


def judge(study: Study) -> list[Row]:
    """Hold the study against what is demanded."""
    driven = study.driven
    return [
        *_known(study.benchmark),
        _dc(study.benchmark),
        *_frozen(study.benchmark.frozen),
        *_coverage(study.benchmark),
        _sliding(driven),
        _moves(driven),
        _opposed(study.shown),
        _whole_record(driven),
        *_better(driven),
        _likeliest(driven),
        _series(driven),
        *_bands(driven),
        _closer(driven),
        _standing(study.shown),
    ]


def _known(benchmark: Benchmark) -> list[Row]:
    held = np.concatenate([one.covered for one in benchmark.followed])
    rows = [
        Row(
            measure="known parameters: share of the instants at which a 95 % band holds the truth",
            demanded=f"at least {100 * HELD:.0f} % for each of the {held.size} parameters",
            reached=f"{100 * held.min():.1f} to {100 * held.max():.1f} %",
            passed=bool(held.min() >= HELD),
        )
    ]
    for order, limit in ERRORS.items():
        errors = [one.error(name) for one in benchmark.followed for name in one.true if name[1] == str(order)]
        rows.append(
            Row(
                measure=f"known parameters: error of the maps of order {order} (TV-GFRF, TV-NOFRF), over their rms",
                demanded=f"below {100 * limit:.0f} %",
                reached=_range(errors, lambda e: f"{100 * e:.1f}", "%"),
                passed=max(errors) < limit,
            )
        )
    return rows


def _dc(benchmark: Benchmark) -> Row:
    spans = {
        word: [float(np.ptp(20 * np.log10(side.gain))) for side in sides.values()]
        for word, sides in (("solved", benchmark.solved), ("held", benchmark.held))
    }
    return Row(
        measure="a constant that drifts, alone: by how much it changes the gains of orders 1 to 3 at 0.1 Hz",
        demanded="above 3 dB in every order, about the equilibrium of each time; nothing where it is held",
        reached=f"{', '.join(f'{s:.1f}' for s in spans['solved'])} dB; held {max(spans['held']):.1g} dB",
        passed=min(spans["solved"]) > 3 and max(spans["held"]) < 1e-9,
    )


def _frozen(runs: Sequence[FrozenRun]) -> list[Row]:
    ratios = [run.estimate / run.error for run in runs if run.error < SMALL]
    growths = []
    for kind in {(run.system, run.response) for run in runs}:
        small = [run for run in runs if (run.system, run.response) == kind and run.error < SMALL]
        growths += [later.corrected / run.corrected for run, later in pairwise(small)]
    return [
        Row(
            measure=f"frozen-time error: its estimate over what tones measure, where it is below {100 * SMALL:.0f} %",
            demanded=f"from {RATIO[0]:g} to {RATIO[1]:g}",
            reached=_range(ratios, lambda r: f"{r:.3f}"),
            passed=min(ratios) > RATIO[0] and max(ratios) < RATIO[1],
        ),
        Row(
            measure="what the correction to first order leaves: growth when the rate of variation doubles",
            demanded=f"above {GROWTH:g} (the square of the rate gives 4)",
            reached=_range(growths, lambda g: f"{g:.1f}"),
            passed=min(growths) > GROWTH,
        ),
    ]


def _coverage(benchmark: Benchmark) -> list[Row]:
    rows = []
    for order, held in benchmark.coverage.items():
        each = held.mean(axis=(1, 2))
        error = float(each.std(ddof=1)) / np.sqrt(each.size)
        rows.append(
            Row(
                measure=f"walks as the smoother takes them: truth in the 95 % ellipse of H_{order}, mean over the map",
                demanded=f"{100 * COVERED[0]:.0f} to {100 * COVERED[1]:.0f} %",
                reached=f"{100 * each.mean():.1f} ± {100 * error:.1f} % of {each.size} realisations",
                passed=bool(COVERED[0] <= each.mean() <= COVERED[1]),
            )
        )
    return rows


def _sliding(driven: Iterable[Driven]) -> Row:
    chances = {one.name: one.chance for one in driven}
    return Row(
        measure="sliding mean and gain: smaller of the two chances of so much change in an actuator that stands still",
        demanded=f"below {CHANCE:g} for each of DEA 1 to 5",
        reached=", ".join(f"{name} {p:.2g}" for name, p in chances.items()),
        passed=all(chances[name] < CHANCE for name in DRIFTING),
    )


def _moves(driven: Sequence[Driven]) -> Row:
    shown, right = [], []
    for move in MOVES:
        found = driven[move.number - 1].equilibrium
        means = [
            float(found.equilibria[(found.timepts >= first) & (found.timepts < last)].mean())
            for first, last in (move.early, move.late)
        ]
        shown.append(f"{move.number}: {1e6 * (means[1] - means[0]):+.0f}")
        right.append((means[1] - means[0]) * move.sign > 0)
    return Row(
        measure="equilibrium at 2.4 V: its moves, by actuator, between the times that the story `thesis-data` compares",
        demanded="each in the direction of the history: " + " ".join("+" if m.sign > 0 else "−" for m in MOVES),
        reached=f"{', '.join(shown)} µm",
        passed=all(right),
    )


def _opposed(shown: Sequence[Driven]) -> Row:
    changes = []
    for one in shown:
        gain = one.maps["H1"].gain[:, 0]
        tenth = gain.size // 10
        changes.append(20 * float(np.log10(gain[-tenth:].mean() / gain[:tenth].mean())))
    return Row(
        measure="gain of H_1 at the lowest frequency, last tenth of the record over the first",
        demanded="falls for DEA 1, whose permittivity relaxes; rises for DEA 2, whose tension does",
        reached=", ".join(f"{one.name} {change:+.2f} dB" for one, change in zip(shown, changes, strict=True)),
        passed=changes[0] < 0 < changes[1],
    )


def _whole_record(driven: Sequence[Driven]) -> Row:
    pairs = [(100 * (1 - one.track.seen[CONSTANT]), 100 * (1 - one.track.seen[VARYING])) for one in driven]
    return Row(
        measure="free run over the whole record, fitted to the same record: fit of constant and of varying parameters, "
        "DEA 1 to 6",
        demanded="higher with varying parameters, for each",
        reached=", ".join(f"{a:.1f} and {b:.1f}" for a, b in pairs) + " %",
        passed=all(a < b for a, b in pairs),
    )


def _better(driven: Sequence[Driven]) -> list[Row]:
    told = (
        ("unseen", CONSTANT, "blocks left out of the fit, least squares against varying"),
        ("unseen", REFINED, "blocks left out of the fit, constant parameters of least free-run error against varying"),
        ("ahead", CONSTANT, "blocks that lie ahead of all that was seen, least squares against varying"),
    )
    rows = []
    for kind, way, words in told:
        pairs = [(100 * getattr(one.track, kind)[way], 100 * getattr(one.track, kind)[VARYING]) for one in driven]
        rows.append(
            Row(
                measure=f"free-run error on {words}, over the reading's deviation, DEA 1 to 6",
                demanded="smaller with varying parameters, for each of the six",
                reached=", ".join(f"{a:.1f} and {b:.1f}" for a, b in pairs) + " %",
                passed=all(b < a for a, b in pairs),
            )
        )
    return rows


def _likeliest(driven: Sequence[Driven]) -> Row:
    seen = [100 * (1 - one.track.seen[LIKELIEST]) for one in driven]
    unseen = [(100 * one.track.unseen[LIKELIEST], 100 * one.track.unseen[CONSTANT]) for one in driven]
    worse = sum(a > b for a, b in unseen)
    return Row(
        measure="a walk of likeliest variances: fit where it was fitted, and error on blocks left out against constant "
        "parameters",
        demanded="above 99 %, and yet worse than constant parameters in most: why the wander is not chosen so",
        reached=f"fit {_range(seen, lambda s: f'{s:.1f}', '%')}; worse in {worse} of {len(unseen)}",
        passed=min(seen) > 99 and worse > len(unseen) / 2,
    )


def _series(driven: Sequence[Driven]) -> Row:
    errors = [one.series_error for one in driven]
    return Row(
        measure="G_1 U_1 + … + G_5 U_5 of a window of the recording, against the steady free run of the same model",
        demanded=f"equal to {SERIES:.0e} of the output",
        reached=_range(errors, lambda e: f"{e:.0e}"),
        passed=max(errors) < SERIES,
    )


def _bands(driven: Sequence[Driven]) -> list[Row]:
    rows = []
    for band, limit in zip(BANDS, BAND_DB, strict=True):
        means = [float(np.abs(one.judged.power_ratio_dB(VARYING, band)).mean()) for one in driven]
        largest = max(float(np.abs(one.judged.power_ratio_dB(VARYING, band)).max()) for one in driven)
        lines = [100 * one.judged.error(VARYING, band) for one in driven]
        rows.append(
            Row(
                measure=f"short-time spectrum from TV-NOFRFs against the recording's, {band[0]:g} to {band[1]:g} Hz, "
                "unseen windows: mean difference in power",
                demanded=f"below {limit:g} dB for each of the six",
                reached=f"{_range(means, lambda m: f'{m:.2f}', 'dB')}, single windows up to {largest:.1f} dB; lines "
                f"differ by {_range(lines, lambda e: f'{e:.0f}', '%')} (rms, phases included)",
                passed=max(means) < limit,
            )
        )
    return rows


def _closer(driven: Sequence[Driven]) -> Row:
    band = (BANDS[0][0], BANDS[1][1])
    pairs = {
        one.name: tuple(float(np.abs(one.judged.power_ratio_dB(way, band)).mean()) for way in (CONSTANT, VARYING))
        for one in driven
    }
    return Row(
        measure=f"the same from {band[0]:g} to {band[1]:g} Hz, constant parameters and varying ones, DEA 1 to 6",
        demanded="smaller with varying parameters for each of DEA 1 to 5",
        reached=", ".join(f"{a:.2f} and {b:.2f}" for a, b in pairs.values()) + " dB",
        passed=all(pairs[name][1] < pairs[name][0] for name in DRIFTING),
    )


def _standing(shown: Sequence[Driven]) -> Row:
    shares = [100 * share for one in shown for share in one.frozen.values()]
    return Row(
        measure="estimated frozen-time error of the actuators' TV-GFRFs, over their rms",
        demanded="below 1 %: they change little within their own memory",
        reached=_range(shares, lambda s: f"{s:.3f}", "%"),
        passed=max(shares) < 1.0,
    )


def _range(values: Iterable[float], written: Callable[[float], str], unit: str = "") -> str:
    every = list(values)
    low, high = written(min(every)), written(max(every))
    return f"{low if low == high else f'{low} to {high}'} {unit}".rstrip()
