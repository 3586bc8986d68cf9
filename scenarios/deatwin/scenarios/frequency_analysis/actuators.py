"""Analyse the fleet: DC removal, frequency responses of all orders, NOFRFs, outputs with bands, true responses."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np

from deatwin.ident.frequency import (
    FrequencyResponse,
    InputSpectrum,
    Nofrf,
    NofrfWarning,
    TestSignal,
    design_excitation,
    frequency_grid,
    gfrf,
    input_spectrum,
    nofrf,
    output_orders,
)
from deatwin.ident.frequency.dc import Removal, remove
from deatwin.ident.frequency.output_responses.settled import Evaluated, evaluate, left_by_orders, tone_response
from deatwin.ident.narx import NarxModel, SvbNarx, refine
from deatwin.ident.narx.fleet import (
    BAND,
    FILM,
    OPERATING_INPUT,
    RULE,
    STEADY,
    Alike,
    Fleet,
    as_variant,
    choose_structure,
    fit,
    linear_in_output,
)
from deatwin.plant.arrays import Array, Complex

SHOWN = 5  # Number of the actuator that the thesis shows in full
ORDERS = 3
TABLED = (0.01, 0.1, 0.3, 1.0, 3.0)  # Frequencies of H_1 in the measures, Hz; the noise ends at 1 Hz
FREQUENCIES = np.unique(np.concatenate([np.geomspace(0.01, 4.0, 160), TABLED]))  # Frequencies of H_1, Hz
GRID = np.linspace(-1.0, 1.0, 61)  # Frequencies of H_2 along each axis, Hz
MOST_ORDERS = 8  # Orders that are summed to see whether a series ends
DRAWS = 400  # Draws of the parameters beside the propagated bands
TONES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)  # Frequencies at which an actuator is asked for its own response, Hz
SMALL, LARGE = 0.02, 0.3  # Largest deviation of the tones from the operating input, V


@dataclass(frozen=True, kw_only=True, eq=False)
class Analysed:
    """An actuator in the frequency domain."""

    alike: Alike
    removal: Removal
    first: FrequencyResponse  # H_1 at `FREQUENCIES`, and H_2 on a grid
    second: FrequencyResponse
    nofrfs: Evaluated
    outputs: tuple[FrequencyResponse, ...]  # Y_1, Y_2, ... under the test signal
    left: Array  # shape (MOST_ORDERS,): share of the free run that the orders leave under a piece of the record

    @property
    def name(self) -> str:
        """Name of the actuator."""
        return self.alike.name

    @property
    def ridge(self) -> float:
        """|H_2(f, -f)| over |H_2(f, f)|, mean over 0.1 to 0.3 Hz."""
        f, gain = self.second.frequency_Hz, self.second.gain
        near = (f[:, 0] > 0.099) & (f[:, 0] < 0.301)
        on, off = (near & (np.abs(f[:, 0] + sign * f[:, 1]) < 1e-9) for sign in (1, -1))
        return float(np.mean(gain[on] / gain[off]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """The test signal, and an equally long piece of the record, for one actuator."""

    random: Array  # shape (n_samples,): commands of the record, as deviations from the operating input, V
    designed_inputs: tuple[InputSpectrum, ...]
    random_inputs: tuple[InputSpectrum, ...]
    designed: Nofrf
    by_random: Nofrf


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """Orders of an output with the bands of an SVB model, propagated and drawn."""

    model: NarxModel
    orders: tuple[FrequencyResponse, ...]  # Y_1, Y_2, ... under the test signal
    draws: Complex  # shape (n_draws, n_orders, n_lines): those of models whose parameters are drawn

    def ratios(self, order: int) -> Array:
        """Standard deviation of the gain among the draws over the propagated one. Shapes: returns (n,)."""
        response = self.orders[order - 1]
        there = response.band().linear_law & (response.gain > 1e-9 * response.gain.max())
        return np.asarray(np.abs(self.draws[:, order - 1, there]).std(axis=0) / response.gain_deviation[there])


@dataclass(frozen=True, kw_only=True, eq=False)
class Alternative:
    """The common structure if products of output and command are allowed, as in the story `semp-fleet`."""

    models: tuple[NarxModel, ...]
    fits: Array  # shape (n_actuators,): fits of the free runs over the held-out sections, %
    first: tuple[FrequencyResponse, ...]  # H_1 of each at `FREQUENCIES`
    left: Array  # shape (n_actuators, MOST_ORDERS): as in `Analysed`


@dataclass(frozen=True, kw_only=True, eq=False)
class Anchor:
    """First-order responses of an actuator and of its models at the operating input."""

    name: str
    frequency_Hz: Array  # shape (n,)
    film: Complex  # shape (n,): of the bare film for small commands, m/V
    small: Complex  # shape (n,): with hysteresis, for small and for large commands, m/V
    large: Complex
    least_squares: FrequencyResponse
    refined: FrequencyResponse
    recorded: FrequencyResponse  # H_1 of the actuator's model

    def error(self, response: FrequencyResponse) -> float:
        """Largest relative error of a gain, compared with the film without any effect."""
        return float(np.abs(response.gain / np.abs(self.film) - 1).max())


@dataclass(frozen=True, kw_only=True, eq=False)
class Actuators:
    """Frequency responses of the six actuators."""

    fleet: Fleet
    each: tuple[Analysed, ...]
    signal: TestSignal  # The same for all NOFRFs
    side: Side
    sampled: Sampled  # The actuator that is shown, by SVB
    alternative: Alternative

    @property
    def shown(self) -> Analysed:
        """The actuator that is shown in full."""
        return self.each[min(SHOWN, len(self.each)) - 1]


def actuators(fleet: Fleet, rng: np.random.Generator, *, draws: int = DRAWS, jobs: int = 1) -> Actuators:
    """Compute the frequency responses of the six actuators."""
    signal = _signal(fleet)
    shown = fleet.actuators[min(SHOWN, len(fleet.actuators)) - 1]
    return Actuators(
        fleet=fleet,
        each=tuple(_analysed(one, signal) for one in fleet.actuators),
        signal=signal,
        side=_side(shown, signal),
        sampled=_sampled(shown, fleet, signal, rng, draws),
        alternative=_alternative(fleet, signal, jobs),
    )


def anchor(alike: Alike, fleet: Fleet, frequency_Hz: tuple[float, ...] = TONES) -> Anchor:
    """Measure the true response of a simulated actuator."""
    film, gripped = (as_variant(alike.prepared.actuator, variant).plant for variant in (FILM, STEADY))
    record = alike.whole(FILM)
    found = fit(fleet.structure, record)
    models = {"least_squares": found, "refined": refine(found, record), "recorded": alike.model}
    return Anchor(
        name=alike.name,
        frequency_Hz=np.array(frequency_Hz),
        film=tone_response(film, frequency_Hz, SMALL, OPERATING_INPUT),
        small=tone_response(gripped, frequency_Hz, SMALL, OPERATING_INPUT),
        large=tone_response(gripped, frequency_Hz, LARGE, OPERATING_INPUT),
        **{name: _first(model, np.array(frequency_Hz)) for name, model in models.items()},
    )


def _signal(fleet: Fleet) -> TestSignal:
    """Return one test signal for all actuators, within the training commands of each model."""
    ranges = [one.model.operating for one in fleet.actuators if one.model.operating is not None]
    room = min(min(OPERATING_INPUT - float(r.input_min[0]), float(r.input_max[0]) - OPERATING_INPUT) for r in ranges)
    return design_excitation(BAND, fleet.actuators[0].model.sample_time, amplitude=room, unit="V")


def _analysed(alike: Alike, signal: TestSignal) -> Analysed:
    model = alike.model
    return Analysed(
        alike=alike,
        removal=remove(model, alike.sections[1]),
        first=_first(model, FREQUENCIES),
        second=gfrf(model, 2, 2 * np.pi * frequency_grid(GRID, GRID), operating_input=OPERATING_INPUT),
        nofrfs=evaluate(model, signal, _nofrf(model, signal.values), ORDERS, OPERATING_INPUT),
        outputs=_orders(model, signal),
        left=left_by_orders(model, _piece(alike, signal), MOST_ORDERS, OPERATING_INPUT),
    )


def _first(model: NarxModel, frequency_Hz: Array) -> FrequencyResponse:
    return gfrf(model, 1, 2 * np.pi * frequency_Hz, operating_input=OPERATING_INPUT)


def _nofrf(model: NarxModel, excitation: Array) -> Nofrf:
    """Estimate NOFRFs by least squares; the package's warnings appear in the status and on the page."""
    highest = max(ORDERS, *(term.degree for term in model.terms))  # the series of such a model ends there
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NofrfWarning)
        return nofrf(model, excitation, ORDERS, highest=highest, operating_input=OPERATING_INPUT)


