"""What was concealed against what was said: by effect and by family."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from deatwin.plant.effects.base import Family
from deatwin.plant.effects.catalogue import catalogue, effect_named
from deatwin.scenarios.concealed_physics.opened import Case, Opened

OTHER = "other"
"""Verdicts that find fault with recording or input, and errors."""
NOTHING = {"none": "none", "parameters": "none", "unknown": "unknown"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Confusion:
    """How often each answer was given to each truth."""

    truths: tuple[str, ...]  # Rows and columns
    answers: tuple[str, ...]
    counts: np.ndarray  # shape (truths, answers): Cases
    right: np.ndarray  # shape (truths, answers): Which answers are right

    def rows(self) -> list[tuple[object, ...]]:
        """A line for each truth: its name and its counts."""
        return [(truth, *map(int, line)) for truth, line in zip(self.truths, self.counts, strict=True)]


def by_effect(study: Opened) -> Confusion:
    """First causes by canonical name, for clean data, single effects and what is outside the catalogue."""
    names = [effect.name for effect in catalogue()]
    return _confusion(study, names, lambda name: name)


def by_family(study: Opened) -> Confusion:
    """The same by family."""
    return _confusion(study, [family.value for family in Family], lambda name: effect_named(name).family.value)


def _confusion(study: Opened, groups: Sequence[str], group: Callable[[str], str]) -> Confusion:
    truths, answers = (*groups, "outside", "clean"), (*groups, "unknown", "none", OTHER)
    counts = np.zeros((len(truths), len(answers)), dtype=int)
    for case in study.of("clean", "effect", "outside"):
        row = truths.index(case.kind if case.kind != "effect" else group(case.truth[0]))
        counts[row, answers.index(_answer(case, group))] += 1
    expected = {"outside": "unknown", "clean": "none"}
    right = np.array([[answer == expected.get(truth, truth) for answer in answers] for truth in truths])
    return Confusion(truths=truths, answers=answers, counts=counts, right=right)


def _answer(case: Case, group: Callable[[str], str]) -> str:
    return group(case.causes[0]) if case.causes else NOTHING.get(case.verdict, OTHER)
