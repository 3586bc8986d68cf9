"""Measurement noise in `deatwin identify`: a biased one-step fit is found by the free run of its terms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from deatwin.app.identify_noise import biased_by_noise
from deatwin.ident.narx import SvbNarx
from deatwin.ident.narx.assessed import hold_out
from deatwin.plant.recording import Recording


@pytest.mark.parametrize("on_readings", [True, False])
def test_noise_on_the_readings_is_told_from_noise_in_the_dynamics(on_readings):
    """An oscillator with a damping ratio of 0.33: least squares is biased by the former and, as theory has it, not by the latter."""
    said = 0
    for seed in range(6):
        rng = np.random.default_rng([seed, 17])
        a, u = [1.0, -1.7, 0.8], rng.uniform(-1, 1, 1500)
        y, noise = lfilter([0.0, 0.1], a, u), rng.normal(size=1500)
        noise = noise if on_readings else lfilter([1.0], a, noise)
        record = Recording.from_arrays(u, y + 0.05 * y.std() / noise.std() * noise, 0.1)
        training, unseen = hold_out(record)
        model = SvbNarx(degree=1).fit(training).model_
        said += bool(biased_by_noise(model, training, unseen))
    assert said == (6 if on_readings else 0)
