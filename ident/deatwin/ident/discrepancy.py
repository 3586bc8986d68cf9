"""Models of a plant's residual that do not ask which physics is missing: sparse dynamics, a Gaussian process, NARX.

Each learns from recordings and the plant's free run over them, and corrects its free run of a later record. None sees
a reading of that record, but for the first lags of a NARX run.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording

Array = np.ndarray
HELD_OUT = 0.3  # Share of the training samples, at their end, on which a model chooses its own settings
BEFORE = 10  # Samples before the test samples whose mean is the residual at their start
DIVERGED = 20.0  # Limit of a simulated residual, in its rms over the training samples, or its first value if larger


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """Scaled signals on one clock: training samples first, then test samples."""

    residual: Array  # shape (n,): Residual, measured minus simulated
    reading: Array  # shape (n,): Simulated reading
    rate: Array  # shape (n,): Rate of the simulated reading
    drive: Array  # shape (n,): Squared command
    cut: int  # Number of training samples; residuals of the test samples serve only to start a run
    sample_time: float  # s
    size: float  # SI size of one unit of the residual

    def part(self, first: int, last: int) -> Track:
        """Return a range of samples, all of them for training."""
        names = ("residual", "reading", "rate", "drive")
        return replace(self, cut=last - first, **{name: getattr(self, name)[first:last] for name in names})

    @property
    def learned(self) -> Track:
        """The training samples."""
        return self.part(0, self.cut)

    @property
    def judged(self) -> Track:
        """The test samples."""
        return self.part(self.cut, self.residual.size)

    @property
    def just_before(self) -> float:
        """Residual at the start of the test samples: mean of the last training samples."""
        return float(self.residual[max(self.cut - BEFORE, 0) : self.cut].mean())


@dataclass(frozen=True, kw_only=True, eq=False)
class Correction:
    """A predicted residual, with which a free run is corrected."""

    predicted: Array
    term: str = ""  # Strongest term of the model, if it has terms
    failure: str = ""  # Reason why there is no correction; empty if there is one


def track_of(plant: Plant, whole: Experiment, records: int) -> Track:
    """Residual of a plant over an experiment, with its free-run signals."""
    readings = [y[0] for y in plant.simulate(whole).require().outputs]
    simulated = np.concatenate(readings)
    cut = sum(r.n_samples for r in whole.recordings[:records])
    signals = np.array(
        [
            np.concatenate([r.outputs[0] for r in whole.recordings]) - simulated,
            simulated,
            np.concatenate([np.gradient(y, plant.rig.sample_time) for y in readings]),
            np.concatenate([r.inputs[0] for r in whole.recordings]) ** 2,
        ]
    )
    scale = np.maximum(np.sqrt(np.mean(signals[:, :cut] ** 2, axis=1)), 1e-300)
    residual, reading, rate, drive = signals / scale[:, None]
    return Track(
        residual=residual,
        reading=reading,
        rate=rate,
        drive=drive,
        cut=cut,
        sample_time=plant.rig.sample_time,
        size=float(scale[0]),
    )


# --- sparse dynamics of the residual: pysindy as a discrepancy model -------------------------------------------------

VARIABLES = ("e", "x", "v", "w", "s")
"""Variables of the sparse model: residual, simulated reading and its rate, squared command, and the direction of motion
(smoothed sign of the rate)."""
THRESHOLDS = (0.02, 0.1, 0.3)
MODELS, WEAK_DOMAINS, DOMAIN_SECONDS = 20, 200, 1.0
REST = 0.05  # Speed, as a share of the rms rate, below which the direction of motion is not sharp


def sparse_dynamics(track: Track) -> Correction:
    """Learn the rate of the residual as a sparse polynomial, in weak form and with an ensemble."""
    learned, judged = track.learned, track.judged
    trial = replace(learned, cut=round((1 - HELD_OUT) * track.cut))
    scores = []
    for threshold in THRESHOLDS:
        run = _free(_coefficients(trial.learned, threshold), trial.judged, trial.just_before)
        scores.append(np.inf if run is None else float(np.mean((trial.judged.residual - run) ** 2)))
    found = _coefficients(learned, THRESHOLDS[int(np.argmin(scores))])
    weights = np.abs(found) * np.sqrt(np.mean(_monomials(learned, learned.residual) ** 2, axis=0))
    names = _library().get_feature_names(list(VARIABLES))
    term = names[int(np.argmax(weights))] if weights.any() else ""
    run = _free(found, judged, track.just_before)
    if run is None:
        return Correction(predicted=np.zeros_like(judged.residual), term=term, failure="its free run diverges")
    return Correction(predicted=run, term=term)


def _variables(track: Track, residual: Array) -> Array:
    direction = np.tanh(track.rate / REST)
    return np.column_stack([residual, track.reading, track.rate, track.drive, direction])


def _library() -> Any:
    from pysindy import PolynomialLibrary

    return PolynomialLibrary(degree=2).fit(np.zeros((2, len(VARIABLES))))


def _monomials(track: Track, residual: Array) -> Array:
    """Return monomials of the variables in pysindy's order, shape (n, terms)."""
    return np.asarray(_library().transform(_variables(track, residual)))


