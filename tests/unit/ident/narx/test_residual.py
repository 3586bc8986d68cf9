"""What a free run leaves: its size and memory, estimated from a process of known ones, and drawn again."""

import numpy as np
import pytest

from deatwin.ident.narx import NarxModel, Residual, free_run_residual
from deatwin.ident.narx.residual import RMS_KEY, TIME_KEY, DivergedError
from deatwin.plant import ModelError, Recording

H, RMS, NOISE = 0.02, 2.0, 1.5
PLAIN = NarxModel.from_terms({"u(k-1)": 3.0}, sample_time=H)


def left_by(error: np.ndarray, rng: np.random.Generator) -> Residual:
    """The estimate from a recording of which the model's free run leaves this error, but for the first sample."""
    command = rng.standard_normal(error.size)
    output = 3.0 * np.concatenate([[0.0], command[:-1]]) + error
    return free_run_residual(PLAIN, Recording.from_arrays(command, output, H))


def process(rng: np.random.Generator, samples: int, time: float) -> np.ndarray:
    """Ornstein-Uhlenbeck by its exact recursion, written anew."""
    pole, value = np.exp(-H / time), RMS * rng.standard_normal()
    values = []
    for shock in rng.standard_normal(samples):
        values.append(value)
        value = pole * value + RMS * np.sqrt(1 - pole**2) * shock
    return np.array(values)


@pytest.mark.parametrize("time", [0.1, 0.5, 2.0])
def test_size_and_memory_of_a_known_process_are_found_beside_white_noise(time):
    rng = np.random.default_rng(17)
    lengths, runs = round(100 * time / H), 60
    found = []
    for _ in range(runs):
        error = process(rng, lengths, time) + NOISE * rng.standard_normal(lengths)
        found.append(left_by(error, rng))
    sizes, times = np.array([(r.rms, r.correlation_time) for r in found]).T
    # Var(mean square) = 2 sigma^4 tau / T, so that the rms spreads by sqrt(2 tau/T) / 2 = 7 % of it; the noise, a
    # factor of (1 + 0.75²)² or less. The mean that is taken out costs 2 tau/T of the mean square, 1 % of the rms.
    spread = 0.5 * np.sqrt(2 / 100)
    assert sizes.mean() == pytest.approx(0.99 * RMS, rel=4 * 1.3 * spread / np.sqrt(runs))
    assert 0.7 * spread < sizes.std() / RMS < 2.0 * spread
    # Bartlett: the autocorrelation at tau spreads by sqrt((1 - 3/e²) tau/T), and its slope there is 1/(e tau); the
    # noise spreads both covariances, at lag 1 and at tau. The mean that is taken out shortens the time by 4.5 %; that
    # the first crossing of a noisy curve counts, by some more.
    noise = 2 * (NOISE**4 + 2 * NOISE**2 * RMS**2) / RMS**4 / lengths
    spread = np.e * np.sqrt((1 - 3 / np.e**2) / 100 + noise)
    assert np.median(times) / time == pytest.approx(0.94, abs=4 * 1.25 * spread / np.sqrt(runs))
    assert 0.6 * spread < times.std() / time < 1.5 * spread


def test_an_exact_model_leaves_nothing():
    found = left_by(np.zeros(400), np.random.default_rng(1))
    assert found.rms == 0.0
    assert found.correlation_time > 0.0
    assert not found.draw(50, 3, H, np.random.default_rng(1)).any()
    assert Residual.of_provenance(found.provenance).rms == 0.0


def test_a_constant_error_is_no_process():
    """Integral action takes it out."""
    assert left_by(np.full(400, 7.0), np.random.default_rng(1)).rms == pytest.approx(0.0, abs=0.5)


@pytest.mark.parametrize("samples", [2, 3, 5, 12])
def test_a_recording_of_few_samples_gives_numbers(samples):
    found = left_by(np.random.default_rng(2).standard_normal(samples), np.random.default_rng(3))
    assert np.isfinite(found.rms)
    assert 0.0 < found.correlation_time <= samples * H


