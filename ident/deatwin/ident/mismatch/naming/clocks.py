"""Effects with one common time constant: one mechanism that acts at two places looks like two effects."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from deatwin.ident.greybox.fit import Calibration
from deatwin.ident.mismatch.likelihood.beforehand import RATE
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.plant.calibrated import TWO_SIDED_95

DRIFTS = frozenset({"permittivity_drift", "prestretch_relaxation", "sensor_drift"})
"""Effects that follow the clock by the same law, an exponential."""
INTERVAL = 2.0 * TWO_SIDED_95
"""Width of a 95 % interval, in standard deviations."""


def of_one_clock(candidate: Candidate) -> tuple[str, ...]:
    """Return two drifts of an explanation that probably have one common time constant, or an empty tuple."""
    # A film that stiffens with age sags less and has less gain, which looks like a drift of the zero and one of the
    # permittivity; two independent mechanisms would not have equal rates. Let d be the difference of the logarithms of
    # both time constants, and s its standard deviation. The density of d is N(0, s²) for one common time constant, and
    # N(0, 2 r²) for two whose logarithms have the prior deviation r.
    fit = candidate.calibration
    times = {name: _time(fit, name) for name in candidate.effects if name in DRIFTS and f"{name}.time" in fit.names}
    for one, other in combinations(times, 2):
        apart = times[one][0] - times[other][0]
        chance, known = np.sqrt(2.0) * RATE, np.hypot(times[one][1], times[other][1])
        if known > 0.0 and np.log(chance / known) > 0.5 * apart**2 * (known**-2 - chance**-2):
            return one, other
    return ()


def _time(fit: Calibration, name: str) -> tuple[float, float]:
    """Return the logarithm of an effect's time constant, and its standard deviation."""
    low, high = np.log(fit.interval(f"{name}.time"))
    return float(np.log(fit.plant.parameters[f"{name}.time"].value)), float(high - low) / INTERVAL
