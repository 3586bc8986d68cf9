"""What is done with the fleet: DC removal, frequency responses of all orders, NOFRFs, and outputs with bands."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.frequency import FrequencyResponse, frequency_grid, gfrf, output_orders
from deatwin.ident.frequency.dc import deviations
from deatwin.ident.frequency.output_responses.estimate import nofrf, nofrf_exact
from deatwin.ident.frequency.output_responses.excitation import TestSignal, design_excitation
from deatwin.ident.frequency.output_responses.powers import InputSpectrum, input_spectrum
from deatwin.ident.frequency.output_responses.result import Nofrf, NofrfWarning
from deatwin.ident.narx import NarxModel, SvbNarx
from deatwin.ident.narx.fleet.alike import (
    BAND,
    OPERATING_INPUT,
    Alike,
    Fleet,
    choose_structure,
    fit,
    linear_in_output,
)
from deatwin.ident.narx.fleet.orders import RULE
from deatwin.scenarios.frequency_analysis.benchmarks import settled
from deatwin.scenarios.frequency_analysis.removal import Removal, remove

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

SHOWN = 5
"""Of the actuators, the one that the thesis shows in full."""
ORDERS = 3
TABLED = (0.01, 0.1, 0.3, 1.0, 3.0)
"""Of H_1 in the table and in the measures, Hz; the noise ends at 1 Hz."""
FREQUENCIES = np.unique(np.concatenate([np.geomspace(0.01, 4.0, 160), TABLED]))
"""Of H_1, Hz."""
GRID = np.linspace(-1.0, 1.0, 61)
"""Of H_2, Hz."""
MOST_ORDERS = 8
"""That are summed to see whether a series ends."""
DRAWS = 400
"""Of the parameters, beside the propagated bands."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Analysed:
    """An actuator in the frequency domain."""

    alike: Alike  # Recordings and model
    removal: Removal
    first: FrequencyResponse  # H_1 at `FREQUENCIES`, and H_2 on a grid
    second: FrequencyResponse
    fitted: Nofrf  # G_1, G_2, ... by least squares over levels
    direct: tuple[FrequencyResponse, ...]
    outputs: tuple[FrequencyResponse, ...]  # Y_1, Y_2, ... under the test signal
    left: Array
    simulated: Complex  # shape (n_lines,): Spectrum of the settled free run under the test signal

    @property
    def name(self) -> str:
        """Of the actuator."""
        return self.alike.name

    @property
    def ridge(self) -> float:
        """|H_2(f, -f)| over |H_2(f, f)|, mean over 0.1 to 0.3 Hz."""
        f, gain = self.second.frequency_Hz, self.second.gain
        near = (f[:, 0] > 0.099) & (f[:, 0] < 0.301)
        on, off = (near & (np.abs(f[:, 0] + sign * f[:, 1]) < 1e-9) for sign in (1, -1))
        return float(np.mean(gain[on] / gain[off]))

    @property
    def sum_error(self) -> float:
        """Largest error of the sum of G_n U_n, over the largest line of the simulated output."""
        error = np.abs(self.fitted.output_spectrum().values - self.simulated)
        return float(error.max() / np.abs(self.simulated).max())

    @property
    def errors(self) -> Array:
        """Largest error of each G_n of least squares, over the largest gain where there is any, shape (n_orders,)."""
        pairs = zip(self.fitted.orders, self.direct, strict=False)
        return np.array([np.abs(g.values - d.values).max() / (d.gain.max() or 1.0) for g, d in pairs])


@dataclass(frozen=True, kw_only=True, eq=False)
class Side:
    """The test signal beside a piece of the record of equal length, for one actuator."""

    signal: TestSignal
    random: Array  # shape (n_samples,): Commands of the record, as deviations from the operating input, V
    designed_inputs: tuple[InputSpectrum, ...]
    random_inputs: tuple[InputSpectrum, ...]
    designed: Nofrf
    by_random: Nofrf
    direct_random: tuple[FrequencyResponse, ...]  # G_n of the record from the model


@dataclass(frozen=True, kw_only=True, eq=False)
class Sampled:
    """Orders of an output with the bands of an SVB model, propagated and drawn."""

    name: str
    model: NarxModel
    first: FrequencyResponse  # Its H_1, at the frequencies of the others'
    orders: tuple[FrequencyResponse, ...]  # Y_1, Y_2, ... under the test signal
    draws: Complex  # shape (n_draws, n_orders, n_lines): The same of models whose parameters are drawn

    def ratios(self, order: int) -> Array:
        """Standard deviation of the gain among the draws over the propagated one. Shapes: returns (n,)."""
        response = self.orders[order - 1]
        there = response.band().linear_law & (response.gain > 1e-9 * response.gain.max())
        return np.asarray(np.abs(self.draws[:, order - 1, there]).std(axis=0) / response.gain_deviation[there])


@dataclass(frozen=True, kw_only=True, eq=False)
class Rival:
    """The common structure if products of output and command are allowed, as in the story `semp-fleet`."""

    models: tuple[NarxModel, ...]
    fits: Array  # shape (n_actuators,): Of the free runs over the held-out sections, %
    first: tuple[FrequencyResponse, ...]  # H_1 of each at `FREQUENCIES`
    left: Array  # shape (n_actuators, `MOST_ORDERS`): As in `Analysed`


