"""The test signal against convolutions and closed forms; how contributions cancel."""

from itertools import product

import numpy as np
import pytest
from made_narx import trained_on

from deatwin.ident import frequency
from deatwin.ident.frequency.output_responses.excitation import design_excitation
from deatwin.ident.frequency.output_responses.powers import input_spectrum, output_frequencies
from deatwin.plant.errors import ModelError

SAMPLE_TIME = 0.02


def operating(low, high, centre):
    return trained_on((low, high), (0.0, 1.0), input_centre=centre)


@pytest.mark.parametrize("band", [(0.0, 1.0), (0.4, 1.0)])
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_powers_have_the_spectra_of_convolved_boxes(band, order):
    signal = design_excitation(band, SAMPLE_TIME, amplitude=7e-13, period=20.0)
    lines = np.arange(-20, 21)
    box = ((np.abs(lines) >= round(band[0] * 20)) & (np.abs(lines) <= 20)).astype(float)
    box *= 7e-13 / box.sum()  # all lines add to the amplitude at the pulse
    convolved = np.array([1.0])
    for _ in range(order):
        convolved = np.convolve(convolved, box)
    expected = convolved[order * 20 :]  # from line 0
    spectrum = signal.input_spectrum(order)
    # FFT of 1000 samples: rounding is some eps of the largest
    np.testing.assert_allclose(spectrum.values[: expected.size], expected, atol=1e-14 * expected.max(), rtol=1e-10)
    np.testing.assert_array_equal(spectrum.in_range[: expected.size], expected > 1e-12 * expected.max())
    assert not spectrum.in_range[expected.size :].any()
    np.testing.assert_allclose(spectrum.amplification[spectrum.defined], 1.0, rtol=1e-9)
    assert spectrum.suitable


def test_it_is_the_band_limited_pulse_of_the_thesis():
    # u*(t) ~ (sin(2 pi b t) - sin(2 pi a t)) / t, summed over all periods, has lines of equal size in [a, b]; with 200
    # periods on either side the sum has converged to some 1e-4 of the pulse (its tails fall as 1/t with changing sign).
    low, high, n = 0.42, 1.03, 1000  # between lines, so that no line lies on the edge of the band
    t = np.arange(-200 * n, 201 * n) * SAMPLE_TIME
    pulse = 2 * high * np.sinc(2 * high * t) - 2 * low * np.sinc(2 * low * t)
    wrapped = np.bincount(np.arange(t.size) % n, weights=pulse, minlength=n)
    signal = design_excitation((low, high), SAMPLE_TIME, amplitude=1.0, period=n * SAMPLE_TIME)
    np.testing.assert_allclose(wrapped / wrapped[0], signal.values, atol=2e-3)


def test_amplitude_and_crest_factor():
    signal = design_excitation((0.0, 1.0), SAMPLE_TIME, amplitude=0.7)
    assert np.abs(signal.values).max() == signal.amplitude == 0.7
    assert signal.crest_factor == pytest.approx(np.sqrt(41))  # 41 lines of either sign: 41 c by sqrt(41) c
    assert signal.period == pytest.approx(20.0)
    assert signal.band_Hz == pytest.approx((0.0, 1.0))
    without_mean = design_excitation((0.1, 1.0), SAMPLE_TIME, amplitude=0.7)
    assert without_mean.crest_factor == pytest.approx(np.sqrt(2 * 19))
    assert without_mean.values.mean() == pytest.approx(0.0, abs=1e-15)


def test_the_amplitude_stays_within_the_training_data():
    signal = design_excitation((0.0, 1.0), SAMPLE_TIME, operating=operating(1.1, 3.75, 2.0))
    assert signal.amplitude == pytest.approx(0.9)
    for level in (-1.0, 1.0):
        driven = 2.0 + level * signal.values
        assert driven.min() >= 1.1 - 1e-12
        assert driven.max() <= 3.75


