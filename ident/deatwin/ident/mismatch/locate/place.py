"""Locate the mismatch in the plant: an unknown force is allowed at one place at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from scipy.special import chdtrc, ndtr

from deatwin.ident.frequency.comparison.bands import holm
from deatwin.ident.greybox.filter import open_place
from deatwin.ident.greybox.filter_foreign import linearise
from deatwin.ident.greybox.filter_linear import Floor, Linear, without_repeats
from deatwin.ident.greybox.filter_openings import STATE, Opening, places
from deatwin.ident.mismatch.locate.closure import Closure, closure, closure_p_value, regressions
from deatwin.ident.mismatch.located import PlaceSummary
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.thresholds import CHANCE, DEVIATIONS, TINY
from deatwin.plant.datasets import Described, Metadata, attribute, table_along, variable
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.effects.base import Place
from deatwin.plant.model import Plant
from deatwin.plant.words import spaced

BLOCKS = 48
"""Number of stretches of the recordings in which two places are compared."""


@dataclass(frozen=True, kw_only=True)
class OpenedPlace:
    """Result of allowing an unknown force at one place."""

    place: str
    signal: str
    gain: float = field(
        metadata=variable(unit="nat", about="log likelihood with a wandering quantity there, against none")
    )
    p_value: float  # of the gain, which is at the bound of its range; corrected for the number of places
    # Beyond what the base parameters imitate, on data that were not fitted; negative if the function is not repeatable
    explained: float = field(
        metadata=variable(about="share of the residual's mean square that the signals there predict")
    )
    score: float = field(metadata=variable(about="the same as a share of what is not sensor noise"))  # from 0 to 1
    among_best: bool = field(metadata=variable(about="True if the recordings cannot distinguish it from the best one"))

    @property
    def summary(self) -> PlaceSummary:
        """Return the summary for a diagnosis."""
        return PlaceSummary(
            place=self.place,
            score=self.score,
            signal=self.signal,
            log_likelihood_gain=self.gain,
            p_value=self.p_value,
            explained=self.score,
            among_best=self.among_best,
        )


@dataclass(frozen=True, kw_only=True)
class Places(Described):
    """Places by how well something that enters there explains the mismatch."""

    # The best first; empty for a foreign model, which shows only its reading
    opened: tuple[OpenedPlace, ...] = field(metadata=table_along("opened"))
    # Probability that a residual independent of the signals is predicted as well at any place
    closure_p_value: float = field(metadata=attribute())
    body: str = field(default="ball", metadata=attribute())  # name of the moving part on this rig

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "repeatable": attribute(),
        "among_best": attribute(of=lambda found: list(found.among_best)),
    }

    @property
    def repeatable(self) -> bool:
        """Return whether the mismatch is a repeatable function of the signals at any place."""
        return self.closure_p_value < CHANCE

    @property
    def among_best(self) -> tuple[str, ...]:
        """Return the places that the recordings cannot distinguish, the best first; empty if nothing is repeatable."""
        return tuple(dict.fromkeys(o.place for o in self.opened if o.among_best)) if self.repeatable else ()

    @property
    def summary(self) -> tuple[PlaceSummary, ...]:
        """Return the summary of each place with its best signal, the best place first."""
        best: dict[str, PlaceSummary] = {}
        for one in self.opened:
            best.setdefault(one.place, one.summary)
        return tuple(best.values())

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the score of each signal, those that cannot be distinguished from the best one filled."""
        ax = axes_or_new(ax)
        names = [f"{self.body if o.place == Place.BALL.value else o.place}: {spaced(o.signal)}" for o in self.opened]
        best = [o.among_best and self.repeatable for o in self.opened]
        for mask, style, label in (
            (best, {"color": "C0"}, "not distinguished from the best"),
            (
                [not b for b in best],
                {"color": "none", "edgecolor": "C0"},
                "worse than the best" if self.repeatable else "not significant",
            ),
        ):
            rows = [k for k, chosen in enumerate(mask) if chosen]
            if rows:
                ax.barh(rows, [self.opened[k].score for k in rows], label=label, **style)  # type: ignore[arg-type]
        ax.set_yticks(range(len(names)), names)
        ax.invert_yaxis()
        ax.set_xlim(0, 1)
        ax.set_xlabel("share of the mismatch that the signals there predict")
        if self.opened:
            ax.legend(fontsize="small", loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
        return ax


def locate_place(base: Candidate, problem: DiagnosisProblem, rng: np.random.Generator) -> Places:
    """Open one place after the other, the best first; raise SimulationError if the plant cannot be simulated."""
    # The gain in likelihood is tested at each place, but with one input and one output several places have the same
    # likelihood. So places are ranked by how far the force is a repeatable function of the signals there. The gain
    # follows the law of a likelihood ratio at a bound: Self & Liang, J. Am. Stat. Assoc. 82 (1987) 605-610.
    plant = base.calibration.plant
    linears = without_repeats(linearise(plant, problem.everything, _openings(plant)))
    floor = Floor.of(linears, base.noise)
    gains = _gains(linears, floor)
    # Half of the law is a point mass at zero, the other half is chi-squared with one degree of freedom.
    p_values = holm([float(0.5 * chdtrc(1, 2 * gain)) if gain > 0 else 1.0 for gain in gains])
    problems = regressions(linears)
    closures = [closure(fitting) for fitting in problems]
    best = min(closures, key=lambda c: float(c.losses.mean()))
    explicable = 1 - floor.noise**2 / problems[0].readings / max(float(best.closed.mean()), TINY)
    found = [
        OpenedPlace(
            place=opening.place,
            signal=opening.signal,
            gain=gain,
            p_value=float(p),
            explained=one.explained,
            score=float(np.clip(one.explained / max(explicable, one.explained, TINY), 0.0, 1.0)),
            among_best=_as_good(one, best),
        )
        for opening, gain, p, one in zip(linears[0].openings, gains, p_values, closures, strict=True)
    ]
    comparable = found if plant.rig.equations_known else []  # a single place cannot be called the best
    return Places(
        opened=tuple(sorted(comparable, key=lambda o: -o.explained)),
        closure_p_value=closure_p_value(problems, rng),
        body=plant.rig.body,
    )


def _openings(plant: Plant) -> tuple[Opening, ...]:
    """Return the signals that a rig offers; without any, its parameters and states; for a foreign model, its reading."""
    if not plant.rig.equations_known:
        return ()
    offered = places(plant)
    signals = [o for o in offered if o.place not in (Place.PARAMETER.value, STATE)]
    declared = {o.place for o in signals} - {Place.DRIVE.value, Place.SENSOR.value}
    return tuple(signals) if declared else offered


def _gains(linears: Sequence[Linear], floor: Floor) -> list[float]:
    opened = [open_place(linears, floor, opening) for opening in linears[0].openings]
    closed = open_place(linears, floor, None).log_likelihood
    return [max(0.0, one.log_likelihood - closed) for one in opened]


def _as_good(one: Closure, best: Closure) -> bool:
    """Compare two places by signed ranks, which are robust to single bursts of the residual."""
    from scipy.stats import wilcoxon

    worse = one.losses - best.losses
    means = np.array([piece.mean() for piece in np.array_split(worse, min(BLOCKS, worse.size))])
    return not means.any() or bool(wilcoxon(means, alternative="greater").pvalue > ndtr(-DEVIATIONS))
