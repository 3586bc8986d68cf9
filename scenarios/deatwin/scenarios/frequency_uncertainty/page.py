"""Goals, values reached and tables; and the figures, after figures 7.1 to 7.6 of the thesis."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from deatwin.ident.frequency import Agreement, Comparison, Difference, FrequencyResponse, UncertaintyStatus
from deatwin.ident.frequency.comparison.records import share_of
from deatwin.ident.frequency.uncertainty.beside_draws import Spread, columns_of
from deatwin.ident.narx.fleet import DRIFTING
from deatwin.plant.arrays import Array
from deatwin.plant.drawing import Axes
from deatwin.plant.fleet import TOLERANCES
from deatwin.plant.words import spaced
from deatwin.scenarios.frequency_uncertainty.study import BILINEAR, LINEAR, NOTCH, Consistency, Known, Study
from deatwin.studies.report.drawing import (
    STYLES,
    SUBSCRIPTS,
    Drawing,
    Hue,
    draw,
    draw_between,
    legend_above,
    panels_of,
    titled,
)
from deatwin.studies.report.story import Measure, Table
from deatwin.studies.report.words import Span, Words

WORDS = Words(__package__)
COVERED = (0.92, 0.98)  # Share of the 95 % regions that may hold the truth
FASTER = 200.0
FALSE = 0.05  # Share of the tests that may find something where there is nothing
CHANCE = (0.41, 1.60)
"""Between these a standard deviation of six lies with 95 %, over that of the law they are drawn from (chi-squared of
five degrees of freedom)."""


def judge(study: Study) -> list[Measure]:
    """Compare the study with its goals."""
    return [*_known(study.known), *_tests(study.consistency), *_sizes(study.consistency)]


def counted(table: Comparison, kind: Agreement) -> int:
    """Number of differences of a kind."""
    return sum(d.agreement is kind for d in table.differences)


def _known(known: Known) -> Iterable[Measure]:
    yield _draws("H₁, H₂, H₃ of four systems", [spread for each in known.cases.values() for spread in each])
    yield _draws("Y₁, Y₂, Y₃ of a multisine", list(known.spectra))
    for name, flags in known.coverage.items():
        shares = {order: float(each.mean()) for order, each in flags.items()}
        passed = all(COVERED[0] <= share <= COVERED[1] for share in shares.values())
        sets = len(next(iter(flags.values())))
        text = ", ".join(f"H{SUBSCRIPTS[order]}: {100 * share:.1f} %" for order, share in shares.items())
        yield WORDS.measure("coverage", passed, name=name, sets=sets, shares=text)

    held, holds = (np.concatenate([getattr(one, name) for one in known.sweeps]) for name in ("held", "holds"))
    wrong = (held < COVERED[0]) | (held > COVERED[1])
    numbers = {"total": held.size, "warned": np.sum(~holds), "wrong": wrong.sum(), "missed": np.sum(wrong & holds)}
    yield WORDS.measure("warned", numbers["missed"] == 0, **{**numbers, "missed": numbers["missed"] or "none"})

    slowest = min(one.ratio for one in known.speeds)
    ratios = ", ".join(f"{one.label}: {one.ratio:.0f}" for one in known.speeds)
    yield WORDS.measure("speed", slowest >= FASTER, FASTER=FASTER, ratios=ratios)


def _draws(what: str, every: list[Spread]) -> Measure:
    """Propagation against Monte Carlo."""
    strict = np.concatenate([one.strict for one in every])
    within = sum(one.largest <= one.allowed for one in every)
    return WORDS.measure(
        "draws",
        within == len(every),
        what=what,
        draws=len(every[0].sampled.draws),
        strict=strict.sum(),
        total=strict.size,
        within=within,
        responses=len(every),
        worst=max(every, key=lambda one: one.largest / one.allowed),
    )


def _tests(fleet: Consistency) -> Iterable[Measure]:
    """Tests of records that are known to differ or drift, and of records that do not."""
    repeats, steady, shared = (fleet.tables[group] for group in ("repeats", "steady", "shared"))
    single = float(np.mean([d.p_value < repeats.level for d in repeats.differences]))
    records = len({name for pair in repeats.pairs for name in pair})
    counts = {"tests": len(repeats.differences), "pairs": len(repeats.pairs), "records": records}
    yield WORDS.measure("single", single <= FALSE, single=100 * single, **counts)
    yield WORDS.measure("corrected", repeats.share <= FALSE, found=len(repeats.significant))

    drifts = sum(drift.drifts for drift in steady.drifts)
    yield WORDS.measure("no_drift", not drifts, found=drifts, total=len(steady.drifts))
    found = sorted({drift.name for drift in fleet.tables["fleet"].drifts if drift.drifts})
    names = {"DRIFTING": ", ".join(DRIFTING), "found": ", ".join(found) or "none"}
    yield WORDS.measure("drift", found == list(DRIFTING), **names)

    different, drift = (counted(shared, kind) for kind in (Agreement.DIFFERENT, Agreement.DRIFT))
    total = len(shared.differences)
    numbers = {"different": different, "total": total, "percent": 100 * different / total, "drift": drift}
    yield WORDS.measure("shared", different <= FALSE * total, **numbers)


def _sizes(fleet: Consistency) -> Iterable[Measure]:
    """Compare the sizes of differences with the true ones of the simulated fleet."""
    inside = [contrast.inside for contrast in fleet.contrasts]
    share = float(np.mean(inside))
    yield WORDS.measure("truth", share >= 0.9, percent=100 * share, total=len(inside))
    ratios = fleet.spread("steady") / fleet.predicted
    passed = bool(np.all((ratios >= CHANCE[0]) & (ratios <= CHANCE[1])))
    yield WORDS.measure("tolerances", passed, CHANCE=CHANCE, ratios=Span(ratios))


_SAYS = {
    UncertaintyStatus.OK: "its law holds",
    UncertaintyStatus.LOW_GAIN: "a gain is near zero",
    UncertaintyStatus.BENT: "warns: too nonlinear",
    UncertaintyStatus.LOST: "warns: an equilibrium is lost",
    UncertaintyStatus.CERTAIN: "no covariance",
}
_MARKS = {Agreement.DIFFERENT: "differ", Agreement.DRIFT: "drift", Agreement.ALIKE: "–"}


def tables(study: Study) -> list[Table]:
    """Make all tables."""
    fleet = study.consistency
    columns = [column_of(column) for column in fleet.columns]
    drifts = list(_drifts(fleet.tables["fleet"]))
    return [
        WORDS.table("consistency", list(_consistency(fleet))),
        WORDS.table("pairs", list(_pairs(fleet.tables["fleet"])), *columns, how="as recorded"),
        WORDS.table("pairs", list(_pairs(fleet.tables["steady"])), *columns, how="without their histories"),
        WORDS.table("drifts", drifts, *columns),
        WORDS.table("tolerances", list(_tolerances(fleet)), *columns),
        WORDS.table("systems", list(_systems(study.known))),
    ]


def column_of(column: tuple[int, float, float], between: str = ", ") -> str:
    """An order and a band in words."""
    order, low, high = column
    return f"H{SUBSCRIPTS[order]}{between}{low:g}–{high:g} Hz"


def _consistency(fleet: Consistency) -> Iterator[list[str]]:
    repeats, steady, recorded = (fleet.tables[group] for group in ("repeats", "steady", "fleet"))
    single = np.reshape([d.p_value < repeats.level for d in repeats.differences], (len(repeats.pairs), -1)).mean(axis=0)
    shares = (
        1 - share_of(repeats, Agreement.ALIKE),
        1 - share_of(steady, Agreement.ALIKE),
        share_of(recorded, Agreement.DIFFERENT),
        share_of(recorded, Agreement.DRIFT),
    )
    spreads = (fleet.predicted, fleet.spread("steady"), fleet.spread("fleet"))
    for i, column in enumerate(fleet.columns):
        differ = [f"{100 * share[i]:.0f} %" for share in shares]
        sizes = [f"{100 * spread[i]:.1f} %" for spread in spreads]
        yield [column_of(column), f"{100 * single[i]:.1f} %", *differ, *sizes]


def _pairs(table: Comparison) -> Iterator[list[str]]:
    found: dict[tuple[str, str], list[Difference]] = {pair: [] for pair in table.pairs}
    for difference in table.differences:
        found[difference.first, difference.second].append(difference)
    for pair, each in found.items():
        yield [" and ".join(pair), *(f"{100 * d.size:.0f} %, {_MARKS[d.agreement]}, p {_p(d.adjusted)}" for d in each)]


def _drifts(table: Comparison) -> Iterator[list[str]]:
    for name in dict.fromkeys(drift.name for drift in table.drifts):
        each = [drift for drift in table.drifts if drift.name == name]
        yield [name, *(f"{100 * d.size:.0f} %, {'drifts' if d.drifts else '–'}, p {_p(d.adjusted)}" for d in each)]


def _tolerances(fleet: Consistency) -> Iterator[list[str]]:
    for name, values in sorted(fleet.shares.items(), key=lambda item: -float(np.sum(item[1]))):
        words = spaced(name).replace(".", " ")
        yield [words, f"±{100 * TOLERANCES[name].share:g} %", *(f"{100 * value:.1f} %" for value in values)]
    yield ["all together", "", *(f"{100 * value:.1f} %" for value in fleet.predicted)]


def _systems(known: Known) -> Iterator[list[str]]:
    for spread in [s for group in (known.cases, known.fragile) for each in group.values() for s in each]:
        longest, law = 100 * spread.relative, spread.propagated
        sizes = [f"{longest.min():.2g} to {longest.max():.2g} %", f"{law.nonlinearity.max():.2g}"]
        held = [f"{np.sqrt(spread.ratio):.3g}", f"{100 * spread.held:.1f} %"]
        yield [spread.case, spread.symbol, *sizes, *held, _SAYS[law.status]]


def _p(value: float) -> str:
    return "< 0.001" if value < 1e-3 else f"{value:.2g}"


CLOUD = 400  # Draws that are shown as points


def known_drawings(known: Known) -> list[Drawing]:
    """Draw the figures of the benchmark systems."""
    linear, notch = known.cases[LINEAR][0], known.fragile[NOTCH.name][0]
    return [
        _complex(linear),
        _plane(linear),
        _gain_and_phase(linear, notch),
        _higher(known.cases[BILINEAR][1:], known.surface),
        _spectra(known.spectra),
    ]


def _complex(spread: Spread) -> Drawing:
    """A real and a complex quantity, and what is known of them."""
    response, place = spread.propagated, int(np.argmax(spread.relative))
    draws, edge, middle = spread.sampled.draws[:, place], response.ellipse()[place], response.values[place]
    covariance, gain = response.covariance[place], float(response.gain[place])
    deviation, band = float(np.sqrt(response.gain_phase_covariance[place, 0, 0])), response.gain_band()
    reach = np.sqrt(np.trace(covariance) / 2) * np.abs(edge - middle).max()
    radius = reach / np.sqrt(np.linalg.eigvalsh(covariance)[-1])
    circle = middle + radius * np.exp(2j * np.pi * np.linspace(0, 1, edge.size))
    axis = gain + deviation * np.linspace(-4, 4, 121)
    density = np.exp(-0.5 * ((axis - gain) / deviation) ** 2) / (deviation * np.sqrt(2 * np.pi))
    with draw((9.6, 4.2)) as figure:
        left, right = figure.subplots(1, 2)
        left.hist(np.abs(draws), bins=60, density=True, color=Hue.MEASURED, alpha=0.5)
        left.plot(axis, density, color=Hue.AFTER)
        left.axvspan(band.low[place], band.high[place], color=Hue.AFTER, alpha=0.12, linewidth=0)
        left.set_axisbelow(True)
        left.set(xlabel=f"gain |H₁| at {response.frequency_Hz[place]:.3f} Hz", ylabel="density")
        titled(left, "a real quantity: an interval")
        right.plot(draws[:CLOUD].real, draws[:CLOUD].imag, ".", color=Hue.MEASURED, markersize=3, label="draws")
        right.plot(edge.real, edge.imag, color=Hue.AFTER, label="95 % region, propagated")
        right.plot(
            circle.real,
            circle.imag,
            "--",
            color=Hue.INK,
            linewidth=0.9,
            label="if both parts were uncorrelated, with equal variance",
        )
        right.set(xlabel="real part", ylabel="imaginary part", adjustable="datalim", aspect="equal")
        titled(right, "a complex one: an ellipse")
        legend_above(figure, right, 3)
        numbers = {"symbol": spread.symbol, "draws": len(spread.sampled.draws)}
        return WORDS.drawing(figure, "complex", case=spread.case, **numbers)


def _plane(spread: Spread) -> Drawing:
    """The first-order response in the complex plane, whole and near the resonance."""
    count, worst = spread.propagated.values.size, int(np.argmax(spread.relative))
    near = range(max(0, worst - 2), min(worst + 3, count))
    with draw((9.6, 4.6)) as figure:
        left, right = figure.subplots(1, 2)
        _regions(left, spread, range(count), 0)
        _regions(right, spread, near, CLOUD)
        titled(left, "all frequencies")
        titled(right, "near the most uncertain frequency")
        points = spread.sampled.draws[:CLOUD, near.start : near.stop]
        right.set(xlim=_padded(points.real), ylim=_padded(points.imag))
        legend_above(figure, right, 3)
        draws = len(spread.sampled.draws)
        return WORDS.drawing(figure, "plane", columns_of([spread]), case=spread.case, CLOUD=CLOUD, draws=draws)


def _gain_and_phase(linear: Spread, notch: Spread) -> Drawing:
    """Bands of gain and phase, where the linear law holds and where the gain is near zero."""
    with draw((9.6, 6.0)) as figure:
        panels = panels_of(figure, 2, 2, "frequency (Hz)", sharex="col")
        for column, spread in zip(panels.T, (linear, notch), strict=True):
            response, sampled, frequency = spread.propagated, spread.sampled, spread.propagated.frequency_Hz
            bands = (response.gain_band(), response.phase_band())
            drawn = (sampled.gain_band(), sampled.phase_band())
            both = (response.gain, response.phase_deg)
            for axes, values, band, other in zip(column, both, bands, drawn, strict=True):
                draw_between(axes, frequency, band.low, band.high, Hue.AFTER)
                axes.plot(frequency, values, color=Hue.AFTER, label="identified, 95 % band propagated")
                axes.plot(frequency, other.low, ".", color=Hue.INK, markersize=3.5, label="95 % of the draws")
                axes.plot(frequency, other.high, ".", color=Hue.INK, markersize=3.5)
                half, label = (frequency[1] - frequency[0]) / 2, "linear law fails"
                for at in frequency[~band.linear_law]:
                    axes.axvspan(at - half, at + half, color=Hue.MARK, alpha=0.2, linewidth=0, label=label)
                    label = "_"
            titled(column[0], spread.case)
            column[0].set_ylim(0, None)
        panels[0, 0].set_ylabel("gain")
        panels[1, 0].set_ylabel("phase (°)")
        legend_above(figure, panels[1, 1], 3)
        return WORDS.drawing(figure, "gain_phase", columns_of([linear, notch]))


def _higher(spreads: Sequence[Spread], surface: FrequencyResponse) -> Drawing:
    """Regions of H_2 and H_3, and H_2 over two frequencies with its relative uncertainty."""
    side = round(surface.values.size**0.5)
    axis = surface.frequency_Hz[:side, 1]
    longest = np.sqrt(np.linalg.eigvalsh(surface.covariance)[:, -1])
    maps = {
        "gain of H₂ (log₁₀)": np.log10(surface.gain),
        "standard deviation of H₂ (% of its gain)": 100 * longest / surface.gain,
    }
    with draw((9.6, 8.2)) as figure:
        above, below = figure.subplots(2, 2)
        for axes, spread in zip(above, spreads, strict=True):
            _regions(axes, spread, range(spread.propagated.values.size), CLOUD // 4)
            titled(axes, f"{spread.symbol} at equal frequencies")
        for axes, (title, values) in zip(below, maps.items(), strict=True):
            drawn = axes.contourf(axis, axis, values.reshape(side, side), levels=12, cmap="cividis")
            figure.colorbar(drawn, ax=axes)
            axes.set(xlabel="first frequency (Hz)", ylabel="second frequency (Hz)", aspect="equal")
            titled(axes, title)
            axes.grid(False)
        legend_above(figure, above[0], 3)
        return WORDS.drawing(figure, "higher_orders", columns_of(spreads), case=spreads[0].case)


def _spectra(spectra: Sequence[Spread]) -> Drawing:
    """The orders of the output of a multisine, with bands."""
    with draw((9.6, 5.6)) as figure:
        panels = panels_of(figure, 2, len(spectra), "frequency (Hz)", sharex="col", sharey="row")
        for (above, below), spread in zip(panels.T, spectra, strict=True):
            frequency, gain = spread.propagated.frequency_Hz, spread.propagated.gain
            above.plot(frequency, gain, "o", color=Hue.AFTER, markersize=3)
            above.vlines(frequency, 1e-9, gain, color=Hue.AFTER, linewidth=0.8)
            above.set(yscale="log", ylim=(1e-7, 1e-1))
            titled(above, spread.symbol)
            bands = (spread.propagated.gain_band(), spread.sampled.gain_band())
            band, drawn = ([100 * (limit / gain - 1) for limit in (one.low, one.high)] for one in bands)
            below.vlines(frequency, *band, color=Hue.AFTER, alpha=0.4, linewidth=5, label="95 % band, propagated")
            below.plot(frequency, drawn[0], "_", color=Hue.INK, markersize=6, label="95 % of the draws")
            below.plot(frequency, drawn[1], "_", color=Hue.INK, markersize=6)
        panels[0, 0].set_ylabel("amplitude")
        panels[1, 0].set_ylabel("band, about the amplitude (%)")
        legend_above(figure, panels[1, 0], 2)
        return WORDS.drawing(figure, "spectra", columns_of(spectra), case=spectra[0].case)


def _regions(axes: Axes, spread: Spread, shown: Sequence[int], cloud: int) -> None:
    """Draw a response in the complex plane with its regions, and some of the draws."""
    from matplotlib.collections import LineCollection

    places, curve = list(shown), spread.curve
    axes.plot(curve.real, curve.imag, color=Hue.INK, linewidth=0.7)
    edges, values = spread.propagated.ellipse()[places], spread.propagated.values[places]
    draws = spread.sampled.draws[:cloud, places].ravel()
    if cloud:
        axes.plot(draws.real, draws.imag, ".", color=Hue.MEASURED, markersize=2.5, label="draws")
    outlines = np.stack([edges.real, edges.imag], axis=-1)
    axes.add_collection(LineCollection(list(outlines), colors=Hue.AFTER, label="95 % region, propagated"))
    axes.plot(values.real, values.imag, ".", color=Hue.INK, markersize=3, label="identified")
    axes.autoscale_view()
    axes.set(xlabel="real part", ylabel="imaginary part")


def _padded(values: Array) -> tuple[float, float]:
    low, high = float(np.min(values)), float(np.max(values))
    return low - 0.05 * (high - low), high + 0.05 * (high - low)


MILLI = 1e3
"""Millimetres to the metre."""


def fleet_drawings(found: Consistency) -> list[Drawing]:
    """Draw the figures of the six actuators."""
    return [_responses(found), _spread(found)]


def _responses(found: Consistency) -> Drawing:
    """Gain of each order of each actuator, and how far it lies from the mean of the six."""
    count = len(next(iter(found.responses.values())))
    with draw((9.6, 6.2)) as figure:
        panels = panels_of(figure, 2, count, "output frequency (Hz)", sharex=True)
        for place, (above, below) in enumerate(panels.T):
            each = {name: responses[place] for name, responses in found.responses.items()}
            mean = MILLI * np.mean([one.gain for one in each.values()], axis=0)
            for (name, one), (colour, line) in zip(each.items(), STYLES, strict=False):
                frequency = one.frequency_Hz.reshape(one.gain.size, -1).sum(axis=1)
                band = one.gain_band()
                gains = [MILLI * values for values in (band.low, one.gain, band.high)]
                from_mean = [100 * (values / mean - 1) for values in gains]
                for axes, (low, middle, high) in ((above, gains), (below, from_mean)):
                    draw_between(axes, frequency, low, high, colour, f"_{name}", alpha=0.15)
                    axes.plot(frequency, middle, line, color=colour, linewidth=1.1, label=name)
            titled(above, f"H{SUBSCRIPTS[place + 1]} (mm/V{('', '²', '³')[place]})")
            above.set(xlim=(0, None), ylim=(0, None))
        panels[0, 0].set_ylabel("gain")
        panels[1, 0].set_ylabel("gain, from the mean of the six (%)")
        legend_above(figure, panels[0, 0], 6)
        return WORDS.drawing(figure, "fleet")


def _spread(found: Consistency) -> Drawing:
    """Standard deviation over the six, beside what the tolerances predict."""
    bars = (
        (found.predicted, Hue.INK, "predicted from the tolerances"),
        (found.spread("level"), Hue.MEASURED, "without histories, all under the same commands"),
        (found.spread("steady"), Hue.AFTER, "without histories, each under its own commands"),
        (found.spread("fleet"), Hue.BEFORE, "as recorded"),
    )
    places = np.arange(len(found.columns))
    with draw((9.6, 4.0)) as figure:
        axes = figure.add_subplot()
        for number, (values, colour, label) in enumerate(bars):
            axes.bar(places + 0.2 * (number - 1.5), 100 * values, width=0.19, color=colour, alpha=0.75, label=label)
        axes.set_xticks(places, [column_of(column, "\n") for column in found.columns])
        axes.set_ylabel("standard deviation (% of the gain)")
        axes.grid(axis="x", visible=False)
        axes.set_axisbelow(True)
        legend_above(figure, axes, 2)
        return WORDS.drawing(figure, "spread")
