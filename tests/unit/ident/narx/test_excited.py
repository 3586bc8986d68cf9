"""What a recording excited: a band without holes for broad inputs, and holes for tones."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from deatwin.ident.narx import Excitation, excitation, excited_band
from deatwin.ident.narx.excited import BAND_KEY, HOLES_KEY
from deatwin.plant import DataError, ModelError, Recording
from deatwin.plant.excitation import (
    band_limited_noise,
    linear_chirp,
    logarithmic_chirp,
    random_holds,
    random_odd_harmonics,
    random_phase_multisine,
)

H, SECONDS = 0.02, 60.0
T = H * np.arange(round(SECONDS / H))
LINE = 1 / SECONDS


def recorded(command: np.ndarray) -> Recording:
    return Recording.from_arrays(command, np.zeros_like(command), H)


def tones(*frequencies: float) -> np.ndarray:
    return 2.4 + sum(0.3 * np.sin(2 * np.pi * f * T + f) for f in frequencies)


def multisine(rng: np.random.Generator) -> np.ndarray:
    """Odd lines of a period of 30 s up to 1 Hz, one of three left out at random: 0.2 Hz apart at most."""
    excited, _ = random_odd_harmonics(rng, 30.0, 1.0)
    return random_phase_multisine(rng, 30.0, H, excited, rms=0.3, periods=2)


BROAD = {
    "noise up to 1 Hz": partial(band_limited_noise, duration=SECONDS, sample_time=H),
    "noise up to 4 Hz": partial(band_limited_noise, duration=SECONDS, sample_time=H, band=4.0),
    "random holds": partial(random_holds, duration=SECONDS, sample_time=H, lower=1.5, upper=3.0),
    "a multisine": multisine,
}


@pytest.mark.parametrize("name", BROAD)
def test_a_broad_input_has_no_hole_and_the_band_of_before(name: str) -> None:
    for seed in range(20):
        record = recorded(BROAD[name](np.random.default_rng(seed)))
        assert excitation(record).bands == ((0.0, excited_band(record)),), (name, seed)


@pytest.mark.parametrize("at", [0.2, 1 / 3, 0.5, 0.8])
def test_a_step_wherever_it_comes_has_no_hole(at: float) -> None:
    for command in ((T >= at * SECONDS) * 1.0, ((T >= at * SECONDS) & (T < at * SECONDS + 5.0)) * 1.0):
        record = recorded(command)
        assert excitation(record).bands == ((0.0, excited_band(record)),)


@pytest.mark.parametrize("period", [2.7, 6.0, 20.0])
def test_the_odd_harmonics_of_a_square_wave_are_dense(period: float) -> None:
    assert excitation(recorded(np.sign(np.sin(2 * np.pi * (T + 0.01) / period)))).holes == ()


@pytest.mark.parametrize("chirp", [linear_chirp, logarithmic_chirp])
def test_a_chirp_excites_what_it_sweeps_and_nothing_below(chirp) -> None:
    found = excitation(recorded(chirp(SECONDS, H, first=2.0, last=8.0)))
    ((low, high),) = found.bands
    assert 1.2 < low < 2.0 and high == excited_band(recorded(chirp(SECONDS, H, first=2.0, last=8.0)))
    assert found.hole_at(1.0) == (0.0, low) and found.hole_at(5.0) is None
    slow = recorded(chirp(SECONDS, H, first=0.1, last=2.0))
    assert excitation(slow).bands == ((0.0, excited_band(slow)),)


@pytest.mark.parametrize(("slow", "fast"), [(0.2, 1.0), (0.31, 0.93), (5.0, 8.0)])
@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_two_tones_have_a_hole_between_them(slow: float, fast: float, noise: float) -> None:
    """Each speaks for a sixth of an octave or a tenth of the band; the window smears it over a few lines."""
    command = tones(slow, fast) + noise * np.random.default_rng(0).standard_normal(T.size)
    found = excitation(recorded(command))
    assert excited_band(recorded(command)) == found.highest_Hz
    middle = found.hole_at(0.5 * (slow + fast))
    sixth, tenth = 2 ** (1 / 6), 0.1 * found.highest_Hz
    expected = max(slow * sixth, slow + tenth), min(fast / sixth, fast - tenth)
    assert middle == pytest.approx(expected, abs=4 * LINE)
    assert found.hole_at(slow) is found.hole_at(fast) is None


def test_bad_recordings_are_refused_as_for_the_band() -> None:
    for command, words in ((np.ones(100), "constant"), (T[:100], "ramp"), (np.arange(10) % 3.0, "10 samples")):
        for function in (excitation, excited_band):
            with pytest.raises(DataError, match=words):
                function(recorded(command))


HOLED = Excitation(bands=((0.25, 0.5), (1.5, 2.0)))


def test_a_model_carries_it_and_an_older_one_is_read() -> None:
    assert HOLED.provenance == {BAND_KEY: "2", HOLES_KEY: "0 to 0.25, 0.5 to 1.5"}
    for one in (HOLED, Excitation(bands=((0.0, 0.5), (1.5, 2.0))), Excitation(bands=((0.0, 1.25),))):
        assert Excitation.of_provenance(one.provenance) is not None
        assert Excitation.of_provenance(one.provenance).bands == one.bands  # type: ignore[union-attr]
    old = Excitation.of_provenance({BAND_KEY: "1.25"})
    assert old is not None and old.bands == ((0.0, 1.25),) and old.holes == ()
    assert Excitation.of_provenance({}) is None


@pytest.mark.parametrize(
    "written", ["wide", "0.5", "0.5 to", "1 to 0.5", "0.5 to 3", "-1 to 1", "nan to 1", "0.5 to 1, 0.8 to 1.5"]
)
def test_holes_that_are_none_are_refused(written: str) -> None:
    with pytest.raises(ModelError, match="rising frequencies below 2"):
        Excitation.of_provenance({BAND_KEY: "2", HOLES_KEY: written})


def test_several_recordings_fill_each_other_s_holes() -> None:
    slow = Excitation(bands=((0.0, 0.75),))
    assert Excitation.joined([HOLED, slow]).bands == ((0.0, 0.75), (1.5, 2.0))
    assert Excitation.joined([HOLED, slow, Excitation(bands=((0.7, 1.6),))]).bands == ((0.0, 2.0),)
    assert Excitation.joined([HOLED]).bands == HOLED.bands


def test_bands_rise_and_lie_apart() -> None:
    for bands in ((), ((1.0, 0.5),), ((0.0, 1.0), (0.5, 2.0)), ((-1.0, 1.0),), ((0.0, np.inf),)):
        with pytest.raises(ModelError, match="rising and apart"):
            Excitation(bands=bands)