def test_it_is_an_array_and_immutable():
    signal = design_excitation((0.0, 1.0), SAMPLE_TIME, amplitude=0.7, unit="V")
    assert isinstance(signal, frequency.TestSignal)
    np.testing.assert_array_equal(np.asarray(signal), signal.values)
    assert len(signal) == 1000
    with pytest.raises(ValueError, match="read-only"):
        signal.values[0] = 1.0
    assert signal.input_spectrum(2).unit == "V^2"


def test_it_is_scaled():
    signal = design_excitation((0.1, 1.0), SAMPLE_TIME, amplitude=8.0, unit="V")
    quarter = signal.scaled(-0.25)
    np.testing.assert_array_equal(quarter.values, -0.25 * signal.values)
    assert (quarter.amplitude, quarter.sample_time, quarter.band_Hz, quarter.unit) == (
        2.0,
        signal.sample_time,
        signal.band_Hz,
        "V",
    )
    for factor, text in ((np.inf, "finite"), (1e308, "finite"), ("a", "real numbers")):
        with pytest.raises(ModelError, match=text):
            signal.scaled(factor)


def test_two_tones_that_cancel():
    # cos wt + c cos 3wt: the square has (1 + 2c)/4 at 2w from w + w and 3w - w, in phase (1 + 2|c|)/4
    t = 2 * np.pi * np.arange(64) / 64
    spectrum = input_spectrum(np.cos(t) - 0.25 * np.cos(3 * t), 2, SAMPLE_TIME)
    assert spectrum.values[2] == pytest.approx((1 - 0.5) / 4)
    assert spectrum.amplification[2] == pytest.approx(3.0)
    assert spectrum.suitable
    gone = input_spectrum(np.cos(t) - 0.5 * np.cos(3 * t), 2, SAMPLE_TIME)
    assert gone.in_range[2]
    assert not gone.defined[2]
    assert gone.amplification[2] == np.inf
    assert not gone.suitable


def test_leakage_outside_the_band_does_not_count():
    # the pulse of the thesis, cut off after 20 s: its skirts are not periodic, but nobody means to excite there
    t = np.arange(-511, 513) * SAMPLE_TIME
    pulse = 3.0 * np.sinc(2 * t)
    for order in (1, 2, 3):
        assert input_spectrum(pulse, order, SAMPLE_TIME).suitable


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"band_Hz": (1.0, 0.5)}, "low <= high"),
        ({"band_Hz": (0.0, 25.0)}, "half the sampling rate"),
        ({"band_Hz": (0.0, 0.0)}, "low, high"),
        ({"band_Hz": (0.0, np.nan)}, "low, high"),
        ({"sample_time": 0.0}, "sample_time"),
        ({"amplitude": 0.0}, "must be positive"),
        ({"amplitude": np.nan}, "must be positive"),
        ({"amplitude": None}, "either the amplitude or"),
        ({"operating": operating(0.0, 1.0, 0.5)}, "either the amplitude or"),
        ({"amplitude": None, "operating": operating(0.0, 1.0, 1.0)}, "must be positive"),
        ({"band_Hz": (0.91, 0.92), "period": 5.0}, "longer period"),
        ({"period": 0.01}, "two samples"),
        ({"period": np.nan}, "two samples"),
        ({"period": 1e15}, "at most 10000000, 200000 s"),
        ({"period": 1e308}, "at most 10000000"),
        ({"period": "a"}, "the period must be real numbers"),
        ({"band_Hz": (0.0, 1e-12)}, "at most 10000000"),
        ({"sample_time": "a"}, "sample_time must be real numbers"),
        ({"amplitude": "a"}, "the amplitude must be real numbers"),
    ],
)
def test_what_cannot_be_designed_is_said(given, text):
    usual = {"band_Hz": (0.0, 1.0), "sample_time": SAMPLE_TIME, "amplitude": 1.0}
    with pytest.raises(ModelError, match=text):
        design_excitation(**(usual | given))


