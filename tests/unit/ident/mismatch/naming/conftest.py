"""Explanations that leave residuals of given sizes, and searches in which such ones were tried."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.greybox import FitStatus
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.naming.decide import Naming
from deatwin.ident.mismatch.naming.sets import Search
from deatwin.plant.effects.base import Effect
from deatwin.plant.parameters import Parameter, Scale

NOISE, MODEL_ERROR = 2.0, 1.2
RIG = SimpleNamespace(model_error=MODEL_ERROR, sample_time=0.02, noise=NOISE)
RECORD = SimpleNamespace(extras={})
PARTS = (SimpleNamespace(experiment=SimpleNamespace(recordings=(RECORD,)), timepts=np.array([0.0, 420.0])),)

FITTED = (
    SimpleNamespace(
        reading="",
        masks=(np.ones(7000, bool),),
        commands=np.arange(7000.0),
        measured=np.zeros(7000),
        level=np.ones(7000),
    ),
)


class Built(SimpleNamespace):
    """A plant of which a search knows the names of its effects."""

    stages, steps = 4, 1

    def lacks(self, effect: Effect) -> bool:
        return effect.name not in self.effect_names


@dataclass
class Nominal:
    """A plant that stays what it is in any form and with any effects."""

    stages: int = 4
    steps: int = 1
    effect_names = ()

    def with_rig(self, rig: object) -> "Nominal":
        return self

    def with_effects(self, *effects: object) -> "Nominal":
        return self

    def with_values(self, values: object) -> "Nominal":
        return self


@pytest.fixture
def noise():
    return NOISE


@pytest.fixture
def nothing():
    """No explanation was found."""
    return Naming(candidates=(), best=None, alternatives=(), probabilities={}, noise=NOISE)


@pytest.fixture
def is_adequate():
    return lambda explanation: explanation.adequate


@pytest.fixture
def candidate():
    """``candidate(*effects, rms, unseen=None, alone=inf)``: an explanation with residuals of exactly these sizes.

    By themselves its effects do so much as ``alone`` says.
    """

    def make(*effects: str, rms: float, unseen: float | None = None, alone: float = np.inf) -> Candidate:
        fitted, late = np.tile([rms, -rms], 3500), np.tile([unseen or rms, -(unseen or rms)], 1500)
        plant, names = Built(rig=RIG, effects=(), effect_names=()), ("a",) * (7 + len(effects))
        calibration = SimpleNamespace(
            plant=plant,
            residuals=fitted,
            names=names,
            status=FitStatus.SETTLED,
            at_bound=(),
            rms=float(np.sqrt(np.mean(fitted**2))),
            given_up=False,
        )
        does = np.full(fitted.size, alone)
        return Candidate(effects=effects, calibration=calibration, unseen=late, noise=NOISE, contribution=does)

    return make


@pytest.fixture
def held():
    """``held(candidate, cost, *at_bound)``: the same, of which more damping would leave ``cost`` less in mean square.

    The damping has a value of its range from 1 to 2, and moves on some scale.
    """

    def make(
        whole: Candidate, cost: float, *at_bound: str, value: float = 2.0, scale: Scale = Scale.LINEAR
    ) -> Candidate:
        residuals, rms = whole.calibration.residuals, whole.calibration.rms
        other = np.tile([1.0, 1.0, -1.0, -1.0], residuals.size // 4)  # at right angles to the residuals
        share = cost / rms**2  # of their power a direction takes the square of the cosine
        damping = np.sqrt(share) * residuals / rms + np.sqrt(1.0 - share) * other
        jacobian = np.column_stack([np.ones_like(residuals), damping * scale.slope(value)])
        parameters = {
            name: Parameter(name=name, value=value, unit="1", lower=1.0, upper=2.0, scale=scale)
            for name in ("shear_modulus", "damping")
        }
        known = vars(whole.calibration) | {
            "names": tuple(parameters),
            "jacobian": jacobian,
            "at_bound": at_bound,
            "plant": SimpleNamespace(**vars(whole.calibration.plant), parameters=parameters),
        }
        return replace(whole, calibration=SimpleNamespace(**known))

    return make


@pytest.fixture
def differing_fast():
    """``differing_fast(candidate, size)``: what it leaves, slower, and so much more at half the sample rate."""

    def of(explanation: Candidate, size: float) -> Candidate:
        calibration = vars(explanation.calibration) | {"residuals": _added(explanation.calibration.residuals, size)}
        return replace(explanation, calibration=SimpleNamespace(**calibration), unseen=_added(explanation.unseen, size))

    return of


def _added(residuals: np.ndarray, size: float) -> np.ndarray:
    slower = residuals * np.tile([1.0, -1.0, -1.0, 1.0], residuals.size // 4)  # of pairs of equal sign
    return slower + size * np.tile([1.0, -1.0], residuals.size // 2)


@pytest.fixture
def search_over():
    """``search_over(*candidates)``: a search in which these were tried, the base plant first."""

    def make(*candidates: Candidate) -> Search:
        problem = SimpleNamespace(effects=(), everywhere=(), jobs=1, nominal=Nominal(), fitted=FITTED, everything=PARTS)
        search = Search(problem, candidates[0], ())
        search.tried.update({c.effects: c for c in candidates})
        search._together = list  # no pairs: nothing was screened
        search._siblings = lambda names, best: []  # nothing acts as anything does
        search.with_distances = lambda naming, competing: naming  # nor is nothing as near as it looks
        search.is_refuted = lambda candidate, best: False  # nor has anything a likelihood
        return search

    return make
