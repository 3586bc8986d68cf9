"""The cases of the benchmark: what is asked of a draw, or of all draws of a system, and what came of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from deatwin.ident.narx.systems import SYSTEMS
from deatwin.scenarios.svb_benchmark.coverage import VARIATIONAL, covered
from deatwin.scenarios.svb_benchmark.methods import METHODS
from deatwin.scenarios.svb_benchmark.oracle import Contrast, contrast
from deatwin.scenarios.svb_benchmark.sampling import Comparison, compare
from deatwin.scenarios.svb_benchmark.trials import Trial, try_out

Flags = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """What came of a case; what was not asked is absent."""

    trials: tuple[Trial, ...] = ()  # One for each method, in the order of the case
    contrast: Contrast | None = None  # How far the true terms stand out
    covered: Mapping[str, Flags] = field(default_factory=dict)
    comparison: Comparison | None = None  # With the sampler

    def to_dict(self) -> dict[str, Any]:
        """Plain data."""
        sampled = {} if self.comparison is None else asdict(self.comparison)
        return {
            "trials": [asdict(trial) for trial in self.trials],
            "contrast": None if self.contrast is None else asdict(self.contrast),
            "covered": {name: flags.tolist() for name, flags in self.covered.items()},
            "comparison": {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in sampled.items()} or None,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Self:
        """The answer that `to_dict` described."""
        return cls(
            trials=tuple(map(Trial.from_dict, data["trials"])),
            contrast=None if data["contrast"] is None else Contrast.from_dict(data["contrast"]),
            covered={name: np.array(flags, dtype=bool) for name, flags in data["covered"].items()},
            comparison=None if data["comparison"] is None else Comparison.from_dict(data["comparison"]),
        )


@dataclass(frozen=True, kw_only=True)
class Case(ABC):
    """What is asked of the draws of a system."""

    system: str

    @property
    def name(self) -> str:
        """Of its file."""
        return f"{self.system}-{self._about}"

    @property
    @abstractmethod
    def _about(self) -> str:
        """What of the system it is, in the name."""

    @property
    @abstractmethod
    def effort(self) -> float:
        """How many seconds it takes, about."""

    @abstractmethod
    def answer(self, seed: int) -> Answer:
        """Run it."""

    def _fits(self, methods: tuple[str, ...]) -> float:
        """Seconds that fits by the methods take."""
        return sum(METHODS[method].efforts[self._large] for method in methods)

    @property
    def _large(self) -> bool:
        return SYSTEMS[self.system].degree > 3


@dataclass(frozen=True, kw_only=True)
class Tried(Case):
    """All methods, and the oracles, on a draw."""

    number: int
    methods: tuple[str, ...]

    @property
    def _about(self) -> str:
        return f"{self.number:03d}"

    @property
    def effort(self) -> float:
        return self._fits(self.methods) + (0.4 if self._large else 0.03)

    def answer(self, seed: int) -> Answer:
        trials = tuple(try_out(self.system, method, seed, self.number) for method in self.methods)
        return Answer(trials=trials, contrast=contrast(self.system, seed, self.number))


@dataclass(frozen=True, kw_only=True)
class Covering(Case):
    """The intervals of several estimators on all draws of a system; a draw takes milliseconds."""

    draws: int  # How many
    estimators: tuple[str, ...]

    @property
    def _about(self) -> str:
        return "coverage"

    @property
    def effort(self) -> float:
        return 0.003 * self.draws * len(self.estimators)

    def answer(self, seed: int) -> Answer:
        return Answer(
            covered={
                estimator: np.array([covered(self.system, estimator, seed, number) for number in range(self.draws)])
                for estimator in self.estimators
            }
        )


@dataclass(frozen=True, kw_only=True)
class Noisy(Case):
    """Some methods, and the intervals of variational Bayes, on a draw with other noise."""

    variance: float
    number: int
    methods: tuple[str, ...]

    @property
    def _about(self) -> str:
        return f"{self.variance:g}-{self.number:03d}"

    @property
    def effort(self) -> float:
        return self._fits(self.methods) + 0.003

    def answer(self, seed: int) -> Answer:
        flags = covered(self.system, VARIATIONAL, seed, self.number, self.variance)
        return Answer(
            trials=tuple(try_out(self.system, m, seed, self.number, self.variance) for m in self.methods),
            covered={VARIATIONAL: flags[None, :]},
        )


@dataclass(frozen=True, kw_only=True)
class Sampled(Case):
    """A method beside the sampler of structures, on a draw."""

    number: int
    method: str

    @property
    def _about(self) -> str:
        return f"sampler-{self.number:03d}"

    @property
    def effort(self) -> float:
        return 2.0

    def answer(self, seed: int) -> Answer:
        return Answer(comparison=compare(self.system, self.method, seed, self.number))