def _coefficients(track: Track, threshold: float) -> Array:
    """Fit the rate of the residual by monomials up to degree 2."""
    import pysindy

    timepts = np.arange(track.residual.size) * track.sample_time
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        state = np.random.get_state()  # noqa: NPY002  (pysindy draws from the global generator; it is restored)
        np.random.seed(0)  # noqa: NPY002
        try:
            weak = pysindy.WeakPDELibrary(
                function_library=pysindy.PolynomialLibrary(degree=2, include_bias=True),
                spatiotemporal_grid=timepts,
                K=WEAK_DOMAINS,
                H_xt=[DOMAIN_SECONDS],
            )
            ensemble = pysindy.EnsembleOptimizer(
                pysindy.STLSQ(threshold=threshold, alpha=1e-6), bagging=True, n_models=MODELS
            )
            model = pysindy.SINDy(feature_library=weak, optimizer=ensemble)
            signals = _variables(track, track.residual)
            model.fit(signals[:, :1], t=track.sample_time, u=signals[:, 1:])
        finally:
            np.random.set_state(state)  # noqa: NPY002
    return np.asarray(model.coefficients()[0], dtype=float)


def _free(coefficients: Array, track: Track, start: float) -> Array | None:
    """Simulate the residual's dynamics along the plant's free run; None if they diverge."""
    zero, up, down = (_monomials(track, np.full_like(track.residual, e)) @ coefficients for e in (0.0, 1.0, -1.0))
    curvature, slope = (up + down) / 2 - zero, (up - down) / 2  # exact, because the degree is 2
    out = np.empty_like(track.residual)
    e, limit = float(start), DIVERGED * max(1.0, float(np.abs(track.residual[:1]).max()))
    for k in range(out.size):
        out[k] = e
        rate = zero[k] + (slope[k] + curvature[k] * e) * e
        ahead = e + track.sample_time * rate
        after = zero[k] + (slope[k] + curvature[k] * ahead) * ahead
        e += 0.5 * track.sample_time * (rate + after)
        if not abs(e) < limit:
            return None
    return out


# --- a Gaussian process over lagged signals --------------------------------------------------------------------------

LAGS_SECONDS = (0.0, 0.02, 0.06, 0.2, 0.6)
FILTERS_SECONDS, TENTH = (2.0, 20.0), 0.2
"""FILTERS_SECONDS: time constants of the low passes, s. TENTH: longest sampling interval, s, for which they hold; a
plant sampled more slowly has lags one sample apart and low passes over ten and a hundred samples."""
POINTS = 250


def gaussian_process(track: Track) -> Correction:
    """Learn the residual as a function of lagged and low-passed commands and simulated readings."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    rows = _regressors(track)
    learned = rows[: track.cut]
    rows = (rows - learned.mean(axis=0)) / np.maximum(learned.std(axis=0), 1e-12)
    chosen = np.random.default_rng(0).permutation(track.cut)[:POINTS]
    kernel = ConstantKernel(1.0) * RBF(3.0) + WhiteKernel(0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        process = GaussianProcessRegressor(kernel, normalize_y=True).fit(rows[chosen], track.residual[chosen])
    return Correction(predicted=process.predict(rows[track.cut :]))


def _regressors(track: Track) -> Array:
    columns = [track.rate]
    for signal in (track.drive, track.reading):
        columns += [_lagged(signal, max(k, round(lag / track.sample_time))) for k, lag in enumerate(LAGS_SECONDS)]
        columns += [_low_passed(signal, min(track.sample_time, TENTH) / constant) for constant in FILTERS_SECONDS]
    return np.column_stack(columns)


def _lagged(signal: Array, lag: int) -> Array:
    return np.concatenate([np.full(lag, signal[0]), signal[: signal.size - lag]]) if lag else signal


def _low_passed(signal: Array, share: float) -> Array:
    from scipy.signal import lfilter

    return np.asarray(lfilter([share], [1.0, share - 1.0], signal))


# --- a NARX model of the residual ------------------------------------------------------------------------------------

CANDIDATES = ((2, 2, 2), (2, 2, 3))  # Lags of the residual, lags of squared command and reading, and degree
MOST_TERMS = 12


def narx(track: Track) -> Correction:
    """Learn NARX models of the residual; return the one with the smallest free-run error on the last part."""
    from deatwin.ident.narx import Frols

    record = _as_recording(track.learned)
    end = record.section(round((1 - HELD_OUT) * record.n_samples), record.n_samples)
    best, least = None, np.inf
    for output_lags, input_lags, degree in CANDIDATES:
        lags: dict[str, Any] = {"output_lags": output_lags, "input_lags": input_lags, "degree": degree}
        frols = Frols(**lags, max_terms=MOST_TERMS, criterion="free_run", held_out=HELD_OUT)
        found = frols.fit(record).model_
        run = found.simulate(end)
        if run.status.ok and run.rms_error < least:
            best, least = found, run.rms_error
    judged = _as_recording(track.judged)
    free = None if best is None else best.simulate(judged)
    if free is None or not free.status.ok:
        return Correction(predicted=np.zeros(judged.n_samples), failure="its free run diverges")
    return Correction(predicted=free.outputs[0])


def _as_recording(track: Track) -> Recording:
    return Recording.from_arrays(
        np.array([track.drive, track.reading]),
        track.residual,
        track.sample_time,
        input_names=("drive", "reading"),
        output_names=("residual",),
    )