@dataclass(frozen=True, kw_only=True, eq=False)
class Actuators:
    """The fleet in the frequency domain."""

    fleet: Fleet  # With its common structure
    each: tuple[Analysed, ...]
    signal: TestSignal  # That all NOFRFs are of
    side: Side  # The test signal beside the record
    sampled: Sampled  # The actuator that is shown, by SVB
    rival: Rival  # Another common structure


def actuators(fleet: Fleet, rng: np.random.Generator, *, draws: int = DRAWS, jobs: int = 1) -> Actuators:
    """Analyse the fleet."""
    signal = _signal(fleet)
    shown = fleet.actuators[min(SHOWN, len(fleet.actuators)) - 1]
    return Actuators(
        fleet=fleet,
        each=tuple(_analysed(one, signal) for one in fleet.actuators),
        signal=signal,
        side=_side(shown, signal),
        sampled=_sampled(shown, fleet, signal, rng, draws),
        rival=_rival(fleet, signal, jobs),
    )


def _signal(fleet: Fleet) -> TestSignal:
    """One test signal for all, inside the commands that each model was trained on."""
    ranges = [one.model.operating for one in fleet.actuators if one.model.operating is not None]
    room = min(min(OPERATING_INPUT - float(r.input_min[0]), float(r.input_max[0]) - OPERATING_INPUT) for r in ranges)
    step = fleet.actuators[0].model.sample_time
    return design_excitation(BAND, step, amplitude=room, unit="V")


def _analysed(alike: Alike, signal: TestSignal) -> Analysed:
    model, at = alike.model, OPERATING_INPUT
    fitted = _nofrf(model, signal.values)
    return Analysed(
        alike=alike,
        removal=remove(model, alike.sections[1]),
        first=gfrf(model, 1, 2 * np.pi * FREQUENCIES, operating_input=at),
        second=gfrf(model, 2, 2 * np.pi * frequency_grid(GRID, GRID), operating_input=at),
        fitted=fitted,
        direct=_direct(model, signal.values),
        outputs=_orders(model, signal),
        left=left_by(model, _piece(alike, signal)),
        simulated=settled(deviations(model, at).model, signal.values),
    )


def _nofrf(model: NarxModel, excitation: Array) -> Nofrf:
    """By least squares; what the package warns of is in the status, and on the page."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NofrfWarning)
        return nofrf(model, excitation, ORDERS, highest=_last_order(model), operating_input=OPERATING_INPUT)


def _last_order(model: NarxModel) -> int:
    """Where the series of a model ends that is linear in its output."""
    return max(ORDERS, *(term.degree for term in model.terms))


def _direct(model: NarxModel, excitation: Array) -> tuple[FrequencyResponse, ...]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NofrfWarning)
        return tuple(nofrf_exact(model, excitation, n, operating_input=OPERATING_INPUT) for n in range(1, ORDERS + 1))


def _side(alike: Alike, signal: TestSignal) -> Side:
    model, random = alike.model, _piece(alike, signal)
    equal = signal.values * random.std() / signal.values.std()
    step = model.sample_time
    return Side(
        signal=signal,
        random=random,
        designed_inputs=tuple(input_spectrum(equal, n, step, unit="V") for n in range(1, ORDERS + 1)),
        random_inputs=tuple(input_spectrum(random, n, step, unit="V") for n in range(1, ORDERS + 1)),
        designed=_nofrf(model, signal.values),
        by_random=_nofrf(model, random),
        direct_random=_direct(model, random),
    )


def _rival(fleet: Fleet, signal: TestSignal, jobs: int) -> Rival:
    structure, _, _ = choose_structure([one.sections[0] for one in fleet.actuators], fleet.plan, RULE, jobs=jobs)
    models = tuple(fit(structure, one.sections[0]) for one in fleet.actuators)
    others = [replace(one, model=model) for one, model in zip(fleet.actuators, models, strict=True)]
    return Rival(
        models=models,
        fits=np.array([one.fit_percent for one in others]),
        first=tuple(gfrf(m, 1, 2 * np.pi * FREQUENCIES, operating_input=OPERATING_INPUT) for m in models),
        left=np.array([left_by(one.model, _piece(one, signal)) for one in others]),
    )


def _piece(alike: Alike, signal: TestSignal) -> Array:
    """A piece of the record as long as the test signal, as deviations from the operating input."""
    return np.asarray(alike.sections[0].inputs[0, : len(signal)] - OPERATING_INPUT)


def left_by(model: NarxModel, period: Array) -> Array:
    """Run a model free until it is settled, and sum the orders of its output. Shapes: `period` (n_samples,); returns
    (`MOST_ORDERS`,).
    """
    run = settled(deviations(model, OPERATING_INPUT).model, period)
    orders = output_orders(model, period, MOST_ORDERS, operating_input=OPERATING_INPUT)
    rest = run - np.cumsum([y.values for y in orders], axis=0)
    return np.asarray(np.sqrt(_power(rest) / _power(run[None])))


def _power(spectra: Complex) -> Array:
    """Of what varies: without the mean, shape (n,)."""
    return np.asarray((np.abs(spectra[:, 1:]) ** 2).sum(axis=1))


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
    return Sampled(
        name=alike.name,
        model=model,
        first=gfrf(model, 1, 2 * np.pi * FREQUENCIES, operating_input=OPERATING_INPUT),
        orders=_orders(model, signal),
        draws=np.array([[y.values for y in _orders(replace(model, theta=theta), signal)] for theta in drawn]),
    )


def _orders(model: NarxModel, signal: TestSignal) -> tuple[FrequencyResponse, ...]:
    return output_orders(model, signal.values, ORDERS, operating_input=OPERATING_INPUT)
