"""Orders and bands of the frequency response in which simulation and recordings differ.

The same model structure is fitted to the recorded and to the simulated readings, which share their input. Physics that
it cannot represent is missing from both models, so these differ where plant and actuator do. The simulated readings
have no noise, so they serve as instruments for the recorded ones; with least squares, the noise of past readings would
shrink the feedback. Block by block the two scatter alike, so their differences are tested.

Reference: Söderström, Stoica, "Instrumental variable methods for system identification", Circuits Syst. Signal Process.
21 (2002) 1-9.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import factorial, sqrt

import numpy as np

from deatwin.ident.frequency.comparison.bands import BandMean, Range, Scatter, band_means, equality, holm
from deatwin.ident.mismatch.located import ResponseDifference
from deatwin.ident.mismatch.thresholds import CHANCE, PRACTICAL_SHARE
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.robust import Cosines, pseudovalues
from deatwin.ident.narx.terms import AtMost, generate_terms
from deatwin.plant.drawing import Axes, axes_or_new
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

Array = np.ndarray

ORDERS = (1, 2, 3)
BANDS = ((0.0, 0.1), (0.1, 0.3), (0.3, 1.0))
"""Bands of frequency, as shares of the frequency up to which the readings move."""
MOVING = 0.95
"""Share of the readings' power that lies below that frequency."""
SAMPLES = 8
"""Smallest number of samples per period of that frequency."""
TERMS = generate_terms(1, (0, 1), 3, rule=AtMost(output=1))
"""Terms of the models, affine in the past reading, so that instruments average out its noise."""


def locate_response(
    recordings: Sequence[Recording], readings: Sequence[Array], model_error: float
) -> tuple[ResponseDifference, ...] | None:
    """Find where the response of the recordings is not that of the plant, by order, then by band.

    The plant's free-run readings, (n,) each, and the rms `model_error` are in SI. Empty if no difference can be shown;
    None if the recordings are too short or too poor for a test.
    """
    # Only the first input and the first output are compared. A difference of an order counts only beyond the model
    # error, which is assumed to be spread over frequencies as the input is.
    longest = max(reading.size for reading in readings)
    pairs = [(r, y) for r, y in zip(recordings, readings, strict=True) if y.size >= PRACTICAL_SHARE * longest]
    if not any(np.ptp(y) > 0.0 for _, y in pairs):
        return None  # a plant that stands still has no response
    step = pairs[0][0].sample_time
    top = _top_frequency([y for _, y in pairs], step)
    factor = max(1, int(1 / (SAMPLES * top * step)))
    measured = [_thinned(record, record.outputs[0], factor) for record, _ in pairs]
    simulated = [_thinned(record, reading, factor) for record, reading in pairs]
    try:
        found = _compared(measured, simulated, [(low * top, high * top) for low, high in BANDS], model_error)
    except (ModelError, np.linalg.LinAlgError):
        return None  # too short or too poor for responses of these orders
    corrected = holm([difference.p_value for difference in found])
    return tuple(
        replace(difference, p_value=float(p)) for difference, p in zip(found, corrected, strict=True) if p < CHANCE
    )


def draw_response(found: Sequence[ResponseDifference], ax: Axes | None = None) -> Axes:
    """Draw the size of the difference of each order in each band, with its p-value."""
    axes = axes_or_new(ax)
    names = [f"$H_{d.order}$, {d.from_Hz:.2g} to {d.to_Hz:.2g} Hz" for d in found]
    bars = axes.barh(names, [100 * d.size for d in found], color="C0")
    axes.bar_label(bars, [f"p = {d.p_value:.2g}" for d in found], fontsize="small", padding=3)
    axes.margins(x=0.2)
    axes.invert_yaxis()
    axes.set_xlabel("difference of the response over that of the plant (%)")
    return axes


def _top_frequency(readings: Sequence[Array], sample_time: float) -> float:
    """Return the frequency below which readings have nearly all of their power, Hz."""
    from scipy.signal import welch

    segment = min(reading.size for reading in readings)
    total = np.sum([welch(y, 1 / sample_time, nperseg=segment)[1] * y.size for y in readings], axis=0)[1:]
    share = np.cumsum(total) / total.sum()
    return float(np.fft.rfftfreq(segment, sample_time)[1:][np.searchsorted(share, MOVING)])


def _thinned(record: Recording, reading: Array, factor: int) -> Recording:
    return Recording.from_arrays(record.inputs[0, ::factor], reading[::factor], record.sample_time * factor)


def _compared(
    measured: Sequence[Recording], simulated: Sequence[Recording], bands: Sequence[Range], model_error: float
) -> list[ResponseDifference]:
    """Test each order and band, without correction for the number of tests."""
    plant = Fixed(terms=TERMS).fit(simulated).model_
    actuator = _with_instruments(plant, measured, simulated)
    commands = np.concatenate([record.inputs[0] for record in simulated])
    ours, theirs = (
        band_means(model, ORDERS, bands, operating_input=float(commands.mean())) for model in (plant, actuator)
    )
    own, other = pseudovalues(plant, simulated), pseudovalues(actuator, measured, instruments=simulated)
    deviation = float(commands.std())
    # The part of order n of a response to Gaussian inputs of deviation s has the deviation sqrt(n!) s^n |H_n|.
    return [
        _difference(a, b, own, other, model_error / (sqrt(factorial(a.order)) * deviation**a.order))
        for a, b in zip(ours, theirs, strict=True)
    ]


def _with_instruments(plant: NarxModel, measured: Sequence[Recording], simulated: Sequence[Recording]) -> NarxModel:
    """Return the plant's model with parameters estimated from the recordings by instrumental variables."""
    instruments = Regression.on(simulated, plant.table).matrix()[0]
    data = Regression.on(measured, plant.table)
    rows, target = data.matrix()
    (q, r), z = np.linalg.qr(rows.T), np.linalg.qr(instruments.T)[0]
    theta = np.linalg.solve(r, np.linalg.solve(z.T @ q, z.T @ target))
    return replace(plant, theta=theta * data.term_scales)


def _difference(ours: BandMean, theirs: BandMean, own: Array, other: Array, margin: float) -> ResponseDifference:
    """Test one mean; ``own`` and ``other`` are the contributions of the same blocks for plant and actuator."""
    cosines = Cosines.of(other @ theirs.gradient.T - own @ ours.gradient.T)
    apart = theirs.value - ours.value
    return ResponseDifference(
        order=ours.order,
        from_Hz=ours.from_Hz,
        to_Hz=ours.to_Hz,
        p_value=equality(apart, [Scatter(cosines.scale, float(cosines.dof))], margin).p_value,
        size=float(np.linalg.norm(apart)) / ours.gain if ours.gain > 0 else 0.0,
    )
