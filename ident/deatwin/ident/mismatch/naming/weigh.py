r"""Comparison of a pair of effects with one of them alone, whose law may be inexact, by the likelihood of all readings.

The page docs/explanation/verdict.md states the reasons and the sizes of these errors. With the contribution c of the
single effect, and the difference of the residuals of single effect and pair in two parts :math:`\delta_k`, one that
another law of the single effect could cause and the rest,

.. math:: y = f_1(\theta) + \sum_{k=1}^2 \lambda_k\,\ell_k\,\frac{\mathrm{rms}(c)}{\mathrm{rms}(\delta_k)}\,\delta_k
          + B \beta + g + e, \qquad \lambda_k \sim N(0, 1)

Of all pairs that were fitted, that one gives :math:`\delta` whose error helps the single effect most. That is cautious:
with equal prior probabilities of all directions, it would have the mean of these likelihoods, not the largest.

The direction of :math:`\delta_2` is not known beforehand: it was fitted, by the time constants, thresholds and times of
events of the second effect. Whether these shape an effect or an error, they are equally free, so the evidence of both
changes by the same factor.

A delay that counts as the plant's own timing error has the prior of that error. The column of the timing error stays as
in all other sets: it belongs to the motion of the base plant, and a delay to that of its own.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.special import log_ndtr

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.greybox.parts import level_of, motion_of
from deatwin.ident.greybox.problem import Problem
from deatwin.ident.mismatch.likelihood import structured
from deatwin.ident.mismatch.likelihood.beforehand import (
    TIMING,
    Coordinate,
    coordinate,
    departure,
    nominal_odds,
    pair_odds,
    strength_deviation,
    touching,
)
from deatwin.ident.mismatch.likelihood.model import Prior
from deatwin.ident.mismatch.likelihood.scales import evidence
from deatwin.ident.mismatch.likelihood.several import OwnErrors, later, own_errors
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.contribution import readings_of_fit
from deatwin.ident.mismatch.naming.criteria import inwards
from deatwin.ident.mismatch.naming.screen import LinearisedResponse
from deatwin.ident.mismatch.plan.seen import Change, products
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.thresholds import TINY
from deatwin.plant.arrays import root_mean_square
from deatwin.plant.effects.delay import Delay
from deatwin.plant.parameters import Parameter

OWN, OTHER = 0.05, 0.015
"""Standard deviations of the error of an effect's law along a second effect, as shares of the first effect's
contribution: of the part that another law of the same mechanism could cause, and of the rest."""
LOOPS, LOOSE = frozenset({"coulomb_friction", "hysteresis"}), 0.1
"""Effects whose laws vary more, and not by a filter; for them both deviations have this value. It was measured between
other laws of these mechanisms and the catalogue's (docs/development/evidence.md)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scale:
    """Log evidence of candidates relative to the `base` plant, given the sensor's `noise`, SI."""

    problem: DiagnosisProblem
    base: Candidate
    noise: float
    _weights: dict[tuple[str, ...], tuple[Calibration, float]] = field(default_factory=dict, init=False, repr=False)
    _inexact: dict[tuple[int, int], tuple[tuple[Calibration, Calibration], float]] = field(
        default_factory=dict, init=False, repr=False
    )

    def of_two(self, pair: Candidate, alone: Candidate, others: Sequence[Candidate] = ()) -> float:
        """Return the log odds of a pair over one effect, whose law is exact or inexact with equal probability.

        `others` are further pairs, along whose second effects the law may err instead.
        """
        exact = max(self.weight(alone), *(self._late_weight(alone, other) for other in (pair, *others)))
        inexact = max(self._inexact_weight(alone, other) for other in (pair, *others))
        either = np.logaddexp(exact, inexact) - np.log(2.0)
        return self.weight(pair) - float(either) + self._pair_odds + pair.log_share - alone.log_share

    def over(self, best: Candidate, other: Candidate) -> float:
        """Return the log odds of one explanation over another one, whose law is exact or inexact with equal
        probability.
        """
        either = np.logaddexp(self.weight(other), self._inexact_weight(other, best)) - np.log(2.0)
        return self.weight(best) - float(either) + best.log_share - other.log_share

    def _late_weight(self, alone: Candidate, pair: Candidate) -> float:
        """Return the log evidence of an effect whose timing error is the delay of a pair; -inf if this has none."""
        further = [f"{effect}.time" for effect in pair.effects if effect not in alone.effects]
        is_late = len(further) == len(pair.effects) - len(alone.effects) == 1 and further[0] in self._delays
        return self.weight(pair, late=further[0]) if is_late else -np.inf

    @cached_property
    def _delays(self) -> frozenset[str]:
        """Names of the dead times of the command and of the reading, whatever their place."""
        return frozenset(f"{e.name}.time" for e in self.problem.everywhere if e.cause == Delay.name)

    def _inexact_weight(self, alone: Candidate, pair: Candidate) -> float:
        """Return the log evidence of an explanation whose law errs along its difference from another one."""
        fits = (alone.calibration, pair.calibration)
        key = (id(fits[0]), id(fits[1]))  # the fits are kept beside the value, so their ids stay valid
        if key not in self._inexact:
            law = self._law(pair, alone)
            own, whole = self._evidence(alone, law[:, :1]), self._evidence(alone, law)
            self._inexact[key] = (fits, max(own, whole + self._shape_odds(pair, alone)) if law.shape[1] > 1 else whole)
        return self._inexact[key][1]

    def _shape_odds(self, pair: Candidate, alone: Candidate) -> float:
        """Return the log odds of not knowing the shapes of a pair's further effects over knowing them as fitted."""
        further = {e.name: f"{e.name}.{e.strength}" for e in self.problem.everywhere if e.name not in alone.effects}
        own = [(name, further.get(name.partition(".")[0])) for name in pair.calibration.names]
        known = {name for name, strength in own if strength not in (None, name)}
        return self.weight(pair) - self._evidence(pair, known=known) if known else 0.0

    @property
    def _pair_odds(self) -> float:
        """Return the prior log odds of any two effects over any one."""
        return pair_odds(len({effect.cause for effect in self.problem.everywhere}))

    def weight(self, candidate: Candidate, late: str = "") -> float:
        """Return the log evidence of a candidate's fit, in which the delay named `late` is the plant's timing error."""
        known = self._weights.get((*candidate.effects, late))
        if known is None or known[0] is not candidate.calibration:  # refitted since
            known = candidate.calibration, self._evidence(candidate, late=late)
            self._weights[(*candidate.effects, late)] = known
        return known[1]

    def _evidence(
        self, candidate: Candidate, law: np.ndarray | None = None, late: str = "", known: Collection[str] = ()
    ) -> float:
        """Return the log evidence of a candidate's fit, with columns (n, k) along which its law may err.

        The delay named `late` is the plant's own timing error. The parameters `known` have no other values.
        """
        fit = candidate.calibration
        columns, prior, factor = self._columns(candidate, late, known)
        if law is not None:
            columns = np.column_stack([columns, law])
            prior = Prior(
                fitted=np.append(prior.fitted, np.zeros(law.shape[1])),
                above=np.append(prior.above, np.full(law.shape[1], -np.inf)),
            )
        events = sum(name in fit.plant.event_times and name not in known for name in fit.names)
        # An event is equally likely at each sample; readings are not smooth in its time, and show it to about a sample.
        weighed = evidence(self.error.likelihood(fit.residuals, columns), prior)
        placed = events * float(np.log(self.error.moments))
        return weighed.log + factor + self.log_prior_of_rig(candidate) - placed

    @cached_property
    def error(self) -> OwnErrors:
        """Return the model error in each reading, for the motion of the base plant."""
        parts, fit = self.problem.fitted, self.base.calibration
        rig, readings = self.problem.nominal.rig, readings_of_fit(parts, fit.residuals)
        late = later(fit.plant, parts, readings, TIMING * rig.sample_time)
        return own_errors(rig, parts, readings, self.noise, self.problem.expected_error, late)

    def _columns(
        self, candidate: Candidate, late: str = "", given: Collection[str] = ()
    ) -> tuple[np.ndarray, Prior, float]:
        """Return the columns of parameters and model error, scaled by prior deviations, (n, k), the fit's prior, and
        its log factor.

        The delay named `late` is the plant's own timing error. The parameters `given` have no columns.
        """
        fit, effects = candidate.calibration, {effect.name: effect for effect in self.problem.everywhere}
        smooth = Problem(plant=fit.plant, parts=(), names=fit.names).smooth()
        moves = smooth & np.array([name not in given for name in fit.names], dtype=bool)
        parameters = [fit.plant.parameters[name] for name, moving in zip(fit.names, moves, strict=True) if moving]
        largest = float(np.quantile(np.abs(self.error.of[0].readings), 0.99))
        step = TIMING * self.problem.nominal.rig.sample_time
        known = [
            Coordinate(mean=0.0, deviation=step)
            if p.name == late
            else coordinate(p, self.problem.nominal, effects, largest)
            for p in parameters
        ]
        mean, spread = (np.array([getattr(k, name) for k in known]) for name in ("mean", "deviation"))
        # Deviations of the rig's own parameters count in `log_prior_of_rig`, since nominal values may be wrong.
        of_effects = [p.name.partition(".")[0] in effects for p in parameters]
        at = np.where(of_effects, [p.scale.to_coordinate(p.value) for p in parameters], mean)
        columns = np.column_stack([fit.jacobian[:, moves] * spread, self.error.columns])
        sided = [k for k, one in enumerate(known) if one.one_sided]
        prior = Prior.of((at.size, (at - mean) / spread), (columns.shape[1] - at.size, None), one_sided=sided)
        factor = sum(k.log_factor for k in known)
        # Beyond a bound that a fit has reached nothing is likely: such a coordinate is counted inwards from the bound.
        for k, p in enumerate(parameters):
            if p.name not in fit.at_bound or np.isfinite(prior.above[k]):
                continue
            if inwards(p) < 0.0:
                columns[:, k] *= -1.0
                prior.fitted[k] *= -1.0
            prior.above[k] = prior.fitted[k]
            if not of_effects[k]:
                factor -= float(np.log(2.0))  # `log_prior_of_rig` is a density over the whole range
        return columns, prior, factor

    def _law(self, pair: Candidate, alone: Candidate) -> np.ndarray:
        """Return the expected law error of one effect along the response of the second one, (n, k)."""
        does, sizes = alone.contribution, self._missed(alone)
        apart = alone.calibration.residuals - pair.calibration.residuals
        if not _is_known(does):
            return structured.known(apart[:, None], sizes[:1])
        basis = structured.law(does, self.error.times, self.error.records, level_of(self.problem.fitted))
        own = basis @ (basis.T @ apart)
        return np.column_stack([structured.known(own[:, None], sizes[:1]), self._rest(apart - own, alone)])

    def _rest(self, direction: np.ndarray, alone: Candidate) -> np.ndarray:
        """Return the expected law error of one effect along a direction, (n,), that no other law of it would cause."""
        error, does = structured.known(direction[:, None], self._missed(alone)[1:])[:, 0], alone.contribution
        if not _is_known(does):
            return error
        # What is slow in one reading may be fast in another, so each reading has its own limits.
        for one, at in zip(self.error.of, self.error.at, strict=True):
            error[at] = structured.limited(error[at], does[at], one.times, one.records, one.level)
            error[at] = structured.begun(error[at], does[at], one.records, one.level)
        return error

    def _missed(self, alone: Candidate) -> tuple[float, float]:
        """Return the rms law error of one effect, SI: the part another law could cause, and the rest."""
        # Without the effect the plant may have no equilibrium; no contribution exceeds the whole motion.
        does = min(root_mean_square(alone.contribution), motion_of(self.problem.fitted, self.error.readings))
        own, other = (LOOSE, LOOSE) if LOOPS.intersection(alone.effects) else (OWN, OTHER)
        return own * does, other * does

    def log_prior_of_rig(self, candidate: Candidate) -> float:
        """Return the log prior of the rig's own parameters relative to their nominal values, which may be wrong."""
        return sum(nominal_odds(fitted, nominal) for fitted, nominal in self._of_the_rig(candidate))

    def biased(self, candidate: Candidate) -> float:
        """Return by how many nats the rig's own parameters are less likely than nominal ones; missing physics biases
        them.
        """
        return 0.5 * sum(departure(fitted, nominal) ** 2 for fitted, nominal in self._of_the_rig(candidate))

    def _of_the_rig(self, candidate: Candidate) -> Iterator[tuple[Parameter, Parameter]]:
        """Yield each fitted parameter of the rig's own with its nominal value."""
        fit, nominal = candidate.calibration, self.problem.nominal.parameters
        return ((fit.plant.parameters[name], nominal[name]) for name in fit.names if name in nominal)

    def promises(self, alone: Candidate, known: Sequence[LinearisedResponse]) -> dict[str, float]:
        """Return the log odds of each further effect over the fitted one alone, as `of_two` does, to first order.

        Each effect has the shape with the largest odds.
        """
        fit, effects = alone.calibration, {effect.name: effect for effect in self.problem.effects}
        own = self._columns(alone)[0][:, : -self.error.columns.shape[1]]
        changes = [Change(effect="", readings=fit.residuals, typical=1.0, deviation=1.0, one_sided=False)]
        for one in known:
            strength = one.effect.described(one.effect.strength)
            changes.append(
                Change(
                    effect=one.effect.name,
                    readings=one.change,
                    typical=strength.value,
                    deviation=strength_deviation(effects[one.effect.name]),
                    one_sided=strength.lower >= 0.0,
                )
            )
        among = products(self.error, own, changes)
        found: dict[str, float] = {}
        for change, along, square in zip(changes[1:], among[0, 1:], np.diagonal(among)[1:], strict=True):
            if not fit.plant.lacks(effects[change.effect]) or square <= 0.0:
                continue
            law = root_mean_square(self._rest(change.readings, alone)) / max(root_mean_square(change.readings), TINY)
            fitted = along / square if along > 0.0 or not change.one_sided else 0.0
            deviation, factor = touching(change.deviation, fitted)
            either = np.logaddexp(0.0, _gain(along, square, law, False)) - np.log(2.0)
            odds = factor + _gain(along, square, deviation, change.one_sided) - float(either)
            found[change.effect] = max(found.get(change.effect, -np.inf), odds + self._pair_odds)
        return found


def _gain(along: float, square: float, deviation: float, one_sided: bool) -> float:
    """Return the log evidence gained by a column, from its products with the residual and with itself."""
    if deviation <= 0.0:
        return 0.0
    width = square + deviation**-2
    gain = 0.5 * (along**2 / width - float(np.log(deviation**2 * width)))
    return gain + (float(np.log(2.0) + log_ndtr(along / np.sqrt(width))) if one_sided else 0.0)


def _is_known(contribution: np.ndarray) -> bool:
    """Return whether an effect's contribution is known; without the effect the plant may have no equilibrium."""
    return bool(np.isfinite(contribution).all() and contribution.any())
