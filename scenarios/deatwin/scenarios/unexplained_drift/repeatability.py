"""Does a drift that differs from actuator to actuator rule out creep and relaxation? The argument, tried out.

The thesis argues (section 2.3.2) that stress relaxation and creep are repeatable, and hence are not what makes six
actuators of one specification drift in six ways. Here six fabrications are given creep, or relaxation, of one and the
same size, and one and the same experiment. What differs is what each went through before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant import Actuator, Creep, Effect, Experiment, Plant, PrestretchRelaxation, Recording, fleet
from deatwin.plant.arrays import Array
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.records import plain
from deatwin.scenarios.unexplained_drift.sealed import concealed_in
from deatwin.studies.report.story import Measure, Table
from deatwin.studies.report.words import Words

WORDS = Words(__package__)
SECTION, SETTLING = 20.0, 5.0
"""Length of the section of noise that is repeated, and of what is not counted of it, s: after 5 s the specification,
which does not drift, gives the second time what it gave the first, to a nanometre."""
SPAN = 640.0  # From the beginning of its first run to that of its second, s; in between the last command is held
MEAN = 2.4  # Mean of the commands, V
CREEP = Creep(modulus=42e3, time=400.0)
RELAXATION = PrestretchRelaxation(relative_loss=0.06, time=1000.0)
AGES = (0.0, 300.0, 800.0, 1500.0, 3000.0, 6000.0)  # Times since the film was mounted, s, when histories differ
HELD, HOLD = 3.3, 600.0  # Command (V) that the actuator was held at before, and for how long (s)
RESTS = (5.0, 100.0, 200.0, 400.0, 800.0, 1600.0)  # Times at 0 V after that, s, when histories differ


@dataclass(frozen=True, kw_only=True)
class History:
    """History of an actuator before the experiment."""

    age: float = 0.0  # Clock time at which its first recording begins, s: how long the film has been mounted
    hold: float = 0.0  # Time that it was held at `HELD`, s; 0 if it was not
    rest: float = 0.0  # Time at 0 V after that, s


FRESH = (History(),) * 6


@dataclass(frozen=True, kw_only=True)
class Drift:
    """Change of readings from one run of a noise to another."""

    shift: float
    shift_error: float
    gain: float  # Relative change of the gain, and its standard error
    gain_error: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Group:
    """Drifts of six actuators under one assumption."""

    name: str  # The drift in words
    assumption: str  # About the histories, in words
    histories: tuple[History, ...]  # One for each actuator
    drifts: tuple[Drift, ...]  # One for each actuator

    @property
    def sizes(self) -> Array:
        """Shifts of the mean, shape (n,), m."""
        return np.array([d.shift for d in self.drifts])

    @property
    def spread(self) -> tuple[float, float, float]:
        """Standard deviation of the shifts from actuator to actuator, with its 95 % interval, m."""
        from scipy.stats import chi2

        n, s = self.sizes.size, float(self.sizes.std(ddof=1))
        low, high = (s * float(np.sqrt((n - 1) / chi2.ppf(q, n - 1))) for q in (0.975, 0.025))
        return s, low, high

    @property
    def next_one(self) -> tuple[float, float]:
        """Prediction interval (95 %) of the shift of a further actuator with this mechanism and history, m."""
        from scipy.stats import t

        n = self.sizes.size
        reach = float(t.ppf(0.975, n - 1) * self.sizes.std(ddof=1) * np.sqrt(1 + 1 / n))
        return float(self.sizes.mean()) - reach, float(self.sizes.mean()) + reach

    def rules_out(self, other: Drift) -> bool:
        """True if this mechanism with these histories would not give the shift of a drift."""
        low, high = self.next_one
        return other.shift + 2 * other.shift_error < low or other.shift - 2 * other.shift_error > high

    def to_dict(self) -> dict[str, Any]:
        """Plain data for the story's file; SI."""
        return {**plain(self), "spread": self.spread, "next_one": self.next_one}


ASSUMPTIONS: tuple[tuple[str, str, Effect | None, tuple[History, ...]], ...] = (
    ("six actuators", "each with its own drift", None, FRESH),
    ("creep", "all rested", CREEP, FRESH),
    ("creep", "driven before, rested for 5 s to 27 min", CREEP, tuple(History(hold=HOLD, rest=rest) for rest in RESTS)),
    ("relaxation", "all freshly mounted", RELAXATION, FRESH),
    ("relaxation", "mounted 0 s to 100 min before", RELAXATION, tuple(History(age=age) for age in AGES)),
)
"""Drift and assumed histories in words; the effect, None for each actuator's own; the histories."""


def runs(seed: int) -> list[tuple[Plant, History, tuple[int, ...]]]:
    """The experiments under all assumptions, as arguments of `drift_of`."""
    six = fleet(seed)
    return [
        (_subject(actuator, effect), history, (seed, 7, number))
        for _, _, effect, histories in ASSUMPTIONS
        for number, (actuator, history) in enumerate(zip(six, histories, strict=True))
    ]


def grouped(drifts: Sequence[Drift]) -> tuple[Group, ...]:
    """Group the outcomes of the experiments by assumption."""
    return tuple(
        Group(name=name, assumption=assumption, histories=histories, drifts=tuple(drifts[6 * k : 6 * k + 6]))
        for k, (name, assumption, _, histories) in enumerate(ASSUMPTIONS)
    )


def _subject(actuator: Actuator, effect: Effect | None) -> Plant:
    """The actuator as it is, or its fabrication with another drift instead."""
    if effect is None:
        return actuator.plant
    return actuator.plant.without_effects(*(e.name for e in concealed_in(actuator))).with_effects(effect)


