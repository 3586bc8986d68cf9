"""The methods of the study, and its draws: what each method finds in a recording of a system whose equation is known."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from deatwin.ident.narx import (
    FitStatus,
    Fixed,
    Frols,
    Lasso,
    Narmax,
    NarxIdentifier,
    NarxModel,
    Semp,
    SvbNarx,
    ThetaPosterior,
)
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.spike_slab import (
    Margin,
    SpikeSlab,
    Structures,
    fit_variational,
    fit_with_noise,
    full_margin,
    near_margin,
    sample_structures,
)
from deatwin.ident.narx.systems import SYSTEMS, BenchmarkSystem, Draw
from deatwin.plant import DeatwinError, Recording
from deatwin.plant.arrays import Array, Booleans
from deatwin.plant.records import UNBOUNDED
from deatwin.studies.rates import LEVEL, Rate

VARIATIONAL = "variational Bayes"


@dataclass(frozen=True)
class Method:
    """A way to choose the structure."""

    label: str
    make: Callable[..., NarxIdentifier]  # Takes the arguments of an identifier
    effort: tuple[float, float]  # Seconds for a draw of a small and of a large system, about
    told: bool = False  # True if it knows the number of terms

    def for_system(self, system: BenchmarkSystem) -> NarxIdentifier:
        """Make the identifier for a system: it knows lags and degree."""
        given: dict[str, Any] = {"max_terms": len(system.terms)} if self.told else {}
        lags = {"output_lags": system.output_lags, "input_lags": system.input_lags}
        return self.make(**lags, degree=system.degree, **given)


METHODS: Mapping[str, Method] = {
    "fro": Method("FROLS", Frols, (0.004, 0.013)),
    "fro-told": Method("FROLS, told the number", partial(Frols, criterion="none"), (0.004, 0.013), told=True),
    "lasso": Method("LASSO", Lasso, (0.12, 0.13)),
    "semp": Method("SEMP", Semp, (0.015, 0.05)),
    "svb": Method("SVB", partial(SvbNarx, clean_up="none"), (0.06, 0.85)),
    "svb-clean": Method("SVB with clean-up", partial(SvbNarx, clean_up="evidence"), (0.06, 0.85)),
}


ESTIMATORS: Mapping[str, Callable[[BenchmarkSystem, Recording], NarxModel]] = {
    "least squares": lambda system, record: Fixed(terms=system.terms).fit(record).model_,
    VARIATIONAL: lambda system, record: fit_variational(system.terms, record),
    "least prediction error, true noise terms": lambda system, record: fit_with_noise(
        system.terms, system.noise_terms, record
    ),
    "least prediction error, chosen noise terms": lambda system, record: (
        Narmax(Fixed(terms=system.terms)).fit(record).model_
    ),
}
"""Estimators of the parameters of a known structure."""


FLIPS, BURN_IN, DRAWS = 20_000, 2_000, 20_000
"""Flips of each chain of the sampler, flips before them, and parameters that are drawn at its end."""


@dataclass(frozen=True, kw_only=True)
class Trial:
    """The structure that a method found in a draw."""

    system: str
    method: str
    number: int  # Number of the draw
    redraws: int  # Runs that diverged before it
    terms: tuple[str, ...]  # Terms that were kept; none if the method failed
    theta: tuple[float, ...]  # Parameters of the kept terms
    low: tuple[float, ...]  # Ends of the parameters' 95 % intervals
    high: tuple[float, ...]
    missed: int  # True terms that were not kept
    false: int  # False terms that were kept
    seconds: float  # Processor time of the fit
    failure: str = ""  # Error of the method

    @property
    def kept(self) -> bool:
        """True if every true term was kept."""
        return self.missed == 0

    @property
    def exact(self) -> bool:
        """True if the terms are exactly the true ones."""
        return self.missed == self.false == 0


def system_of(name: str, noise_variance: float | None = None) -> BenchmarkSystem:
    """Return a benchmark system, with other noise if wanted."""
    system = SYSTEMS[name]
    return system if noise_variance is None else replace(system, noise_std=noise_variance**0.5)


def draw_of(system: BenchmarkSystem, seed: int, number: int) -> Draw:
    """Make a draw; it depends only on its own numbers."""
    place = list(SYSTEMS).index(system.name)
    return system.draw(np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(place, number))))


def covered(name: str, estimator: str, seed: int, number: int, noise_variance: float | None = None) -> Booleans:
    """Return which intervals contain the true parameter, if the structure is right. Shapes: returns (n_terms,)."""
    system = system_of(name, noise_variance)
    model = ESTIMATORS[estimator](system, draw_of(system, seed, number).recording)
    low, high = ThetaPosterior(model=model).interval(LEVEL).T
    places = [model.terms.index(term) for term in system.terms]
    return (low[places] <= system.theta) & (system.theta <= high[places])


def try_out(name: str, method: str, seed: int, number: int, noise_variance: float | None = None) -> Trial:
    """Let a method identify a draw."""
    system = system_of(name, noise_variance)
    draw = draw_of(system, seed, number)
    identifier = METHODS[method].for_system(system)
    begin = time.process_time()
    try:
        model, failure = identifier.fit(draw.recording).model_, ""
    except DeatwinError as error:
        model, failure = None, str(error)
    seconds = time.process_time() - begin
    if not failure and identifier.status_ is FitStatus.INTERRUPTED:
        raise KeyboardInterrupt  # the method has kept its best so far, which is no result of the study
    terms = () if model is None else model.terms
    low, high = ((), ()) if model is None else map(tuple, ThetaPosterior(model=model).interval(LEVEL).T.tolist())
    return Trial(
        system=name,
        method=method,
        number=number,
        redraws=draw.redraws,
        terms=tuple(map(str, terms)),
        theta=() if model is None else tuple(model.theta.tolist()),
        low=low,
        high=high,
        missed=len(set(system.terms) - set(terms)),
        false=len(set(terms) - set(system.terms)),
        seconds=seconds,
        failure=failure,
    )


@dataclass(frozen=True, kw_only=True)
class Contrast:
    """Margins by which the true terms of a draw stand out."""

    full: Margin  # In least squares on all candidates
    near: Margin  # Among the neighbours of the true terms
    redraws: int  # Runs that diverged before the draw
    snr_db: float  # Variance of the output over that of e(k), dB
    condition: float = field(metadata=UNBOUNDED)  # Condition number of the candidates, each scaled to length 1


@dataclass(frozen=True, kw_only=True)
class Oracle:
    """The best threshold of a system, and what is reached by it."""

    threshold: float
    exact: Rate
    kept: Rate


def contrast(name: str, seed: int, number: int) -> Contrast:
    """Compare true and false terms of a draw."""
    system = system_of(name)
    draw = draw_of(system, seed, number)
    data = _candidates(system, draw)
    true = np.array([data.table.terms.index(term) for term in system.terms])
    rows, target = data.matrix()
    ratio = draw.recording.outputs.var() / system.noise_std**2
    return Contrast(
        full=full_margin(rows, target, true),
        near=near_margin(rows, target, true),
        redraws=draw.redraws,
        snr_db=10 * float(np.log10(ratio)),
        condition=float(np.linalg.cond(rows / np.linalg.norm(rows, axis=1)[:, None])),
    )


def _candidates(system: BenchmarkSystem, draw: Draw) -> Regression:
    output_lags, input_lags = system.output_lags, system.input_lags
    return Regression.of(draw.recording, output_lags=output_lags, input_lags=input_lags, degree=system.degree)


def consult(margins: Sequence[Margin]) -> Oracle:
    """Choose the smallest threshold with which most draws of a system are identified exactly."""
    true = np.array([margin.true for margin in margins])
    false = np.array([margin.false for margin in margins])
    # A draw comes out right if false <= threshold < true, so that one of the lower ends is best of all thresholds.
    thresholds = np.sort(false)
    exact = [(false <= threshold) & (threshold < true) for threshold in thresholds]
    best = int(np.argmax([flags.sum() for flags in exact]))
    return Oracle(threshold=float(thresholds[best]), exact=Rate.of(exact[best]), kept=Rate.of(true > thresholds[best]))


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """A draw by a sampler of structures and by variational Bayes."""

    sampled: tuple[str, ...]  # Terms that a chain finds more likely in than out
    chosen: tuple[str, ...]  # Terms that variational Bayes keeps
    mass: Array  # shape (common,): Sampler's probability of its 95 % intervals of the terms that both keep
    mass_given: Array  # shape (common,): The same given the chosen structure
    unsettled: float  # Largest difference of a term's probability between two chains with other starts

    @property
    def agrees(self) -> bool:
        """True if both keep the same terms."""
        return set(self.sampled) == set(self.chosen)


def compare(name: str, method: str, seed: int, number: int) -> Comparison:
    """Sample the structures of a draw, and let a method choose one."""
    system = system_of(name)
    trial = try_out(name, method, seed, number)
    rng = np.random.default_rng([seed, number])
    draw = draw_of(system, seed, number)
    data = _candidates(system, draw)
    posterior = SpikeSlab(data=data.statistics())
    found = sample_structures(posterior, rng, flips=FLIPS, burn_in=BURN_IN)
    crowd = frozenset(rng.choice(posterior.n_terms, 20, replace=False).tolist())
    other = sample_structures(posterior, rng, flips=FLIPS, burn_in=BURN_IN, start=crowd)
    terms = tuple(map(str, data.table.terms))
    sampled = tuple(terms[i] for i in sorted(found.median))
    common = [term for term in trial.terms if term in sampled]
    kept, places = [trial.terms.index(term) for term in common], [terms.index(term) for term in common]
    low, high = np.array(trial.low)[kept], np.array(trial.high)[kept]
    scales = data.term_scales[places]
    averaged = found.parameters(posterior, DRAWS, rng)[:, places] * scales
    alone = Structures(inclusion=found.inclusion, weights={frozenset(terms.index(t) for t in trial.terms): 1.0})
    given = alone.parameters(posterior, DRAWS, rng)[:, places] * scales
    return Comparison(
        sampled=sampled,
        chosen=trial.terms,
        mass=_mass(averaged, low, high),
        mass_given=_mass(given, low, high),
        unsettled=float(np.abs(found.inclusion - other.inclusion).max()),
    )


def _mass(theta: Array, low: Array, high: Array) -> Array:
    """Return the share of the draws, with the term in, that lies in each interval."""
    there = theta != 0
    inside = np.sum(there & (low <= theta) & (theta <= high), axis=0)
    return np.asarray(inside / np.sum(there, axis=0), dtype=np.float64)
