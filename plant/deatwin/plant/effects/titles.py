"""Names of effects in words."""

from __future__ import annotations

import re

from deatwin.plant.effects.catalogue import effect_named
from deatwin.plant.errors import RigError
from deatwin.plant.words import spaced


def effects_in_words(names: str) -> str:
    """Write names of effects as words; an effect at a further place has its title there.

    >>> effects_in_words("creep + sensor_drift_at_command_gain"), effects_in_words("own_effect_at_reading")
    ("creep + drift of the amplifier's gain", 'own effect acting on the reading')
    """
    return spaced(re.sub(r"\w+_at_\w+", lambda found: _title(found[0]), names))


def _title(name: str) -> str:
    """Return the title of an effect at a further place; one that is not in the catalogue is named with its place."""
    try:
        return effect_named(name).title
    except RigError:
        return name.replace("_at_", " acting on the ")