def drift_of(plant: Plant, history: History, seed: Sequence[int] | None) -> Drift:
    """Drive an actuator twice with the same noise; compare the second section's readings with the first's."""
    step = plant.rig.sample_time
    commands = band_limited_noise(np.random.default_rng(0), SECTION, step, mean=MEAN)
    before = _before(history, step)
    start = history.age if not before else before[-1].end + history.rest
    held = np.concatenate([commands, [MEAN]])
    sections = [Recording.from_arrays(held, np.zeros_like(held), step, start=start + t) for t in (0.0, SPAN)]
    experiment = Experiment(recordings=(*before, *sections))
    if seed is None:
        readings = [outputs[0] for outputs in plant.simulate(experiment).require().outputs[-2:]]
    else:
        recorded = plant.record(experiment, np.random.default_rng(tuple(seed)))
        readings = [r.outputs[0] for r in recorded.recordings[-2:]]
    early, late = (y[round(SETTLING / step) : commands.size] for y in readings)
    return between(early, late)


def between(early: ArrayLike, late: ArrayLike) -> Drift:
    """Compare readings of two runs of one and the same noise."""
    first, second = np.asarray(early, dtype=np.float64), np.asarray(late, dtype=np.float64)
    difference = second - first
    noise = np.std(np.diff(difference, 2)) / np.sqrt(6)
    slope = np.cov(second, first)[0, 1] / np.var(first, ddof=1)
    root = np.sqrt(first.size)
    return Drift(
        shift=float(difference.mean()),
        shift_error=float(noise / root),
        gain=float(slope - 1),
        gain_error=float(noise / (root * first.std())),
    )


def _before(history: History, step: float) -> tuple[Recording, ...]:
    if not history.hold:
        return ()
    command = np.full(round(history.hold / step), HELD)
    command[-1] = 0.0
    return (Recording.from_arrays(command, np.zeros_like(command), step),)


def sentence_of(groups: Sequence[Group]) -> str:
    """Summarise the outcome in one sentence."""
    six, alike, unlike = _sorted(groups)
    before, after = ([sum(g.rules_out(d) for d in six.drifts) for g in several] for several in (alike, unlike))
    return WORDS.text("repeatability", before=before, after=after)


def rows_of(groups: Sequence[Group]) -> list[Measure]:
    """Run the cases of the argument and summarise each."""
    from scipy.stats import f

    _, alike, unlike = _sorted(groups)
    rows = []
    for same, other in zip(alike, unlike, strict=True):
        spread, mean = same.spread[0], abs(same.sizes.mean())
        one_sign = bool(np.all(same.sizes > 0) or np.all(same.sizes < 0))
        free = same.sizes.size - 1
        # Chance exceeds the limit of a ratio of two such variances in 2.5 % of all cases.
        ratio, limit = (other.spread[0] / spread) ** 2, float(f.ppf(0.975, free, free))
        rows += [
            WORDS.measure(
                "repeats",
                one_sign and bool(spread < mean / 2),
                name=same.name.capitalize(),
                shifts=_range(same),
                share=100 * spread / mean,
            ),
            WORDS.measure("differs", ratio > limit, name=same.name, limit=limit, shifts=_range(other), ratio=ratio),
        ]
    return rows


def numbers(groups: Sequence[Group]) -> dict[str, Any]:
    """Return the numbers for the note on the argument."""
    six, (creep, relaxation), (strained, aged) = _sorted(groups)
    return {
        "creep_law": CREEP,
        "relaxation_law": RELAXATION,
        "span": SPAN,
        "error": 1e6 * max(d.shift_error for g in groups for d in g.drifts),
        "creep": _range(creep),
        "relaxation": _range(relaxation),
        "next_creep": _interval(creep),
        "next_relaxation": _interval(relaxation),
        "held": HELD,
        "strained": _range(strained),
        "rested": RESTS[-1] / CREEP.time,
        "back": 100 * strained.sizes[-1] / creep.sizes[-1],
        "aged": _range(aged),
        "kept": _shares(aged.sizes / relaxation.sizes),
        "alone": _shares(np.exp(-np.array(AGES) / RELAXATION.time)),
        "falls": int(np.sum(six.sizes < 0)),
    }


def table_of(groups: Sequence[Group]) -> Table:
    """Make the table of shifts, their spread, and the sizes that they rule out."""
    rows = []
    for group in groups:
        s, low, high = (1e6 * v for v in group.spread)
        gains = [100 * d.gain for d in group.drifts]
        several = [f"DEA {k}" for k, d in enumerate(groups[0].drifts, start=1) if group.rules_out(d)]
        excluded = "–" if group is groups[0] else ", ".join(several) or "none"
        shifts = [_range(group), f"{s:.1f} ({low:.1f} to {high:.1f})", _interval(group)]
        gain = f"{min(gains):.1f} to {max(gains):.1f}"
        rows.append([f"{group.name}, {group.assumption}", *shifts, gain, excluded])
    return WORDS.table("shifts", rows)


def _sorted(groups: Sequence[Group]) -> tuple[Group, tuple[Group, Group], tuple[Group, Group]]:
    """Return the six as they are; creep and relaxation with histories alike, and unlike."""
    six, creep, strained, relaxation, aged = groups
    return six, (creep, relaxation), (strained, aged)


def _range(group: Group) -> str:
    return f"{1e6 * group.sizes.min():.1f} to {1e6 * group.sizes.max():.1f} µm"


def _interval(group: Group) -> str:
    low, high = (1e6 * v for v in group.next_one)
    return f"{low:.1f} to {high:.1f} µm"


def _shares(values: NDArray[np.float64]) -> str:
    return ", ".join(f"{100 * v:.0f}" for v in values)
