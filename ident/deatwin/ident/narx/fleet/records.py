"""The fleet as recorded, and what the same actuators would have been recorded as with less physics.

A model of constant parameters cannot follow drift, and a polynomial of few past values no rate-independent hysteresis.
Each actuator is therefore recorded again, under the same commands and noise, without its history, then without both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from deatwin.ident.drifts import at_same_input
from deatwin.ident.narx.preprocess import (
    Finding,
    SamplingChoice,
    Sections,
    choose_sampling,
    choose_sections,
    inspect_recordings,
)
from deatwin.plant.fleet import TOLERANCES, Actuator, specification
from deatwin.plant.model import Plant
from deatwin.plant.recording import Recording

RECORDED, STEADY, FILM = "as recorded", "without its history", "without hysteresis too"
VARIANTS = (RECORDED, STEADY, FILM)
SEGMENTS = 40  # Segments of a recording whose statistics are compared: 27.5 s each, thirty correlation times
HELD_OUT = 100.0  # End of a stationary stretch, s, on which nothing is chosen or fitted; equally long for equal tests
SAMPLING_LAGS = 500  # Lags over which the correlation of a reading is examined


@dataclass(frozen=True, kw_only=True)
class Move:
    """A drift of an actuator's mean from one window of time to another."""

    number: int  # Number of the actuator
    early: tuple[float, float]  # Begin and end of the earlier window, s
    late: tuple[float, float]  # Begin and end of the later window, s
    sign: int  # 1 if the mean rises, -1 if it falls


MOVES = (
    Move(number=1, early=(0, 100), late=(1000, 1100), sign=-1),
    Move(number=2, early=(0, 100), late=(1000, 1100), sign=1),
    Move(number=3, early=(0, 100), late=(1000, 1100), sign=1),
    Move(number=4, early=(90, 190), late=(360, 460), sign=-1),
    Move(number=4, early=(360, 460), late=(640, 740), sign=1),
    Move(number=5, early=(0, 60), late=(200, 300), sign=-1),
    Move(number=5, early=(200, 300), late=(1000, 1100), sign=1),
    Move(number=6, early=(0, 45), late=(46, 146), sign=-1),
)
"""Drifts that the thesis reports for actuators 1, 2, 3 and 6, and those in the histories of 4 and 5."""
DRIFTING = ("DEA 1", "DEA 2", "DEA 3", "DEA 4", "DEA 5")
"""Actuators that drift throughout; the sixth shifts once, at 45 s, and is stationary afterwards."""


def as_variant(actuator: Actuator, variant: str) -> Actuator:
    """Remove physics from an actuator; fabrication, commands and sensor noise stay the same."""
    plant = actuator.plant
    if variant == RECORDED:
        return actuator
    film = plant.without_effects()
    if variant == STEADY:
        kept = [effect for effect in plant.effects if effect.name == "hysteresis"]
        values = {name: value for name, value in plant.values.items() if name.startswith("hysteresis.")}
        film = film.with_effects(*kept).with_values(values)
    return replace(actuator, plant=film)


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """An actuator with its recording and the findings on it."""

    actuator: Actuator
    recordings: Mapping[str, Recording]  # One recording for each of `VARIANTS`
    sections: Sections  # Stretches in which the reading at the same input is stationary
    sampling: SamplingChoice  # Sampling time that its correlation functions suggest
    findings: tuple[Finding, ...]  # Findings in the reading at the same input; nothing is corrected

    @property
    def name(self) -> str:
        """Name of the actuator."""
        return self.actuator.name

    @property
    def stretch(self) -> tuple[float, float]:
        """The longest stationary stretch, s; the complete recording if there is none."""
        record = self.recordings[RECORDED]
        if not self.sections.stretches:
            return record.start, record.end
        longest = self.sections.stretches[0]
        return longest.first * record.sample_time, longest.last * record.sample_time

    def split(self, variant: str, factor: int) -> tuple[Recording, Recording]:
        """Return training and held-out section of the stretch, with every `factor`-th sample."""
        record = self.recordings[variant]
        first, last = (round(time / record.sample_time) for time in self.stretch)
        whole = thinned(record.section(first, last), factor)
        cut = whole.n_samples - round(HELD_OUT / whole.sample_time)
        return whole.section(0, cut), whole.section(cut, whole.n_samples)


def prepare(actuator: Actuator) -> Prepared:
    """Record an actuator with and without parts of its physics, and find where it is stationary."""
    recordings = {variant: as_variant(actuator, variant).record().recordings[0] for variant in VARIANTS}
    record = recordings[RECORDED]
    level = replace(record, outputs=at_same_input(record.inputs[0], record.outputs[0], record.sample_time)[None])
    return Prepared(
        actuator=actuator,
        recordings=recordings,
        sections=choose_sections(level, n_segments=SEGMENTS),
        sampling=choose_sampling(record, n_lags=SAMPLING_LAGS),
        findings=inspect_recordings(level),
    )


def thinned(record: Recording, factor: int) -> Recording:
    """Keep every `factor`-th sample, without filtering."""
    return replace(
        record,
        inputs=record.inputs[:, ::factor],
        outputs=record.outputs[:, ::factor],
        sample_time=record.sample_time * factor,
    )


def at_tolerance(name: str) -> Plant:
    """Return the specification with one quantity at the upper end of its tolerance."""
    wished, factor = specification(), 1 + TOLERANCES[name].share
    if hasattr(wished.rig, name):
        return wished.with_rig(replace(wished.rig, **{name: factor * getattr(wished.rig, name)}))
    return wished.with_values({name: factor * wished.parameters[name].value})