def test_draws_have_the_size_and_the_memory_that_were_asked_for():
    time, count, draws = 0.1, 400, 3000
    drawn = Residual(rms=RMS, correlation_time=time).draw(count, draws, H, np.random.default_rng(8))
    assert drawn.shape == (count, draws)
    # At each sample the mean square has a relative deviation of sqrt(2/draws) = 2.6 %, at 4.5 of them.
    for k in (0, 1, 7, 399):
        assert np.mean(drawn[k] ** 2) == pytest.approx(RMS**2, rel=4.5 * np.sqrt(2 / draws))
        assert abs(drawn[k].mean()) < 4.5 * RMS / np.sqrt(draws)
    # Over all samples about count/(2 * 5 samples) as many.
    for lag in (0, 1, 5, 15):
        covariance = np.mean(drawn[: count - lag] * drawn[lag:])
        assert covariance == pytest.approx(RMS**2 * np.exp(-lag * H / time), abs=4.5 * RMS**2 * np.sqrt(10 / 4e2 / 3e3))


def test_it_goes_through_the_provenance_of_a_model():
    residual = Residual(rms=1.25e-6, correlation_time=0.34)
    assert set(residual.provenance) == {RMS_KEY, TIME_KEY}
    assert Residual.of_provenance(residual.provenance | {"other": "x"}) == residual
    assert Residual.of_provenance({"other": "x"}) is None


@pytest.mark.parametrize(
    ("rms", "time"),
    [("large", "1.0"), ("1.0", ""), ("nan", "1.0"), ("inf", "1.0"), ("-1.0", "1.0"), ("1.0", "0.0"), ("1.0", "nan")],
)
def test_what_is_no_number_there_is_refused(rms, time):
    with pytest.raises(ModelError, match=r"must be a number|must not be negative"):
        Residual.of_provenance({RMS_KEY: rms, TIME_KEY: time})


def test_a_free_run_that_diverges_is_refused():
    grows = NarxModel.from_terms({"y(k-1)": 1.5, "u(k-1)": 1.0}, sample_time=H)
    rng = np.random.default_rng(0)
    with pytest.raises(DivergedError, match="free run fails"):
        free_run_residual(grows, Recording.from_arrays(rng.standard_normal(500), rng.standard_normal(500), H))


def test_a_residual_that_rings_is_not_taken_for_white_noise():
    """At four samples a period the covariance of r^k cos(pi k / 2) is nothing at lag 1, -r² of the size at lag 2."""
    rng = np.random.default_rng(5)
    radius, n, found = 0.9, 6000, []
    for _ in range(20):
        # Var of v(k) = -r² v(k-2) + e(k): of every second sample a first-order process.
        ringing, shocks = np.zeros(n), RMS * np.sqrt(1 - radius**4) * rng.standard_normal(n)
        ringing[:2] = RMS * rng.standard_normal(2)
        for k in range(2, n):
            ringing[k] = -(radius**2) * ringing[k - 2] + shocks[k]
        found.append(left_by(ringing + NOISE * rng.standard_normal(n), rng))
    sizes, times = np.array([(r.rms, r.correlation_time) for r in found]).T
    # The envelope r^k has fallen to 1/e after 1 / ln(1/r) = 9.5 samples, and is seen at every second.
    assert np.all(np.abs(sizes / RMS - 1.0) < 0.15)
    assert np.all((times > 7.0 * H) & (times < 13.0 * H))


def test_white_noise_alone_leaves_next_to_nothing():
    """The largest of many covariances of white noise is no residual: what is left is that of lag 1, c(0) / sqrt(n)."""
    rng = np.random.default_rng(6)
    n = 6000
    left = np.array([left_by(NOISE * rng.standard_normal(n), rng).rms for _ in range(20)])
    # Three deviations of the covariance at lag 1, which is taken back to lag 0 by a factor of e at most.
    assert np.all(left**2 < 3.0 * np.e * NOISE**2 / np.sqrt(0.95 * n))


def test_a_residual_has_a_size_and_a_memory():
    for size, time in ((-1e-3, 0.5), (1e-3, 0.0), (np.inf, 0.5), (1e-3, np.nan)):
        with pytest.raises(ModelError, match="the rms must not be negative and the time be positive, both finite"):
            Residual(rms=size, correlation_time=time)
    with pytest.raises(ModelError, match="correlation_time must be real numbers; got text"):
        Residual(rms=1e-3, correlation_time="0.5 s")