@pytest.mark.parametrize(
    ("record", "order", "text"),
    [
        (np.zeros(10), 2, "zero"),
        ([1.0, np.nan], 2, "sample 1 of the excitation is nan"),
        (1e200 * np.ones(4), 2, "power 2 of an excitation up to 1e.200 leaves the range"),
        (1e-200 * np.ones(4), 2, "leaves the range"),
        ([5e-324, 0.0], 1, "leaves the range"),
        ([2.0, 1.0], 2000, "leaves the range"),
        ([1.0], 2, "shape"),
        ([[1.0, 2.0]], 2, "shape"),
        ([1.0, 2.0], 0, "order = 0"),
    ],
)
def test_what_has_no_spectrum_is_said(record, order, text):
    with pytest.raises(ModelError, match=text):
        input_spectrum(record, order, SAMPLE_TIME)


def test_a_spectrum_as_a_dataset():
    spectrum = design_excitation((0.4, 1.0), SAMPLE_TIME, amplitude=0.7, unit="V").input_spectrum(2)
    written = spectrum.to_xarray()
    np.testing.assert_array_equal(written["real"] + 1j * written["imaginary"], spectrum.values)
    np.testing.assert_array_equal(written["frequency"], spectrum.frequency_Hz)
    np.testing.assert_array_equal(written["amplification"].where(written["in_range"]), spectrum.amplification)
    assert written.attrs["order"] == 2
    assert written["in_phase"].attrs["units"] == "V^2"


def test_plots_name_their_axes():
    signal = design_excitation((0.0, 1.0), SAMPLE_TIME, amplitude=0.7, unit="V")
    assert signal.plot().get_ylabel() == "input (V)"
    axes = signal.input_spectrum(2).plot()
    assert axes.get_xlabel() == "frequency (Hz)"
    assert axes.get_ylabel() == "input spectrum (V$^2$)"


def sums(low, high, order):
    """All |w_1 + ... + w_n| of integer lines of either sign."""
    lines = [sign * k for sign in (-1, 1) for k in range(low, high + 1)]
    return {abs(sum(chosen)) for chosen in product(lines, repeat=order)}


def integers_in(bands):
    return {k for low, high in bands for k in range(int(np.ceil(low - 1e-9)), int(np.floor(high + 1e-9)) + 1)}


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("band", [(0, 3), (1, 4), (3, 5), (7, 9), (5, 5)])
def test_the_bands_hold_the_sums_of_lines_and_nothing_else(band, order):
    # Lines one apart fill every interval of sums, except those of a single line, whose intervals are points.
    assert integers_in(output_frequencies(band, order)) == sums(*band, order)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize(("band", "n_samples"), [((1, 4), 16), ((3, 5), 11), ((6, 8), 16), ((5, 5), 13), ((0, 3), 7)])
def test_sampling_folds_the_sums(band, n_samples, order):
    # n lines to the circle: line k of a period of n samples is 2 pi k / n rad per sample
    step = 2 * np.pi / n_samples
    bands = output_frequencies(np.array(band) * step, order, sample_time=1.0)
    folded = {min(k % n_samples, -k % n_samples) for k in sums(*band, order)}
    assert integers_in(bands / step) == folded


def test_a_band_beyond_many_half_sampling_rates_fills_everything():
    nyquist = np.pi / 0.1
    np.testing.assert_allclose(output_frequencies((1.0, nyquist), 5, sample_time=0.1), [[0.0, nyquist]])


@pytest.mark.parametrize(
    ("band", "order", "sample_time", "text"),
    [
        ((2.0, 1.0), 2, None, "low <= high"),
        ((-1.0, 1.0), 2, None, "low <= high"),
        ((1.0, np.nan), 2, None, "low <= high"),
        ((1.0, np.inf), 2, None, "low <= high"),
        ((1.0, 2.0, 3.0), 2, None, "low, high"),
        ((1.0, 2.0), 0, None, "order = 0"),
        ((1.0, 2.0), 1.5, None, "order = 1.5"),
        ((1.0, 2.0), 2, -1.0, "sample_time"),
        ((1.0, 40.0), 2, 0.1, "half the sampling rate"),
        ((0.0, 1e308), 3, None, "sums of 3 such frequencies overflow"),
        ((1.0, 2.0), 2, "a", "sample_time must be real numbers"),
    ],
)
def test_what_cannot_be_is_said(band, order, sample_time, text):
    with pytest.raises(ModelError, match=text):
        output_frequencies(band, order, sample_time=sample_time)
