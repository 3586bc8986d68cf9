"""Decision on the best explanation, and on the alternatives that the recordings cannot rule out."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from deatwin.ident.mismatch.advise.distance import STEPS, separation
from deatwin.ident.mismatch.naming.candidate import Candidate, Distance
from deatwin.ident.mismatch.naming.datasets import naming_tables
from deatwin.ident.mismatch.naming.drawing import draw_naming
from deatwin.ident.mismatch.naming.evidence_ratio import advantage, likeliest
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.thresholds import CREDIBLE, DISTINGUISHED, MOST, STRONG
from deatwin.ident.parallel import run_jobs
from deatwin.plant.datasets import Described, Metadata, attribute, several

if TYPE_CHECKING:
    from matplotlib.axes import Axes


Distances = dict[tuple[object, ...], tuple[tuple[Any, ...], float]]
"""Known distances by the ids of both fits, noise and steps; the arguments are stored, so that the ids stay valid."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Naming(Described):
    """Candidates that were tried, and the choice among them.

    Parameters
    ----------
    candidates : tuple of Candidate
        All candidates that could be fitted, in the order of trial; the base plant first.
    best : Candidate or None
        Best explanation; None if no candidate explains the recordings.
    alternatives : tuple of Candidate
        Alternative explanations that the recordings cannot rule out.
    probabilities : mapping of tuple of str to float
        Probability of each candidate that has as many effects as the best one, from its evidence. The keys are the
        effects. An alternative whose evidence cannot be compared with that of the best candidate has the probability of
        the best candidate.
    noise : float
        Standard deviation of the sensor noise with which the residuals are compared, SI.
    distances : tuple of Distance
        Distances from the best explanation to other candidates.
    failed : tuple of str
        Effects and sets of effects that could not be fitted because the simulation failed. This is no evidence against
        them.
    """

    candidates: tuple[Candidate, ...]
    best: Candidate | None
    alternatives: tuple[Candidate, ...]
    probabilities: Mapping[tuple[str, ...], float]
    noise: float
    distances: tuple[Distance, ...] = ()
    failed: tuple[str, ...] = ()

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "told": several(naming_tables),
        "failed": attribute(of=lambda naming: list(naming.failed)),
    }

    def beside(self, others: Sequence[Candidate]) -> Naming:
        """Return the same choice with additional alternatives.

        Parameters
        ----------
        others : sequence of Candidate
            Additional alternatives, with the same prior probability as the candidates. Of alternatives with the same
            effects, only the one with the most evidence is added.

        Returns
        -------
        Naming
        """
        alternatives = {c.effects: c for c in sorted(others, key=lambda c: c.evidence)}
        elsewhere = {"+".join(effects) for effects in alternatives}
        competing = {c.effects: c for c in self.candidates if c.effects in self.probabilities} | alternatives
        return replace(
            self,
            candidates=(*self.candidates, *alternatives.values()),
            alternatives=(*self.alternatives, *alternatives.values()),
            probabilities=_probabilities(list(competing.values())),
            # Distances to the same effects in this variant do not hold for those in another variant.
            distances=tuple(d for d in self.distances if d.effects[1] not in elsewhere),
        )

    def with_best(self, first: Candidate) -> Naming:
        """Return the same choice with another explanation as the best one. The former best becomes an alternative.

        Parameters
        ----------
        first : Candidate
            The new best explanation: one of ``alternatives``.

        Returns
        -------
        Naming
            Its ``distances`` are those that are known from `first`.
        """
        if first is self.best or self.best is None:
            return self
        name = "+".join(first.effects)
        known = tuple(replace(d, effects=(name, d.effects[0])) for d in self.distances if d.effects[1] == name)
        others = tuple(c for c in (self.best, *self.alternatives) if c is not first)
        return replace(self, best=first, alternatives=others, distances=known)

    def as_likely(self, others: Sequence[Candidate]) -> Naming:
        """Return the same choice with additional alternatives, each with the probability of the best explanation.

        Parameters
        ----------
        others : sequence of Candidate
            Alternatives whose evidence cannot be compared with that of the best explanation. Those that are already
            present are ignored.

        Returns
        -------
        Naming
        """
        kept = {c.effects for c in self.alternatives}
        further = tuple(c for c in others if c.effects not in kept)
        if self.best is None or not further:
            return self
        weights = {**self.probabilities, **{c.effects: self.probabilities[self.best.effects] for c in further}}
        return replace(self, alternatives=(*self.alternatives, *further), probabilities=normalised(weights))

    def without(self, refuted: Collection[frozenset[str]]) -> Naming:
        """Return the same choice without alternatives that have been refuted.

        Parameters
        ----------
        refuted : collection of frozenset of str
            Sets of effects that were refuted.

        Returns
        -------
        Naming
        """
        alternatives = tuple(
            alternative for alternative in self.alternatives if frozenset(alternative.effects) not in refuted
        )
        if len(alternatives) == len(self.alternatives):
            return self
        weights = {effects: p for effects, p in self.probabilities.items() if frozenset(effects) not in refuted}
        return replace(
            self, alternatives=alternatives, probabilities=normalised(weights) if any(weights.values()) else weights
        )

    def knowing(self, later: Naming) -> Naming:
        """Return the same choice, with the candidates that were tried later in the same search.

        Parameters
        ----------
        later : Naming
            Later result. It is ignored if it is for another interpretation of the rig file.

        Returns
        -------
        Naming
        """
        if later.base.calibration is not self.base.calibration:
            return self
        since = {c.effects for c in later.candidates}
        elsewhere = tuple(c for c in self.candidates if c.effects not in since)
        return replace(self, candidates=(*later.candidates, *elsewhere), failed=later.failed)

    @property
    def base(self) -> Candidate:
        """The base plant: first of ``candidates``."""
        return self.candidates[0]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the rms residuals of each candidate on fitted and on held-out data, the base plant first.

        If there are many candidates, only those with the smallest held-out errors are drawn, but always the best
        explanation and its alternatives.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Axes to draw on; new ones by default.

        Returns
        -------
        matplotlib Axes
        """
        return draw_naming(self, ax)


def normalised(weights: Mapping[tuple[str, ...], float]) -> dict[tuple[str, ...], float]:
    """Return weights of explanations as probabilities, which add up to one."""
    whole = sum(weights.values())
    return {effects: weight / whole for effects, weight in weights.items()}


def nothing_tried(base: Candidate) -> Naming:
    """Return the naming of recordings that need no explanation."""
    return Naming(candidates=(base,), best=None, alternatives=(), probabilities={}, noise=base.noise)


def decide(
    tried: Sequence[Candidate],
    stage: Sequence[Candidate],
    noise: float,
    good: Callable[[Candidate], bool],
    possible: Callable[[Candidate], bool],
) -> Naming:
    """Choose the best `good` candidate of a stage, and the `possible` alternatives that cannot be ruled out."""
    # The best candidate must be adequate. An alternative need not be: a candidate that is nearly as likely, or
    # likelier, is not excluded by a limit that the best one meets by a small margin.
    if not stage:
        return Naming(candidates=tuple(tried), best=None, alternatives=(), probabilities={}, noise=noise)
    probabilities = _probabilities(stage)
    ranked = sorted(stage, key=lambda c: -probabilities[c.effects])
    enough = [c for c in stage if good(c)]
    best = likeliest(enough) if enough else None
    if best is None:
        return Naming(candidates=tuple(tried), best=None, alternatives=(), probabilities=probabilities, noise=noise)
    others = [c for c in ranked if c is not best and (good(c) or possible(c))]
    likely = _credible(best, others, probabilities)
    alternatives = tuple(c for c in others if c in likely or is_as_likely(c, best))
    return Naming(
        candidates=tuple(tried), best=best, alternatives=alternatives, probabilities=probabilities, noise=noise
    )


def _probabilities(competing: Sequence[Candidate]) -> dict[tuple[str, ...], float]:
    """Return the probabilities of explanations with equal prior probability."""
    if not competing:
        return {}
    first = likeliest(competing)
    return normalised({c.effects: float(np.exp(min(advantage(c, first), 0.0))) for c in competing})


def _credible(
    best: Candidate, others: Sequence[Candidate], probabilities: Mapping[tuple[str, ...], float]
) -> list[Candidate]:
    """Return the likeliest of `others` that hold, with the best one, enough of the total probability."""
    weights = np.array([probabilities[c.effects] for c in (best, *others)])
    before = np.cumsum(weights)[:-1]
    return [c for c, held in zip(others, before, strict=True) if held < CREDIBLE * weights.sum()]


def with_distances(
    naming: Naming,
    stage: Sequence[Candidate],
    problem: DiagnosisProblem,
    possible: Callable[[Candidate], bool],
    distance: Callable[..., float] = separation,
    known: Distances | None = None,
    refuted: Callable[[Candidate, Candidate], bool] = lambda other, best: False,
) -> Naming:
    """Add, as alternatives, `possible` explanations that these inputs cannot distinguish from the best one.

    Alternatives that are `refuted` by the best one are not added, nor kept if the inputs distinguish them from it. New
    distances d² are added to `known`, because decisions come back to the same fits.
    """
    # Explanations that are worse by more than the model error are not added, nor are those with a far smaller prior
    # probability: the gain of an amplifier hardly drifts by a tenth.
    best = naming.best
    if best is None:
        return naming
    known = {} if known is None else known
    others = [c for c in stage if c.effects != best.effects and possible(c)]
    alike = [_apart(c, best) <= _model_error(best) and not refuted(c, best) for c in others]
    # For explanations that are clearly distinguished the order of magnitude is enough.
    tasks = [
        (best.calibration, c.calibration, problem.everything, naming.noise, STEPS if close else 0)
        for c, close in zip(others, alike, strict=True)
    ]
    new = {_key(task): task for task in tasks if _key(task) not in known}
    measured = run_jobs(distance, new.values(), workers=problem.jobs)
    known.update(zip(new, zip(new.values(), measured, strict=True), strict=True))
    found = [known[_key(task)][1] for task in tasks]
    near = [
        c
        for c, close, d2 in zip(others, alike, found, strict=True)
        if close and d2 < DISTINGUISHED and is_possible(c, best) and c not in naming.alternatives
    ]
    distances = tuple(_distance(best, c, d2) for c, d2 in zip(others, found, strict=True))
    far = [c.effects for c, d2 in zip(others, found, strict=True) if d2 >= DISTINGUISHED]
    kept = [c for c in naming.alternatives if c.effects not in far or not refuted(c, best)]
    return replace(naming, alternatives=(*kept, *near), distances=distances)


def _key(task: tuple[Any, ...]) -> tuple[object, ...]:
    one, other, _, noise, steps = task
    return id(one), id(other), noise, steps


def with_all_distances(
    naming: Naming, problem: DiagnosisProblem, distance: Callable[..., float] = separation
) -> Naming:
    """Add the missing distances from the best candidate to its alternatives."""
    # They are missing if an alternative was kept for its evidence, comes from another rig variant, or was the best
    # before.
    best, known = naming.best, {d.effects[1] for d in naming.distances}
    if best is None:
        return naming
    others = [c for c in naming.alternatives if "+".join(c.effects) not in known]
    tasks = [(best.calibration, c.calibration, problem.everything, naming.noise) for c in others]
    found = run_jobs(distance, tasks, workers=problem.jobs)
    further = (_distance(best, c, d2) for c, d2 in zip(others, found, strict=True))
    return replace(naming, distances=(*naming.distances, *further))


def _distance(best: Candidate, other: Candidate, d2: float) -> Distance:
    return Distance(effects=("+".join(best.effects), "+".join(other.effects)), d2=d2)


def cannot_rule_out(alternative: Candidate, best: Candidate) -> bool:
    """Return whether an alternative of unknown distance from the best explanation remains possible."""
    if is_as_likely(alternative, best):
        return True
    return is_possible(alternative, best) and _apart(alternative, best) < MOST * _model_error(best)


def is_possible(alternative: Candidate, best: Candidate) -> bool:
    """Return whether the prior probability of an alternative is not far smaller."""
    return best.log_prior - alternative.log_prior < STRONG


def _apart(alternative: Candidate, best: Candidate) -> float:
    """Return by how much an alternative's rms residual exceeds the best's, SI, where they differ most."""
    # An average over all experiments would hide a short one that was made to distinguish the two.
    return float(np.sqrt(max(float((alternative.mean_squares - best.mean_squares).max()), 0.0)))


def _model_error(best: Candidate) -> float:
    return float(best.calibration.plant.rig.model_error)


def is_as_likely(alternative: Candidate, best: Candidate) -> bool:
    """Return whether the evidence for the best over an alternative is not strong."""
    return advantage(best, alternative) < STRONG
