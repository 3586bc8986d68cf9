"""Write the files of `deatwin frequency`: tables, figures and a page."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from deatwin.app.frequency_responses import Responses, columns_of, first_columns, symbol_of, written
from deatwin.ident.frequency import FrequencyResponse
from deatwin.ident.frequency.drawing import bode
from deatwin.ident.frequency.output_responses.excitation import TestSignal
from deatwin.ident.frequency.output_responses.powers import AMPLIFICATION
from deatwin.ident.frequency.output_responses.result import Nofrf, NofrfStatus
from deatwin.ident.narx import Reliance, ValidationStatus
from deatwin.plant.arrays import Array
from deatwin.plant.drawing import Figure
from deatwin.plant.prefixes import prefixed
from deatwin.plant.words import as_sentence
from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.drawing import COLOURS, Drawing, draw, standalone
from deatwin.studies.report.story import Measure, Note, StoryPage, Table, write_story

USE = "use the responses at this operating point"
MISSED = (
    "identify a better model, or record longer, before you rely on these responses; the table below shows which goals are "
    "missed."
)
IN_ITS_UNIT = ("real", "imaginary", "gain", "gain_low", "gain_high", "truncation")
"""Columns in the unit of the response."""


def write_responses(found: Responses, folder: ResultFolder, record: RunRecord | None = None) -> None:
    """Write tables, figures and the report."""
    for response in found.gfrfs:
        if response.order == 1:
            columns = _with_unit(first_columns(response, found.level), response.unit)
        else:
            columns = {f"f{i}_Hz": column for i, column in enumerate(response.frequency_Hz.T, start=1)}
            columns |= _with_unit(columns_of(response, found.level), response.unit)
        folder.csv(f"figures/{_stem(response)}.csv", columns)
    if found.nofrfs is not None and found.signal is not None:
        for response, error in _fitted(found.nofrfs):
            folder.csv(f"figures/nofrf{response.order}.csv", _nofrf_columns(response, error, found.level))
        folder.csv("figures/test_signal.csv", _signal_columns(found, found.signal))
    drawings = list(_drawings(found, folder))
    write_story(folder, _page(found, drawings), record or RunRecord(command=(), inputs=(), seed=0, jobs=1))


def _stem(response: FrequencyResponse) -> str:
    """Return the name of the files of a response, which holds its inputs if the model has several."""
    first = "frequency" if response.order == 1 else f"gfrf{response.order}"
    return "_".join([first, *response.inputs])


def _fitted(found: Nofrf) -> Iterator[tuple[FrequencyResponse, Array]]:
    """Return the requested orders with their truncation errors."""
    return zip(found.orders[: found.order], found.truncation, strict=False)


def _nofrf_columns(response: FrequencyResponse, truncation: Array, level: float) -> dict[str, Array]:
    columns = {**columns_of(response, level), "truncation": truncation}
    return {"frequency_Hz": response.frequency_Hz, **_with_unit(columns, response.unit)}


def _signal_columns(found: Responses, signal: TestSignal) -> dict[str, NDArray[np.floating]]:
    point = float(found.first.point.operating_input[0])
    suffix = _suffix(found.model.input_units[0])
    return {
        "time_s": np.arange(len(signal)) * signal.sample_time,
        f"deviation{suffix}": signal.values,
        f"input{suffix}": point + signal.values,
    }


def _with_unit(columns: Mapping[str, Array], unit: str) -> dict[str, Array]:
    """Return columns of a response with its unit in the headers, such as ``gain_um_per_V2``."""
    return {f"{name}{_suffix(unit)}" if name in IN_ITS_UNIT else name: values for name, values in columns.items()}


def _suffix(unit: str) -> str:
    """Return the end of a header; empty without a unit."""
    above, *below = re.sub(r"\(([^()/]*)\)", r"\1", unit).replace(" ", "_").split("/")
    divided = [part.replace("^", "") for part in below if not re.fullmatch(r"1(\^\d+)?", part)]
    parts = [*([] if above in ("", "1") else [above]), *(f"per_{part}" for part in divided)]
    return "".join(f"_{part}" for part in parts)


def _drawings(found: Responses, folder: ResultFolder) -> Iterator[Drawing]:
    """Draw each figure, for the page and as a file."""
    at = f"The operating input is {found.about}"
    for response in found.linear:
        with draw((7.4, 5.2)) as figure:
            panels = figure.subplots(2, 1, sharex=True)
            bode(_for_reading(response)[0], panels)
            caption = f"Gain and phase{_bands(found)}. {at}.{_hatching(response)}"
            if found.excited_Hz is not None and found.extrapolated:
                caption += (
                    f" The model extrapolates in the grey range, above {found.excited_Hz:.3g} Hz, where only 1 % of the power "
                    "of the training input lies."
                )
                for axes in panels:
                    axes.axvspan(
                        found.excited_Hz,
                        response.frequency_Hz.max(),
                        color=COLOURS["measured"][0],
                        alpha=0.12,
                        linewidth=0,
                    )
            title = "First-order frequency response" + "".join(f" to {name}" for name in response.inputs)
            yield _drawn(figure, folder, _stem(response), title, caption)
    for response in found.gfrfs[len(found.linear) :]:
        title = f"Frequency response {symbol_of(response)} of order {response.order} over two frequencies"
        others = "" if response.order == 2 else ", with the other frequencies in the middle of the band"
        caption = f"Gain in dB over two frequencies of the input, f₁ and f₂{others}. {at}.{_hatching(response)}"
        if len(set(response.inputs)) > 1:
            caption += f" Cross kernel: the frequencies are those of {', '.join(response.inputs)}, in this order."
        with draw((6.4, 4.8)) as figure:
            axes = _for_reading(response)[0].plot(figure.add_subplot())
            axes.set_aspect("equal")
            axes.grid(False)
            yield _drawn(figure, folder, _stem(response), title, caption)
    if found.nofrfs is not None and found.signal is not None:
        with draw((7.4, 0.8 + 2.2 * found.nofrfs.order)) as figure:
            panels = list(figure.subplots(found.nofrfs.order, 1, sharex=True))
            for axes in _orders_for_reading(found.nofrfs).plot_orders(panels):
                for error in axes.get_lines()[1:]:
                    error.set_color(COLOURS["measured"][0])  # the library's own colour does not suit dark mode
                axes.legend(markerscale=1)
            bands = _bands(found, ", ")
            data, *further = [f"figures/nofrf{response.order}.csv" for response, _ in _fitted(found.nofrfs)]
            caption = (
                f"Gains of the NOFRFs for a test signal from {written(found.ranges_Hz[0])} Hz{bands}. {at}."
                f"{_hatching(*found.nofrfs.orders[: found.nofrfs.order])} The dotted truncation error is the "
                "largest error that higher orders may cause. Where this error is as large as the gain, the gain is unknown."
            )
            drawing = _drawn(figure, folder, "nofrf", "Nonlinear output frequency responses (NOFRFs)", caption)
            yield replace(drawing, data=data, further=tuple(further))
        with draw((7.4, 2.8)) as figure:
            axes = found.signal.plot(figure.add_subplot())
            axes.set_ylabel(f"deviation of the {axes.get_ylabel()}")
            caption = "One period of the test signal for the NOFRFs, as the deviation from the operating input."
            yield _drawn(figure, folder, "test_signal", "Test signal", caption)


def _drawn(figure: Figure, folder: ResultFolder, name: str, title: str, caption: str) -> Drawing:
    folder.text(f"figures/{name}.svg", standalone(figure))
    return Drawing.of(figure, name, title, caption)


def _bands(found: Responses, before: str = " ") -> str:
    """Say that a figure has bands, if it has."""
    return f"{before}with 95 % bands" if found.banded else ""


def _hatching(*responses: FrequencyResponse) -> str:
    """Explain hatched areas, if there are any."""
    if all(response.band().linear_law.all() for response in responses):
        return ""
    return " In hatched areas, the gain is less than four times its standard deviation, so the band is unreliable."


def _for_reading(response: FrequencyResponse) -> tuple[FrequencyResponse, float]:
    """Return a response in a unit with a suitable prefix, such as µm/V, and the SI size of this unit."""
    above, _, below = response.unit.partition("/")
    largest = float(response.gain.max(initial=0.0, where=np.isfinite(response.gain)))
    size, unit = (1.0, response.unit) if below.strip("(").startswith(above) else prefixed(largest, response.unit)
    shown = replace(
        response,
        values=response.values / size,
        unit=unit,
        differentiate=lambda: response.gradient / size,
        evaluate=None,
    )
    return shown, size


def _orders_for_reading(found: Nofrf) -> Nofrf:
    shown = [_for_reading(response) for response in found.orders]
    truncation = tuple(error / size for error, (_, size) in zip(found.truncation, shown, strict=True))
    return replace(found, orders=tuple(response for response, _ in shown), truncation=truncation)


def _page(found: Responses, drawings: list[Drawing]) -> StoryPage:
    messages = [line for line in found.lines if line not in found.caveats]
    orders = {1: "order 1", 2: "orders 1 and 2"}.get(found.order, f"orders 1 to {found.order}")
    ranges = Table(
        title=f"Output frequencies of each order, for an input from {written(found.ranges_Hz[0])} Hz",
        columns=["order", "frequencies (Hz)"],
        rows=[[str(n), written(bands)] for n, bands in enumerate(found.ranges_Hz, start=1)],
    )
    rows = _rows(found)
    design = ", for example to design a controller (`deatwin check`)" if len(found.model.input_names) == 1 else ""
    return StoryPage(
        title="frequency",
        sentence=f"Frequency responses of {orders} were computed at an operating input of {found.about}; {found.first.status.value}.",
        caveats=[as_sentence(text) for text in found.caveats],
        rows=rows,
        notes=[Note(title="Notes", paragraphs=[as_sentence(text) for text in messages])],
        figures=drawings,
        tables=[ranges],
        next=f"{USE}{design}." if all(row.passed for row in rows) else MISSED,
    )


_UNTESTED: Mapping[ValidationStatus | None, str] = {
    None: "not tested",
    ValidationStatus.DIVERGED: "the free run diverged",
    ValidationStatus.UNSTABLE: "the model is unstable",
}
"""Why the residual tests have no result."""


def _reliance(known: Reliance) -> Measure:
    """Name the residual tests that failed on held-out data, and the other caveats."""
    count = len(known.failed)
    tests = f"{count} failed test{'s' if count > 1 else ''} ({', '.join(known.failed)})" if count else ""
    found = [
        _UNTESTED.get(known.status, tests),
        "a biased gain" if known.biased else "",
        "the remarks above" if known.remarks else "",
    ]
    return Measure(
        "problems of the model on held-out data (failed residual tests, biased gain, remarks)",
        "none",
        ", ".join(filter(None, found)) or ("residual tests, as stated above" if known.caveats else "none"),
        not known.caveats,
    )


def _rows(found: Responses) -> list[Measure]:
    """List what readers must know before they rely on a response."""
    poles = "stable" if found.first.status.ok else "unstable"
    rows = [Measure(measure="operating point", demanded="stable", reached=poles, passed=found.first.status.ok)]
    if (known := Reliance.of_provenance(found.model.provenance)) is not None:
        rows.append(_reliance(known))
    for response in found.gfrfs if found.banded else ():
        share = float(np.mean(response.band(found.level).linear_law))
        rows.append(
            Measure(
                f"share of frequencies at which the gain of {symbol_of(response)} exceeds four times its standard deviation",
                "all",
                f"{100 * share:.0f} %",
                share == 1.0,
            )
        )
    if found.missing:
        rows.append(Measure("NOFRFs (nonlinear output frequency responses)", "computed", found.missing, False))
    if found.nofrfs is not None:
        fitted = found.nofrfs
        grown = max(u.largest_amplification for u in fitted.inputs[: fitted.order])
        left = float(fitted.residual[:, -1].max())
        rows += [
            Measure(
                "factor by which errors of the NOFRFs grow where contributions to the input spectra Uₙ cancel",
                f"at most {AMPLIFICATION:g}",
                f"{grown:.3g}",
                grown <= AMPLIFICATION,
            ),
            Measure(
                f"share of the output that a fit of {fitted.highest} orders at {fitted.levels.size} amplitudes of the test "
                "signal does not explain",
                "below 1 %",
                f"{100 * left:.2g} %",
                left < 0.01,
            ),
            Measure(
                measure="choice of the test signal and of the number of orders",
                demanded=NofrfStatus.OK.value,
                reached=fitted.status.value,
                passed=fitted.status.ok,
            ),
        ]
    return rows
