"""Sample times that remarks and settings in a file state, for files without a column of times."""

import re
from collections.abc import Iterable, Sequence
from itertools import pairwise

from deatwin.plant.files.csvcells import is_number
from deatwin.plant.files.headers import LONGEST
from deatwin.plant.files.units import UNITS, find_unit

_RATE = (
    r"(?:sampl(?:e|es|ing)|scan|acquisition|acq|logging|log|daq|adc|abtast|mess)[ _-]?(?:rate|freq(?:uency)?|frequenz)"
)
_STEP = (
    r"(?:sampl(?:e|ing)|scan|logging|abtast|mess)[ _-]?(?:intervall?|periode?)|(?:acquisition|record|time)[ _-]?interval"
    r"|sampl(?:e|ing)[ _-]?time|abtastzeit|time[ _-]?step"
)
_SHORT_STEP = r"d[_ ]?t|[Δ∆][tx]|delta[ _-]?[tx]|t[_ ]?s|[tx]?[ _-]?inc(?:rement)?"
_UNIT = r"\s*(?:[(\[]\s*(?P<unit>[^\s()\[\]]+)\s*[)\]])?[\"']?\s*"
_STATED = re.compile(
    rf"(?i)(?<![^\W_])(?:(?P<rate>{_RATE}|(?-i:[fF][_ ]?s)(?=[^,;]*[=:]))|(?P<step>{_STEP}|(?:{_SHORT_STEP})(?=[^,;]*[=:]))){_UNIT}"
    r"[:=,;\t]*\s*[\"']?\s*(?P<number>\d+(?:\.\d*)?(?:e[-+]?\d+)?)(?![.,'’]?\d|[\u00a0\u202f ]\d{3}(?!\d)|[:/-])\s*(?P<behind>[^\W\d]+(?:/[^\W\d]+)?|/s)?"
)
_SAMPLES = re.compile(r"(?i)(?P<prefix>[kM]?)(?:S|Sa|samples?|Hz|sps)(?:/s|/sec|ps)?|/s|1/s")
_A_RATE = re.compile(r"\d\s*[kM]?(?:Hz|Sa?/s|sps)\b")  # Another rate in the line, so that none is certain
_LARGE = {"": 1.0, "k": 1e3, "M": 1e6}


def sample_time_in(lines: Sequence[str], cells: Iterable[Sequence[str]] = ()) -> tuple[str, float] | None:
    """Return what lines above the samples say of the sample time, and the time, s; None if they say nothing.

    >>> sample_time_in(["# Sample rate: 2 kHz"]), sample_time_in(["Sampling interval,20ms"])
    (('Sample rate: 2 kHz', 0.0005), ('Sampling interval,20ms', 0.02))
    >>> sample_time_in(["u,x,Start,Increment"], [["u", "x", "Start", "Increment"], ["V", "mm", "0", "2e-3"]])
    ('Increment = 2e-3', 0.002)
    >>> sample_time_in(["# sample time: 12:30", "# fs, 50 samples of dt", "# rate of the camera: 25 Hz, laser 1000 Hz"])
    >>> sample_time_in(["# sample rate: 1,000 Hz", "# load cell FS = 50", "# Ts = 25 (room)", "# Ts = 20 ms"])
    ('Ts = 20 ms', 0.02)
    """
    stated = []
    for line in (line for line in lines if len(line) <= LONGEST):
        for found in _STATED.finditer(line):
            others = _A_RATE.search(line[: found.start()]) or _A_RATE.search(line[found.end() :])
            if (step := _step(found)) is not None and not others:
                stated.append((found[0].strip(), step))
    if stated:
        return stated[0] if len({step for _, step in stated}) == 1 else None
    rows = list(cells)
    pairs = [(row[0], row[1]) for row in rows if len(row) == 2]
    pairs += [pair for above, below in pairwise(rows) for pair in zip(above, below, strict=False)]
    for name, number in pairs:
        whole = _STATED.fullmatch(f"{name} = {number}") if is_number(number) else None
        if whole and (step := _step(whole)) is not None:
            return whole[0], step
    return None


def _step(found: re.Match[str]) -> float | None:
    """Return the sample time of a match, s; None if its unit is none of a rate or a time."""
    number, unit = float(found["number"]), found["unit"] or found["behind"] or ""
    if not number > 0.0:
        return None
    if found["rate"]:
        known = _SAMPLES.fullmatch(unit or "Hz")
        return 1.0 / (number * _LARGE[known["prefix"] or ""]) if known else None
    if not unit and re.fullmatch(r"(?i)t[_ ]?s", found["step"]):  # which may be a temperature
        return None
    seconds = UNITS[find_unit(unit) or "s"] if not unit or find_unit(unit) else None
    return None if seconds is None or seconds.si != "s" else number * seconds.numerator / seconds.denominator
