"""A reading that a rig could have, as shown by a diagnosis and a plan."""

from __future__ import annotations

from dataclasses import dataclass

from deatwin.plant.prefixes import with_unit
from deatwin.plant.words import spaced

THERMOMETER = "room_temperature"
"""Signal of the room's temperature, which an effect assumes if no thermometer was read."""
WORDS = {"film_voltage": "the voltage on the film", THERMOMETER: "the temperature"}
"""Words for readings that are not called by their names."""


@dataclass(frozen=True, kw_only=True)
class SensorOffer:
    """A reading that the rig could have."""

    reading: str  # name of the signal
    unit: str  # SI
    noise: float  # standard deviation, SI
    noise_source: str  # source of `noise`

    @property
    def words(self) -> str:
        """The reading with its noise, as part of a sentence."""
        return f"{in_words(self.reading)} measured with a noise of {with_unit(self.noise, self.unit)} rms"


@dataclass(frozen=True, kw_only=True)
class PricedReading(SensorOffer):
    """Reading that was not recorded, with a measure of how well it would distinguish the explanations.

    Parameters
    ----------
    reading, unit : str
        Name of the signal, and its SI unit.
    noise : float
        Standard deviation of the reading's noise, SI.
    noise_source : str
        Source of the value of `noise`.
    log_odds : float
        Natural logarithm of the odds of the true explanation over the nearest other explanation, if this reading is
        added to the existing recordings; the reading is simulated with noise. A negative value means that the other
        explanation would still be preferred.
    resolves : bool
        True if the reading distinguishes all explanations.
    """

    log_odds: float
    resolves: bool


def in_words(reading: str) -> str:
    """Write the name of a reading as part of a sentence."""
    return WORDS.get(reading, f"the {spaced(reading)}")
