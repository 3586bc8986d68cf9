"""A fleet with one model structure, so that actuators can be compared term by term and frequency by frequency.

Candidates hold the past output by itself only, so the Volterra series ends at the degree. With products of output and
command, which fit a little better, the series has no end, and diverges at the size of the thesis' noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.fleet.orders import CHOOSING, Plan, Progress, as_good, prepare_fleet
from deatwin.ident.narx.fleet.records import RECORDED, Prepared, thinned
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.robust import robust
from deatwin.ident.narx.semp import Semp
from deatwin.ident.narx.terms import Rule, Term
from deatwin.ident.parallel import run_jobs
from deatwin.plant.arrays import Array
from deatwin.plant.recording import Recording

Structure = tuple[Term, ...]
OPERATING_INPUT = 2.4  # Operating point at which all actuators are compared, V: the mean of the thesis' noise
BAND = (0.0, 1.0)  # Band of the thesis' noise, Hz


@dataclass(frozen=True, kw_only=True, eq=False)
class Alike:
    """An actuator with its model, which has the common structure."""

    prepared: Prepared
    factor: int  # Every `factor`-th sample of its recordings is kept
    sections: tuple[Recording, Recording]  # Training and held-out section, thinned
    model: NarxModel

    @property
    def name(self) -> str:
        """Name of the actuator."""
        return self.prepared.name

    @property
    def fit_percent(self) -> float:
        """Fit of the free run over the held-out section, %; minus infinity if it diverges."""
        run = self.model.simulate(self.sections[1])
        return 100 * (1 - run.rms_error / float(self.sections[1].outputs.std())) if run.status.ok else -np.inf

    def whole(self, variant: str) -> Recording:
        """Return the complete recording of a variant, thinned."""
        return thinned(self.prepared.recordings[variant], self.factor)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fleet:
    """Actuators with models of one structure."""

    actuators: tuple[Alike, ...]
    plan: Plan
    structure: Structure  # Terms of all models, in the order of their parameters
    errors: Array  # shape (n_actuators,): Free-run errors of the structure, on the data on which it was chosen
    tried: int  # Number of structures from which it was chosen


def identify_fleet(seed: int, *, jobs: int = 1, progress: Progress = lambda share, text: None) -> Fleet:
    """Record the fleet, and fit one structure to each actuator."""
    prepared, plan = prepare_fleet(seed, jobs=jobs, progress=lambda share, text: progress(0.8 * share, text))
    progress(0.8, "choosing a common structure")
    return identify_alike(prepared, plan, jobs=jobs)


def identify_alike(prepared: Sequence[Prepared], plan: Plan, *, jobs: int = 1) -> Fleet:
    """Fit one structure to each of several actuators."""
    sections = [one.split(RECORDED, plan.factor) for one in prepared]
    structure, errors, tried = choose_structure([training for training, _ in sections], plan, jobs=jobs)
    actuators = tuple(
        Alike(prepared=one, factor=plan.factor, sections=both, model=fit(structure, both[0]))
        for one, both in zip(prepared, sections, strict=True)
    )
    return Fleet(actuators=actuators, plan=plan, structure=structure, errors=errors, tried=tried)


def linear_in_output(term: Term) -> bool:
    """Return whether a term contains no past output, or consists of a past output only."""
    return term.degree == 1 or not any(variable.kind == "y" for variable, _ in term.factors)


def choose_structure(
    training: Sequence[Recording], plan: Plan, rule: Rule = linear_in_output, *, jobs: int = 1
) -> tuple[Structure, Array, int]:
    """Choose the structure with the smallest free-run errors; return it, its errors, and the number tried."""
    cuts = [record.n_samples - round(CHOOSING * record.n_samples) for record in training]
    parts = [(r.section(0, cut), r.section(cut, r.n_samples)) for r, cut in zip(training, cuts, strict=True)]
    passed = run_jobs(_passed, [(beginning, plan, rule) for beginning, _ in parts], workers=jobs)
    structures = sorted({terms for each in passed for terms in each}, key=lambda s: (len(s), tuple(map(str, s))))
    errors = np.array(run_jobs(_free_run_errors, [(structures, *both) for both in parts], workers=jobs))
    least = errors[:, np.argmin(errors.mean(axis=0))]
    good = np.flatnonzero(as_good(errors, least[:, None]))
    best = min(good, key=lambda place: (len(structures[place]), errors[:, place].mean()))
    return structures[best], errors[:, best], len(structures)


def fit(structure: Sequence[Term], recording: Recording) -> NarxModel:
    """Fit a structure to a recording by least squares, with a covariance that is valid for coloured residuals."""
    return robust(Fixed(terms=tuple(structure)).fit(recording).model_, recording)


def _passed(beginning: Recording, plan: Plan, rule: Rule) -> list[Structure]:
    """Return all structures that a search visited."""
    search = Semp(output_lags=plan.output_lags, input_lags=plan.input_lags, degree=plan.degree, rule=rule)
    steps = search.fit(beginning).path_
    return [tuple(sorted(step.terms, key=lambda term: (term.degree, term.factors))) for step in steps]


def _free_run_errors(structures: Sequence[Structure], beginning: Recording, end: Recording) -> Array:
    """Return free-run errors divided by the standard deviation of the reading, shape (n_structures,)."""
    runs = [Fixed(terms=structure).fit(beginning).model_.simulate(end) for structure in structures]
    return np.array([run.rms_error if run.status.ok else np.inf for run in runs]) / float(end.outputs.std())
