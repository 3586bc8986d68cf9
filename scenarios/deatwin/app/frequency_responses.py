"""Frequency responses of a model up to an order, with all messages about them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations_with_replacement
from typing import Any

import numpy as np

from deatwin.ident.frequency import FrequencyResponse, frequency_grid, gfrf, remove_dc
from deatwin.ident.frequency.gfrf import names_of
from deatwin.ident.frequency.output_responses.estimate import nofrf
from deatwin.ident.frequency.output_responses.excitation import TestSignal, design_excitation
from deatwin.ident.frequency.output_responses.powers import output_frequencies
from deatwin.ident.frequency.output_responses.result import Nofrf, NofrfStatus, NofrfWarning
from deatwin.ident.frequency.uncertainty.propagate import Propagated, UncertaintyStatus, UncertaintyWarning, propagate
from deatwin.ident.narx import NarxModel, Reliance
from deatwin.ident.narx.excited import BAND_KEY, number_of
from deatwin.plant.amplitudes import amount
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.prefixes import range_with_unit, with_unit
from deatwin.plant.words import listed

POINTS, DECADES = 200, 3  # Number of frequencies of H_1, and decades that they span unless a band is given
SIDE, COARSE_SIDE = 41, 21  # Frequencies on each axis of a map, of orders up to three and beyond
UNKNOWN_BAND = 0.25  # Share of half the sampling rate that is used if a model does not state what its data excited
DRAWN = 0.95
UNKNOWN, ROUNDING = 0.1, 1e-9
"""UNKNOWN: share of a NOFRF's gain above which its truncation error is reported. ROUNDING: share of the output below
which a residual is rounding."""
LOWERED, MARGIN = 4, 0.9
"""LOWERED: most amplitudes of the test signal that are tried if orders beyond those fitted act. MARGIN: share of the
advised level to which the amplitude is lowered."""
TOO_LARGE = (NofrfStatus.TRUNCATED, NofrfStatus.DIVERGED)


@dataclass(frozen=True, kw_only=True, eq=False)
class Responses:
    """The frequency responses of a model, with what is known of their validity."""

    model: NarxModel
    level: float  # Probability of the bands that are written
    band_Hz: tuple[float, float]
    excited_Hz: float | None  # Frequency below which the training input has 99 % of its power; None if not stated
    gfrfs: tuple[FrequencyResponse, ...]  # by order; with several inputs, each order has one for each choice of inputs
    ranges_Hz: tuple[Array, ...]  # shape (k, 2): For each order, the ranges in which its output can have energy
    signal: TestSignal | None
    nofrfs: Nofrf | None  # None for order 1, where G_1 is H_1, and if they could not be computed
    missing: str  # Reason why the requested NOFRFs could not be computed; empty if there is none

    @property
    def first(self) -> FrequencyResponse:
        """H_1, of the first input if there are several."""
        return self.gfrfs[0]

    @property
    def linear(self) -> tuple[FrequencyResponse, ...]:
        """H_1 of each input."""
        return tuple(response for response in self.gfrfs if response.order == 1)

    @property
    def order(self) -> int:
        """Highest order."""
        return self.gfrfs[-1].order

    @property
    def about(self) -> str:
        """The operating input with its unit; if there are several, each after its name."""
        units, values = self.model.input_units, self.first.point.operating_input
        each = [amount(f"{value:.4g}", unit) for value, unit in zip(values, units, strict=True)]
        return each[0] if len(each) == 1 else ", ".join(map(" = ".join, zip(_names(self.model), each, strict=True)))

    @property
    def banded(self) -> bool:
        """True if the model has a covariance of its parameters, from which the bands of the responses follow."""
        return bool(self.model.theta_cov.any())

    @property
    def extrapolated(self) -> bool:
        """True if H_1 extends beyond the band that the training input excited."""
        return self.excited_Hz is not None and self.excited_Hz < self.first.frequency_Hz.max()

    @property
    def beyond_training(self) -> dict[int, tuple[float, float]]:
        """Training range, in the input's unit, of the inputs whose operating input lies outside it."""
        known = self.model.operating
        if known is None:
            return {}
        ranges = zip(known.input_min.tolist(), known.input_max.tolist(), strict=True)
        values = self.first.point.operating_input
        return {row: (low, high) for row, (low, high) in enumerate(ranges) if not low <= values[row] <= high}

    @cached_property
    def caveats(self) -> tuple[str, ...]:
        """Warnings in the model's file."""
        reliance = Reliance.of_provenance(self.model.provenance)
        return () if reliance is None else reliance.caveats

    @cached_property
    def laws(self) -> tuple[Propagated, ...]:
        """Propagated uncertainty of each of ``gfrfs``, with its validity."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UncertaintyWarning)  # reported among the lines
            return tuple(self._law(response) for response in self.gfrfs)

    def _law(self, response: FrequencyResponse) -> Propagated:
        return propagate(self.model, lambda _: response, level=self.level)  # already computed

    @property
    def lines(self) -> Iterator[str]:
        """All messages, one per line."""
        point, unit, names = self.first.point, self.model.input_units[0], _names(self.model)
        yield from self.caveats
        yield f"operating input {self.about}: {self.first.status.value}"
        if not self.banded:
            yield "the model has no covariance of its parameters, so its responses have no confidence bands"
        if point.outputs.size > 1:
            output_unit = self.model.output_units[0]
            others = listed(
                [
                    f"{with_unit(y, output_unit)} ({'stable' if stable else 'unstable'})"
                    for y, stable in zip(point.outputs, point.stable, strict=True)
                ]
            )
            yield (
                f"at this input the model has several equilibria, with the outputs {others}; the responses hold only for the "
                f"equilibrium with the output {with_unit(point.output, output_unit)}"
            )
        for row, (low, high) in self.beyond_training.items():
            of = f" of {names[row]}" if names else ""
            yield (
                f"the operating input{of} lies outside the range of the training inputs, "
                + range_with_unit(low, high, self.model.input_units[row])
                + ", so the responses are extrapolated"
                + (", and their bands do not include the error of extrapolation" if self.banded else "")
            )
        if self.extrapolated:
            yield (
                f"above {self.excited_Hz:.3g} Hz, the first-order response H₁ is extrapolated, because 99 % of the power of the "
                "training input lies below this frequency"
                + ("; the confidence band of H₁ does not include the error of extrapolation" if self.banded else "")
            )
        for order, bands in enumerate(self.ranges_Hz[1:], start=2):
            yield (
                f"an input from {written(self.ranges_Hz[0])} Hz causes an output of order {order} only from {written(bands)} Hz"
            )
        for response in self.gfrfs:
            share = float(np.mean(~response.band(self.level).linear_law))
            if share > 0:
                yield (
                    f"the band of {symbol_of(response)} is unreliable at {100 * share:.0f} % of the frequencies, because the gain "
                    "there is less than four times its standard deviation"
                )
        for response, law in zip(self.gfrfs, self.laws, strict=True):
            if law.status in (UncertaintyStatus.BENT, UncertaintyStatus.LOST):
                yield f"{symbol_of(response)}: {law.advice}"
        if self.nofrfs is not None and self.signal is not None:
            yield (
                f"the NOFRFs of orders 1 {'and' if self.order == 2 else 'to'} {self.order} come from a fit of "
                f"orders 1 to {self.nofrfs.highest} to the outputs for test signals of up to {amount(f'{self.signal.amplitude:.4g}', unit)} (condition number of the "
                f"fit: {self.nofrfs.condition:.3g}); {self.nofrfs.status.value}"
            )
            yield from _truncated(self.nofrfs)
        if self.missing:
            yield f"no NOFRFs were computed: {self.missing}"
        if names and self.order > 1:
            yield (
                "this command computes NOFRFs only for models with one input; for a model with several inputs, use "
                "deatwin.ident.frequency.nofrf_exact in Python"
            )

    def to_json(self) -> dict[str, Any]:
        """Return everything except the maps as plain data; with several inputs, their names and H_1 are lists."""
        point, names = self.first.point, _names(self.model)
        linear = [{"unit": response.unit, **_plain(response, self.level)} for response in self.linear]
        return {
            **({"inputs": list(names)} if names else {}),
            "operating_input": point.operating_input.tolist() if names else float(point.operating_input[0]),
            "stable": self.first.status.ok,
            "equilibria": point.outputs.tolist(),
            "order": self.order,
            "level": self.level,
            "band_Hz": list(self.band_Hz),
            "output_ranges_Hz": [bands.tolist() for bands in self.ranges_Hz],
            "caveats": list(self.caveats),
            "messages": list(self.lines),
            "nofrf": self._nofrf_json(),
            **({"responses": linear} if names else linear[0]),
        }

    def _nofrf_json(self) -> dict[str, Any] | None:
        if self.nofrfs is None or self.signal is None:
            return None
        return {
            "status": self.nofrfs.status.name.lower(),
            "amplitude": self.signal.amplitude,
            "orders_fitted": self.nofrfs.highest,
            "levels": self.nofrfs.levels.tolist(),
            "lost_levels": self.nofrfs.lost_levels.tolist(),
            "condition": _number(self.nofrfs.condition),
            "largest_residual": _number(float(self.nofrfs.residual[:, -1].max())),
        }


def respond(
    model: NarxModel,
    order: int,
    *,
    operating_input: float | Sequence[float] | None = None,
    band_Hz: tuple[float, float] | None = None,
    level: float = DRAWN,
    amplitude: float | None = None,
) -> Responses:
    """Compute the frequency responses of a model up to an order, those of several inputs for each choice of inputs."""
    names = _names(model)
    if names and amplitude is not None:
        raise ModelError(
            f"leave --amplitude out: it sets the test signal of the NOFRFs, which this command computes only for models with "
            f"one input, but this model has {len(names)} inputs"
        )
    if operating_input is not None and (count := np.size(operating_input)) != len(model.input_names):
        wanted = f"once for each of {', '.join(names)}, in this order" if names else "once"
        raise ModelError(f"--operating-input has {count} value(s): give it {wanted}")
    excited = number_of(model.provenance, BAND_KEY)
    band = _band(model, band_Hz, excited)
    low, high = (0.0, np.pi / model.sample_time) if band_Hz is None else 2 * np.pi * np.array(band)
    omega = np.geomspace(low or high / 10**DECADES, high, POINTS)
    responses = (
        gfrf(model, n, omega if n == 1 else _map(n, band), inputs=inputs, operating_input=operating_input)
        for n in range(1, order + 1)
        for inputs in (combinations_with_replacement(names, n) if names else (None,))
    )
    first = next(responses)
    first.band(level)  # raises an error for an invalid level before anything slow begins
    angular = 2 * np.pi * np.array(band)
    found = Responses(
        model=model,
        level=level,
        band_Hz=band,
        excited_Hz=excited,
        gfrfs=(first, *responses),
        signal=None,
        nofrfs=None,
        missing="",
        ranges_Hz=tuple(
            output_frequencies(angular, n, sample_time=model.sample_time) / (2 * np.pi) for n in range(1, order + 1)
        ),
    )
    return found if order == 1 or names else _with_nofrfs(found, order, operating_input, amplitude)


def first_columns(response: FrequencyResponse, level: float) -> dict[str, Array]:
    """Return the table of H_1. Shapes: returns (n,)."""
    columns = columns_of(response, level)
    law = columns.pop("linear_law")
    return {
        "frequency_Hz": response.frequency_Hz,
        **columns,
        "phase_deg": response.phase_deg,
        "phase_deviation_deg": response.phase_deviation_deg,
        "linear_law": law,
    }


def columns_of(response: FrequencyResponse, level: float) -> dict[str, Array]:
    """Return values, gain and band of a response for a table. Shapes: returns (n,)."""
    band = response.band(level)
    return {
        "real": response.values.real,
        "imaginary": response.values.imag,
        "gain": response.gain,
        "gain_low": band.low,
        "gain_high": band.high,
        "linear_law": band.linear_law.astype(np.float64),
    }


def _names(model: NarxModel) -> tuple[str, ...]:
    """Return the names of several inputs as equations write them; empty for a model with one input."""
    return names_of(model, range(len(model.input_names)))


def _with_nofrfs(
    found: Responses, order: int, operating_input: float | Sequence[float] | None, amplitude: float | None
) -> Responses:
    model = found.model
    size = _room(model, operating_input) if amplitude is None else amplitude
    if size is None:
        return replace(found, missing="the model does not state the range of its training inputs: give --amplitude")
    for _ in range(1 if amplitude is not None else LOWERED):
        signal = design_excitation(found.band_Hz, model.sample_time, amplitude=size, unit=model.input_units[0])
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", NofrfWarning)  # the status is reported elsewhere
                fitted = nofrf(model, signal, order, operating_input=operating_input)
        except ModelError as error:
            found, size = replace(found, signal=signal, nofrfs=None, missing=str(error)), size / 2
            continue
        found = replace(found, signal=signal, nofrfs=fitted, missing="")
        if fitted.status not in TOO_LARGE or not 0 < fitted.advisable_level < 1:
            break
        size *= MARGIN * fitted.advisable_level
    return found


def _room(model: NarxModel, operating_input: float | Sequence[float] | None) -> float | None:
    """Return the largest symmetric deviation of the input within the training data; None if these are unknown."""
    shifted = remove_dc(model, operating_input).operating
    if shifted is None:
        return None
    if not shifted.input_min[0] < 0 < shifted.input_max[0]:
        raise ModelError(
            f"the operating input {operating_input:g} lies outside the range of the training inputs, so no test signal around "
            "it stays inside this range: give another operating input, or set the amplitude of the test signal yourself with "
            "--amplitude (the model then extrapolates)"
        )
    return float(min(-shifted.input_min[0], shifted.input_max[0]))


def _band(model: NarxModel, given: tuple[float, float] | None, excited: float | None) -> tuple[float, float]:
    nyquist = 0.5 / model.sample_time
    if given is None:
        high = UNKNOWN_BAND * nyquist if excited is None else excited
        return 0.0, min(high, 0.999 * nyquist)
    low, high = given
    if not 0 <= low < high < nyquist:
        raise ModelError(
            f"the band is given as {low:g} to {high:g} Hz: give first the lower frequency (at least 0 Hz), then the higher one "
            f"(below half the sampling rate, {nyquist:g} Hz)"
        )
    return low, high


def _map(order: int, band: tuple[float, float]) -> Array:
    """Return a grid of the first two frequencies, of both signs, with the others fixed in the middle of the band."""
    axis = np.linspace(-band[1], band[1], SIDE if order <= 3 else COARSE_SIDE)
    held = np.full(order - 2, (band[0] + band[1]) / 2)
    grid = frequency_grid(axis, axis)
    return 2 * np.pi * np.column_stack([grid, np.broadcast_to(held, (len(grid), order - 2))])


def _truncated(found: Nofrf) -> Iterator[str]:
    """State at how many frequencies higher orders matter, unless the fit leaves only rounding errors."""
    if found.residual[:, -1].max() < ROUNDING:
        return
    for g, error in zip(found.orders[: found.order], found.truncation, strict=False):
        share = float(np.mean(error > UNKNOWN * g.gain))
        if share > 0:
            yield (
                f"at {100 * share:.0f} % of the frequencies, orders that were not fitted may cause more than "
                f"{100 * UNKNOWN:.0f} % of the gain of the NOFRF {symbol_of(g)}"
            )


def symbol_of(response: FrequencyResponse) -> str:
    """Return symbol, order and, if there are several inputs, those of a response as plain text."""
    of = f"({', '.join(response.inputs)})" if response.inputs else ""
    return f"{response.symbol}{'₀₁₂₃₄₅₆₇₈'[response.order]}{of}"


def written(bands: Array) -> str:
    """Write bands as text. Shapes: `bands` (k, 2)."""
    return ", ".join(f"{low:.3g} to {high:.3g}" for low, high in bands)


def _plain(response: FrequencyResponse, level: float) -> dict[str, list[float | None]]:
    return {name: [_number(v) for v in column] for name, column in first_columns(response, level).items()}


def _number(value: Any) -> float | None:
    """Return a number, or None if it is infinite, because JSON has no infinity."""
    return float(value) if math.isfinite(value) else None
