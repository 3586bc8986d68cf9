"""The stated measures: what is demanded of theory, tools and fleet, what they reach."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from deatwin.ident.frequency.output_responses.powers import AMPLIFICATION
from deatwin.ident.narx.fleet.alike import BAND
from deatwin.scenarios.frequency_analysis.actuators import FREQUENCIES, ORDERS, Actuators, Analysed
from deatwin.scenarios.frequency_analysis.anchor import Anchor
from deatwin.scenarios.frequency_analysis.benchmarks import Benchmarks
from deatwin.studies.report.story import Row

ROUNDING = 1e-12
SOLVED = 1e-6
EMPTY = 1e-20
LOW, HIGH = 0.01, 1.0
"""Between which the noise had its power, Hz."""
HALF = 0.5


def judge(found: Benchmarks, fleet: Actuators, truth: Anchor) -> list[Row]:
    """Hold the analysis against what is demanded."""
    return [*_benchmarks(found), *_dc(fleet.each), *_gfrfs(fleet.each), *_nofrfs(fleet), *_bands(fleet, truth)]


def spread(each: Iterable[Analysed], frequency_Hz: float) -> float:
    """Largest first-order gain over the smallest, less one."""
    place = int(np.argmin(np.abs(FREQUENCIES - frequency_Hz)))
    gains = [float(one.first.gain[place]) for one in each]
    return max(gains) / min(gains) - 1


def _benchmarks(found: Benchmarks) -> list[Row]:
    closed = max(error for errors in found.errors.values() for error in errors.values())
    finite, endless = found.ranges
    own = max(one.outside for one in found.ranges)
    hammerstein, duffing = found.evaluated
    finite_error, endless_error = (float(one.errors.max()) for one in found.evaluated)
    coverage = found.identified.coverage
    return [
        Row(
            measure="H₁ to H₄ of four systems against their closed forms, over the largest gain of each",
            demanded=f"below {ROUNDING:g}",
            reached=f"{closed:.0e}",
            passed=closed < ROUNDING,
        ),
        Row(
            measure=f"energy of each order outside its range, of {finite.system.name} and {endless.system.name}; "
            f"simulated energy of {finite.system.name} outside the ranges of its three orders",
            demanded=f"shares below {EMPTY:g}",
            reached=f"{own:.0e}; {finite.simulated_outside:.0e}",
            passed=max(own, finite.simulated_outside) < EMPTY,
        ),
        Row(
            measure=f"{hammerstein.system.name}, of three orders: GₙUₙ of least squares against the model's, and their "
            "sum against the simulated spectrum, over the largest line",
            demanded=f"below {SOLVED:g}",
            reached=f"{finite_error:.0e}; {hammerstein.sum_error:.0e}",
            passed=max(finite_error, hammerstein.sum_error) < SOLVED,
        ),
        Row(
            measure=f"{duffing.system.name}, of endless orders: the same with {duffing.fitted.highest} orders fitted",
            demanded=f"the sum below {SOLVED:g}, G₁ to G₃ below 0.01",
            reached=f"{duffing.sum_error:.0e}; {endless_error:.0e}",
            passed=duffing.sum_error < SOLVED and endless_error < 0.01,
        ),
        Row(
            measure=f"95 % bands of |Y₁| to |Y₃|: lines that hold the truth, over {found.identified.recordings} "
            "recordings of S2",
            demanded="92 to 98 %",
            reached=", ".join(f"{100 * c:.1f}" for c in coverage) + " %",
            passed=bool(np.all((coverage >= 0.92) & (coverage <= 0.98))),
        ),
    ]


def _dc(each: Iterable[Analysed]) -> list[Row]:
    removals = [one.removal for one in each]
    kept = max(removal.error for removal in removals)
    off = [removal.deleted_error for removal in removals]
    own = [float(np.std(removal.section.outputs[0] - removal.run) / removal.run.std()) for removal in removals]
    return [
        Row(
            measure="free run of the model of deviations, put back, less that of the model itself, over the stroke",
            demanded="below 1e-10 for each actuator",
            reached=f"{kept:.0e}",
            passed=kept < 1e-10,
        ),
        Row(
            measure="the same where nothing but a constant is left out, over the deviation of the run",
            demanded="wrong: more than the model's own error, for each",
            reached=f"{_range(off, '.2f')}; the model's own error is {_range(own, '.2f')}",
            passed=all(a > b for a, b in zip(off, own, strict=True)),
        ),
    ]


def _gfrfs(each: tuple[Analysed, ...]) -> list[Row]:
    low, high = spread(each, LOW), spread(each, HIGH)
    ridges = [one.ridge for one in each]
    return [
        Row(
            measure=f"|H₁|: largest of the actuators over the smallest, at {LOW:g} Hz and at {HIGH:g} Hz",
            demanded="alike at the low frequency and not at the high one, as the thesis saw: at most half as far apart",
            reached=f"{100 * low:.0f} % and {100 * high:.0f} % apart",
            passed=low <= HALF * high,
        ),
        Row(
            measure="|H₂(f, −f)| over |H₂(f, f)|, mean over 0.1 to 0.3 Hz",
            demanded="a ridge: above 1 for each",
            reached=_range(ridges, ".2f"),
            passed=min(ridges) > 1,
        ),
    ]


def _nofrfs(fleet: Actuators) -> list[Row]:
    designed = max(u.largest_amplification for u in fleet.side.designed_inputs)
    random = [u.largest_amplification for u in fleet.side.random_inputs[1:]]
    sums = [one.sum_error for one in fleet.each]
    fitted = np.array([one.errors[:ORDERS] for one in fleet.each]).max(axis=0)
    left = [float(one.left[-1]) for one in fleet.each]
    outside = max(_outside(one) for one in fleet.each)
    return [
        Row(
            measure="by what an error of an order can grow in Gₙ (sum of its weights' magnitudes): test signal, and "
            "record",
            demanded=f"at most {AMPLIFICATION:g}, and more",
            reached=f"{designed:.3g}, and {' and '.join(f'{a:.0f}' for a in random)} at orders 2 and 3",
            passed=designed <= AMPLIFICATION < min(random),
        ),
        Row(
            measure="sum of GₙUₙ against the simulated spectrum, over the largest line",
            demanded=f"below {SOLVED:g} for each actuator",
            reached=f"{min(sums):.0e} to {max(sums):.0e}",
            passed=max(sums) < SOLVED,
        ),
        Row(
            measure="G₁, G₂, G₃ of least squares against the models' own, over the largest gain",
            demanded=f"below {SOLVED:g}",
            reached=", ".join(f"{e:.0e}" for e in fitted),
            passed=bool(fitted.max() < SOLVED),
        ),
        Row(
            measure="what the orders leave of the settled free run under a piece of the record at its own size",
            demanded=f"below {SOLVED:g} for each actuator: the series ends",
            reached=f"at most {max(left):.0e}",
            passed=max(left) < SOLVED,
        ),
        Row(
            measure=f"energy of the orders outside 0 to n times {BAND[1]:g} Hz",
            demanded=f"a share below {EMPTY:g}",
            reached=f"{outside:.0e}",
            passed=outside < EMPTY,
        ),
    ]


def _outside(one: Analysed) -> float:
    """Largest share of the energy of an order outside its range."""
    shares = []
    for y in one.outputs:
        power = y.gain**2
        shares.append(float(power[y.frequency_Hz > y.order * BAND[1] + 1e-9].sum() / (power.sum() or 1.0)))
    return max(shares)


def _bands(fleet: Actuators, truth: Anchor) -> list[Row]:
    ratios = [fleet.sampled.ratios(order) for order in range(1, ORDERS + 1)]
    every = np.concatenate(ratios)
    refined, squares = truth.error(truth.refined), truth.error(truth.least_squares)
    return [
        Row(
            measure=f"{fleet.sampled.name} by SVB: deviation of |Y₁| to |Y₃| among {len(fleet.sampled.draws)} draws "
            "over the propagated one, where the linear law is said to hold",
            demanded="0.85 to 1.15: the deviation of so many draws itself varies by 3.5 % at each line",
            reached=_range(every.tolist(), ".2f"),
            passed=bool(every.size and 0.85 < every.min() < every.max() < 1.15),
        ),
        Row(
            measure=f"{truth.name} without hysteresis and history: |H₁| of the model of least free-run error against "
            "what the film itself answers",
            demanded="within 5 % at all tones",
            reached=f"{100 * refined:.1f} %; least squares {100 * squares:.0f} %",
            passed=refined < 0.05,
        ),
    ]


def _range(values: Iterable[float], form: str) -> str:
    every = list(values)
    return f"{min(every):{form}} to {max(every):{form}}"