def _side(alike: Alike, signal: TestSignal) -> Side:
    model, random = alike.model, _piece(alike, signal)
    equal = signal.values * random.std() / signal.values.std()
    designed_inputs, random_inputs = (
        tuple(input_spectrum(values, n, model.sample_time, unit="V") for n in range(1, ORDERS + 1))
        for values in (equal, random)
    )
    return Side(
        random=random,
        designed_inputs=designed_inputs,
        random_inputs=random_inputs,
        designed=_nofrf(model, signal.values),
        by_random=_nofrf(model, random),
    )


def _alternative(fleet: Fleet, signal: TestSignal, jobs: int) -> Alternative:
    structure, _, _ = choose_structure([one.sections[0] for one in fleet.actuators], fleet.plan, RULE, jobs=jobs)
    others = [replace(one, model=fit(structure, one.sections[0])) for one in fleet.actuators]
    left = [left_by_orders(one.model, _piece(one, signal), MOST_ORDERS, OPERATING_INPUT) for one in others]
    return Alternative(
        models=tuple(one.model for one in others),
        fits=np.array([one.fit_percent for one in others]),
        first=tuple(_first(one.model, FREQUENCIES) for one in others),
        left=np.array(left),
    )


def _piece(alike: Alike, signal: TestSignal) -> Array:
    """A piece of the record as long as the test signal, as deviations from the operating input."""
    return np.asarray(alike.sections[0].inputs[0, : len(signal)] - OPERATING_INPUT)


def _sampled(alike: Alike, fleet: Fleet, signal: TestSignal, rng: np.random.Generator, draws: int) -> Sampled:
    plan = fleet.plan
    search = SvbNarx(
        output_lags=plan.output_lags,
        input_lags=plan.input_lags,
        degree=plan.degree,
        rule=linear_in_output,
        clean_up="none",
    )
    model = search.fit(alike.sections[0]).model_
    drawn = rng.multivariate_normal(model.theta, model.theta_cov, size=draws, method="cholesky")
    of_draws = [[y.values for y in _orders(replace(model, theta=theta), signal)] for theta in drawn]
    return Sampled(model=model, orders=_orders(model, signal), draws=np.array(of_draws))


def _orders(model: NarxModel, signal: TestSignal) -> tuple[FrequencyResponse, ...]:
    return output_orders(model, signal.values, ORDERS, operating_input=OPERATING_INPUT)
