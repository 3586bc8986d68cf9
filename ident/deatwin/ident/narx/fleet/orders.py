"""Choose sampling time, lags and degree for a whole fleet (thesis section 4.4.2 and table B.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.fleet.records import RECORDED, Prepared, prepare
from deatwin.ident.narx.frols import Frols
from deatwin.ident.narx.preprocess import choose_orders
from deatwin.ident.narx.rules import AtMost
from deatwin.ident.narx.terms import generate_terms
from deatwin.ident.parallel import run_jobs
from deatwin.plant.arrays import Array
from deatwin.plant.fleet import fleet
from deatwin.plant.recording import Recording

Progress = Callable[[float, str], None]

CHOOSING = 0.3  # Share of the training section, at its end, on which sampling time, lags and degree are chosen
FACTORS = (2, 4, 6)
"""Multiples of the sampling time; the largest still leaves five samples up to the first minimum of the correlation."""
LAGS = tuple((output, largest) for output in (1, 2) for largest in (0, 1, 2))
"""Number of output lags, and largest input lag; input lags begin with 0."""
DEGREES = (1, 2, 3, 4, 5)  # Degrees; beyond the fifth, a polynomial follows the mean reading over command no better
RULE = AtMost(output=1)
"""The film remembers through one relaxation; affine in one past output, a free run does not diverge by its powers."""
MOST_TERMS = 25


@dataclass(frozen=True, kw_only=True, eq=False)
class Orders:
    """Free-run errors by lags and degree at one sampling time."""

    factor: int
    errors: Array  # shape (n_actuators, n_lags, n_degrees): Errors divided by the standard deviation of the reading

    @property
    def means(self) -> Array:
        """Mean error of the actuators, shape (n_lags, n_degrees)."""
        return np.asarray(self.errors.mean(axis=0))

    @property
    def least(self) -> Array:
        """Errors for the lags and degree with the smallest mean error, shape (n_actuators,)."""
        i, j = np.unravel_index(np.argmin(self.means), self.means.shape)
        return np.asarray(self.errors[:, i, j])

    @property
    def best(self) -> tuple[int, int]:
        """Positions of lags and degree with the fewest candidates, among those as good as the best."""
        places = [(int(i), int(j)) for i, j in np.argwhere(as_good(self.errors, self.least[:, None, None]))]
        return min(places, key=lambda place: (_candidates(*place), self.means[place]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """Sampling time, lags and degree for all actuators of a fleet."""

    orders: tuple[Orders, ...]
    chosen: int  # Position of the chosen sampling time in ``orders``

    @property
    def factor(self) -> int:
        """Every `factor`-th sample is kept."""
        return self.orders[self.chosen].factor

    @property
    def output_lags(self) -> int:
        """Number of output lags."""
        return LAGS[self.orders[self.chosen].best[0]][0]

    @property
    def input_lags(self) -> tuple[int, ...]:
        """Input lags, from 0 on."""
        return tuple(range(LAGS[self.orders[self.chosen].best[0]][1] + 1))

    @property
    def degree(self) -> int:
        """Degree of the candidates."""
        return DEGREES[self.orders[self.chosen].best[1]]


def prepare_fleet(seed: int, *, jobs: int = 1, progress: Progress) -> tuple[tuple[Prepared, ...], Plan]:
    """Record the fleet, and choose sections, sampling time, lags and degree."""

    def tell(first: float, last: float, count: int, doing: str) -> Callable[[int], None]:
        return lambda done: progress(first + (last - first) * done / count, doing)

    actuators = [(one,) for one in fleet(seed)]
    recording = tell(0.0, 0.8, len(actuators), "recording six actuators")
    recording(0)
    prepared = run_jobs(prepare, actuators, workers=jobs, finished=recording)
    training = [(one.split(RECORDED, factor)[0],) for factor in FACTORS for one in prepared]
    choosing = tell(0.8, 1.0, len(training), "choosing sampling time and orders")
    errors = run_jobs(order_errors, training, workers=jobs, finished=choosing)
    n = len(prepared)
    return tuple(prepared), make_plan({factor: errors[i * n : (i + 1) * n] for i, factor in enumerate(FACTORS)})


def order_errors(training: Recording) -> Array:
    """Return free-run errors on the end of a section, of models trained on its beginning, (n_lags, n_degrees)."""
    cut = training.n_samples - round(CHOOSING * training.n_samples)
    end = training.section(cut, training.n_samples)
    errors = np.empty((len(LAGS), len(DEGREES)))
    for i, (output, largest) in enumerate(LAGS):
        choice = choose_orders(
            Frols(rule=RULE, max_terms=MOST_TERMS, criterion="free_run", held_out=CHOOSING),
            training.section(0, cut),
            end,
            output_lags=[output],
            input_lags=[tuple(range(largest + 1))],
            degrees=DEGREES,
        )
        errors[i] = [trial.error for trial in choice.trials]
    return errors / float(end.outputs.std())


def make_plan(errors: Mapping[int, Sequence[Array]]) -> Plan:
    """Choose sampling time, lags and degree for the whole fleet."""
    orders = tuple(Orders(factor=factor, errors=np.array(each)) for factor, each in errors.items())
    least = min((one.least for one in orders), key=np.mean)
    near = [i for i, one in enumerate(orders) if as_good(one.least, least)]
    return Plan(orders=orders, chosen=max(near, key=lambda i: orders[i].factor))


def as_good(errors: Array, least: Array) -> NDArray[np.bool_]:
    """Return which errors are within one standard error of the smallest (Hastie et al., 2nd ed. (2009), 7.10)."""
    finite = np.isfinite(errors).all(axis=0)
    beyond = np.where(finite, errors, 0.0) - least
    good: NDArray[np.bool_] = beyond.mean(axis=0) <= beyond.std(axis=0, ddof=1) / np.sqrt(len(beyond))
    return finite & good


def _candidates(lags: int, degree: int) -> int:
    """Return the number of candidate terms for one of `LAGS` and one of `DEGREES`, by their positions."""
    output, largest = LAGS[lags]
    return len(generate_terms(output, range(largest + 1), DEGREES[degree], rule=RULE))
