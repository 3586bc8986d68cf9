"""The columns of a recording that deatwin writes."""

import re

from deatwin.plant.files.headers import split_unit
from deatwin.plant.files.units import UNITS

USUAL_TIMES = "time_s"  # Header of the times in files that deatwin writes
LIKE_TIMES = re.compile("(?i)time|stamp|clock|millis|zeit|dat[eu]|temps|heure|hora|tiempo|fecha|^ts?$")
"""Words in the names of columns that hold times."""
COLUMNS = {
    "time": USUAL_TIMES,
    "command": "command_V",
    "displacement": "displacement_mm",
    "film_voltage": "film_voltage_V",
    "current": "current_uA",
    "capacitance": "capacitance_pF",
    "temperature": "temperature_C",
    "force": "force_N",
}
"""Header of each signal, by its internal name."""


def usual_unit(name: str) -> str:
    """Return the SI unit of a signal with one of deatwin's own names, an empty text for others.

    >>> usual_unit("temperature"), usual_unit("humidity")
    ('K', '')
    """
    return UNITS[split_unit(COLUMNS[name])[1]].si if name in COLUMNS else ""
