"""The size of the plant's own error after a fit."""

import numpy as np
import pytest

from deatwin.ident.mismatch.likelihood.beforehand import TIMING, OwnError
from deatwin.ident.mismatch.likelihood.several import OwnErrors

N, DT, NOISE = 2000, 0.02, 1e-6
TIMES = DT * np.arange(N)
READINGS = 1e-4 * np.sin(2 * np.pi * 3.0 * TIMES)


@pytest.mark.parametrize("late", [0.0, 0.05])
def test_timing_keeps_the_size_that_residuals_show_and_bends_that_of_the_rig(late: float) -> None:
    own = OwnError(
        readings=READINGS,
        times=TIMES,
        records=np.zeros(N, dtype=int),
        sample_time=DT,
        noise=NOISE,
        stated=1e-6,
    )
    errors = OwnErrors(of=(own,), at=(np.arange(N),))
    noise = NOISE * np.random.default_rng(0).standard_normal(N)
    residuals = np.gradient(READINGS, DT) * late * DT + noise
    # The fit's own gain and level; neither does what a shift in time does.
    columns = errors.columns_after(residuals, np.column_stack([READINGS, np.ones(N)]))
    sizes = np.linalg.norm(columns, axis=0) / np.linalg.norm(errors.columns, axis=0)
    timing = own.of_timing
    assert timing.sum() == 1 and sizes[~timing] == pytest.approx(1.0)
    # Known from so many samples to 0.001 of a sample: noise / (largest velocity * sample time * sqrt(n / 2)).
    assert sizes[timing] == pytest.approx(late / TIMING, abs=4 * 0.001 / TIMING)
