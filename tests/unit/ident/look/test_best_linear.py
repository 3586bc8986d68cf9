"""Best linear approximations of a Wiener system, whose distortions are known in closed form."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from deatwin.ident.look import BestLinearApproximation, best_linear_approximation, look_at
from deatwin.plant import DataError, ModelError, Recording
from deatwin.plant.excitation import random_odd_harmonics, random_phase_multisine

STEP, PERIOD, N = 0.01, 10.24, 1024
SQUARE, CUBE, NOISE = 0.1, 0.05, 0.01
FRONT, BACK = [0.3, 0.2], [1.0, -0.9, 0.5]


def multisine(rng: np.random.Generator, harmonics: NDArray[np.int64], periods: int = 6) -> NDArray[np.float64]:
    limits = {"lower": -np.inf, "upper": np.inf}
    return random_phase_multisine(rng, PERIOD, STEP, harmonics, 1.0, mean=0.0, periods=periods, **limits)


def recorded(rng: np.random.Generator, u: NDArray[np.float64], noise: float = NOISE) -> Recording:
    """A linear filter, x + 0.1 x^2 + 0.05 x^3, and white noise."""
    x = lfilter(FRONT, BACK, u)
    y = x + SQUARE * x**2 + CUBE * x**3 + noise * rng.normal(size=u.size)
    return Recording.from_arrays(u, y, STEP, input_units=["V"], output_units=["m"])


def known(harmonics: NDArray[np.int64]) -> tuple[NDArray[np.complex128], float, float]:
    """Best linear approximation for random phases, and rms of the even and the odd rest (Gaussian signals).

    At line k of F sines a cube passes 3 (s2 - |X_k|^2) X_k coherently; Hermite polynomials give the powers of the rest.
    """
    z = np.exp(-2j * np.pi * harmonics / N)
    h = np.polyval(FRONT[::-1], z) / np.polyval(BACK[::-1], z)
    lines = np.abs(h) ** 2 / (2.0 * harmonics.size)
    power = 2.0 * lines.sum()
    return h * (1 + 3 * CUBE * (power - lines)), np.sqrt(2) * SQUARE * power, np.sqrt(6) * CUBE * power**1.5


def inside(found: BestLinearApproximation, harmonics: NDArray[np.int64]) -> float:
    return float(np.mean(np.abs(found.response - known(harmonics)[0]) < found.radius()))


def test_one_realisation_with_detection_lines() -> None:
    # Of these 20 sets the discs hold 96.2 % of the lines; the mean errors of the levels are -0.2, -0.6 and 0.0 dB.
    rng, held, errors = np.random.default_rng(1), [], []
    for _ in range(20):
        harmonics, _ = random_odd_harmonics(rng, PERIOD, 29.0)
        found = best_linear_approximation(recorded(rng, multisine(rng, harmonics)))
        _, even, odd = known(harmonics)
        held.append(inside(found, harmonics))
        errors.append(20 * np.log10([found.even_rms / even, found.odd_rms / odd, found.noise_rms / NOISE]))
    assert 0.93 < np.mean(held) < 0.97
    assert np.abs(np.mean(errors, axis=0)).max() < 1.0


@pytest.mark.parametrize("first", [1, 2])  # step between harmonics: 2 leaves the even lines free
def test_several_realisations(first: int) -> None:
    rng, held, errors = np.random.default_rng(2), [], []
    harmonics = np.arange(1, 300, first)
    _, even, odd = known(harmonics)
    for _ in range(5):
        found = best_linear_approximation([recorded(rng, multisine(rng, harmonics, 4)) for _ in range(7)])
        assert (found.realisations, found.separates, found.complete) == (7, first == 2, True)
        held.append(inside(found, harmonics))
        told = [found.even_rms / even, found.odd_rms / odd] if first == 2 else []
        errors.append(20 * np.log10([found.noise_rms / NOISE, *told]))
    assert 0.93 < np.mean(held) < 0.97
    assert np.abs(np.mean(errors, axis=0)).max() < 1.0


@pytest.mark.parametrize(("n", "later", "top"), [(511, 100.0, 230), (512, 100.5, 80)])
def test_a_later_start_in_an_odd_period_or_between_samples_is_no_other_realisation(
    n: int, later: float, top: int
) -> None:
    # Another realisation with the same distortion would show none, and discs of noise alone. Up to line 80 of 512
    # no cube folds back, so that the system also answers to half a sample of delay with half a sample of delay.
    rng = np.random.default_rng(11)
    odd = np.arange(1, top, 2)
    harmonics = odd[rng.random(odd.size) < 0.8]
    phases = rng.uniform(0.0, 2.0 * np.pi, harmonics.size)

    def begun(start: float) -> Recording:
        angles = 2.0 * np.pi * np.outer(np.arange(4 * n) + start, harmonics) / n
        u = np.cos(angles + phases).sum(axis=1) / np.sqrt(harmonics.size / 2)
        return Recording.from_arrays(u, u + CUBE * u**3 + 1e-3 * rng.normal(size=u.size), STEP)

    alone = best_linear_approximation(begun(0.0), period=n * STEP)
    both = best_linear_approximation([begun(0.0), begun(later)], period=n * STEP)
    assert (both.realisations, both.periods) == (1, 2 * alone.periods)
    assert both.odd_rms == pytest.approx(alone.odd_rms, rel=0.01)
    assert np.median(both.radius()) == pytest.approx(np.median(alone.radius()), rel=0.01)


def test_arguments_that_make_no_sense_are_refused() -> None:
    rng = np.random.default_rng(13)
    record = recorded(rng, multisine(rng, np.arange(1, 300)))
    for wrong in (-1, 1.5, True):
        with pytest.raises(ModelError, match="skip"):
            best_linear_approximation(record, skip=wrong)  # type: ignore[arg-type]
    for period in (np.nan, np.inf):
        with pytest.raises(DataError, match="whole number"):
            best_linear_approximation(record, period=period)


def test_a_linear_system_has_no_distortion_and_its_start_is_left_out() -> None:
    rng = np.random.default_rng(4)
    harmonics, _ = random_odd_harmonics(rng, PERIOD, 29.0)
    u = multisine(rng, harmonics, 8)
    y = lfilter([0.01], [1.0, -0.999], u) + 1e-4 * rng.normal(size=u.size)  # forgets 64 % of its start in a period
    found = best_linear_approximation(Recording.from_arrays(u, y, STEP))
    assert found.left_out >= 2 and found.noise_rms == pytest.approx(1e-4, rel=0.03)
    assert max(found.even_rms, found.odd_rms) < 0.3 * found.noise_rms
    z = np.exp(-2j * np.pi * harmonics / N)
    assert np.mean(np.abs(found.response - 0.01 / (1 - 0.999 * z)) < found.radius()) > 0.9


def test_noise_is_taken_for_distortion_once_in_twenty_times() -> None:
    # 80 claims on linear systems, each false by chance of 5 %: more than 11 have a chance of 1 in 1000.
    rng, claims = np.random.default_rng(9), 0
    for _ in range(40):
        harmonics, _ = random_odd_harmonics(rng, PERIOD, 29.0)
        u = multisine(rng, harmonics, 4)
        y = lfilter(FRONT, BACK, u) + 0.5 * rng.normal(size=u.size)
        found = best_linear_approximation(Recording.from_arrays(u, y, STEP))
        claims += int(np.sum(found.distortion_low[:2] > 0.0))
        assert ("no even distortion above the noise" in str(found)) == (found.distortion_low[0] == 0.0)
    assert claims <= 11


def test_a_distortion_exceeds_its_lower_bound() -> None:
    # 40 bounds of 95 % each: fewer than 33 hold with a chance of 1 in 1000. They are told from noise of twice the size.
    rng, held = np.random.default_rng(10), 0
    for _ in range(20):
        harmonics, _ = random_odd_harmonics(rng, PERIOD, 29.0)
        found = best_linear_approximation(recorded(rng, multisine(rng, harmonics), 0.1))
        _, even, odd = known(harmonics)
        held += int(found.distortion_low[0] < even) + int(found.distortion_low[1] < odd)
        assert found.distortion_low[0] > 0.5 * even
    assert held >= 33


def test_without_detection_lines_the_distortion_is_unknown_and_said_to_be() -> None:
    rng = np.random.default_rng(5)
    found = best_linear_approximation(recorded(rng, multisine(rng, np.arange(1, 300))))
    assert not found.complete and np.isnan(found.odd_rms) and "distortion unknown" in str(found)


def test_a_look_says_and_draws_it() -> None:
    from matplotlib.figure import Figure

    rng = np.random.default_rng(6)
    harmonics, _ = random_odd_harmonics(rng, PERIOD, 29.0)
    found = look_at(recorded(rng, multisine(rng, harmonics, 4)))
    assert found.best_linear is not None and "even distortion" in "\n".join(found.lines)
    panels = found.best_linear.plot(list(Figure().subplots(2, 1)))
    assert [axes.get_yscale() for axes in panels] == ["log", "log"]
    assert found.to_dict()["best_linear"]["realisations"] == 1


def test_a_period_off_the_clock_is_refused_and_one_of_half_samples_is_doubled() -> None:
    # 40.5 samples: every other line of 81 samples is excited. Of 1000.37 samples no multiple fits into the record.
    rng, t = np.random.default_rng(8), np.arange(6000)

    def wave(period: float) -> NDArray[np.float64]:
        return np.asarray(sum(np.cos(2 * np.pi * h * t / period + h**2) for h in range(1, 19, 2)), dtype=np.float64)

    found = best_linear_approximation(recorded(rng, wave(40.5)))
    np.testing.assert_allclose(found.frequencies, np.arange(1, 19, 2) / 40.5 / STEP)
    with pytest.raises(DataError, match="must be a whole number of at least 4 samples"):
        best_linear_approximation(recorded(rng, wave(1000.37)))


def test_what_cannot_be_taken_is_refused() -> None:
    rng = np.random.default_rng(7)
    u = multisine(rng, np.arange(1, 300, 2))
    record = recorded(rng, u)
    with pytest.raises(DataError, match="must be a whole number of at least 4 samples"):
        best_linear_approximation(record, period=10.2437)
    with pytest.raises(DataError, match="3 are needed"):
        best_linear_approximation(record.section(0, 2 * N), period=PERIOD)
    with pytest.raises(DataError, match="no period was found"):
        best_linear_approximation(recorded(rng, rng.normal(size=2000)))
    with pytest.raises(DataError, match="different rms values"):
        best_linear_approximation([record, recorded(rng, 2.0 * multisine(rng, np.arange(1, 300, 2)))])
