"""The measured describing function against the linearised plant, against closed forms, and against one long run."""

import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from oscillator import MASS, STIFFNESS, Oscillator
from scipy.signal import cont2discrete

from deatwin.control.linear.plant import linearise_plant
from deatwin.control.loop import sine_response as module
from deatwin.control.loop.closed_loop import approach
from deatwin.control.loop.sine_response import SineResponse, sine_response
from deatwin.plant import Diaphragm, Plant, ReadingTime

H = 0.02
WHOLE = 2 * np.pi / (H * np.array([100.0, 50.0, 20.0]))  # whole samples in a period


@pytest.mark.parametrize("command", [1.5, 3.0])
def test_small_sines_show_the_linearised_plant(plant, command):
    omega = 2 * np.pi * np.array([0.5, 3.0, 12.0, 22.0])
    found = sine_response(plant, command, [1e-3, 2e-3], omega)
    expected = linearise_plant(plant, command).in_loop(plant.rig.reading).response(omega)
    np.testing.assert_allclose(found.values, np.broadcast_to(expected, (2, 4)), rtol=1e-3)


@pytest.mark.parametrize("damping", [0.05, 0.01])
def test_a_mode_that_rings_on_is_waited_for(damping):
    """The mode at 10 Hz decays in 20 or 100 samples; above it, the response is small beside what still rings."""
    omega = 2 * np.pi * np.array([1.0, 8.0, 15.0, 22.0])
    found = sine_response(Plant(rig=Oscillator(), values={"damping": damping}), 0.0, [0.1, 1.0], omega)
    rates, push = [[0.0, 1.0], [-STIFFNESS / MASS, -damping / MASS]], [[0.0], [1e-3 / MASS]]
    matrices = tuple(map(np.array, (rates, push, [[1.0, 0.0]], [[0.0]])))
    a, b, c, *_ = cont2discrete(matrices, H)
    expected = [(c @ np.linalg.solve(z * np.eye(2) - a, b)).item() for z in np.exp(1j * omega * H)]
    np.testing.assert_allclose(found.values, np.broadcast_to(expected, (2, 4)), rtol=2e-3)


def test_a_cubic_curve_has_the_gain_of_its_first_harmonic(curve):
    """Of 2 u + c u³ it is 2 + 3 c A²/4; the reading comes after a sample."""
    sizes = np.array([0.1, 0.5, 1.0, 2.0])
    found = sine_response(curve(cubic=0.4), 0.0, sizes, WHOLE)
    expected = (2 + 0.75 * 0.4 * sizes**2)[:, None] * np.exp(-1j * WHOLE * H)[None, :]
    # The drift that is fitted beside the sine takes some of the third harmonic: 0.3 % where that is a tenth of it.
    np.testing.assert_allclose(found.values, expected, rtol=4e-3)
    np.testing.assert_allclose(found.values[0], expected[0], rtol=2e-5)


def of_one_run(plant, centre, sizes, omega):
    """Least squares over a run that is kept as a whole: two periods at rest and of each size, then three measured."""
    period = 2 * np.pi / (omega * H)
    first, measured = max(int(np.ceil(2 * period)), 40), max(round(3 * period), 40)
    clock = omega * H * np.arange(first + measured)
    before = approach(plant, centre, first)
    sines = centre + np.multiply.outer(sizes, np.sin(clock))
    run = plant.simulator.run(
        np.concatenate([before.commands, sines.ravel()]),
        start=before.start,
        sample_time=H,
        rest_command=plant.rig.start.rest_command,
        values=plant.free_values,
    )
    readings = run.outputs[before.commands.size : -1].reshape(sines.shape)[:, first:]
    late = clock[first:]
    basis = np.stack([np.sin(late), np.cos(late), np.ones(measured), np.linspace(-1.0, 1.0, measured)], axis=1)
    (y_sine, y_cosine), (u_sine, u_cosine) = (
        np.linalg.lstsq(basis, signal.T, rcond=None)[0][:2] for signal in (readings, sines[:, first:])
    )
    return (y_sine + 1j * y_cosine) / (u_sine + 1j * u_cosine)


@pytest.mark.parametrize("piece", [37, 200, 20_000])
def test_a_run_in_pieces_is_the_run_as_a_whole(late, monkeypatch, piece):
    """The plant asks for past commands, of the piece before too; neither periods nor pieces are whole."""
    monkeypatch.setattr(module, "_PIECE", piece)
    sizes, omega = np.array([0.02, 0.3, 1.0]), np.array([1.3, 7.1, 100.0])
    found = sine_response(late, 0.7, sizes, omega)
    expected = np.stack([of_one_run(late, 0.7, sizes, rate) for rate in omega], axis=1)
    np.testing.assert_allclose(found.values, expected, rtol=1e-12)


class Gain:
    """A plant that does nothing but double, so fast that long runs are short."""

    def __init__(self, plant, start):
        self.reading = 0.0

    def readings(self, commands):
        self.reading = 2.0 * float(commands[-1])
        return 2.0 * commands


def test_a_long_run_needs_no_more_memory_than_a_short_one(curve, monkeypatch):
    """A period of 200 000 samples makes a run of 2.4 million: 19 MB for a single signal."""
    monkeypatch.setattr(module, "LongRun", Gain)
    plant, peaks = curve(), []
    for samples in (20_000, 200_000):
        tracemalloc.start()
        found = sine_response(plant, 3.0, [0.01, 1.0], 2 * np.pi / (H * samples) * np.array([1.0, 1.5]))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        np.testing.assert_allclose(found.values, 2.0, rtol=1e-11)
    assert peaks[1] < 1.2 * peaks[0]
    assert peaks[1] < 19e6 / 2


def test_progress_rises_to_one_in_the_order_of_the_work(curve, monkeypatch):
    monkeypatch.setattr(module, "_PIECE", 100)
    shares = []
    sine_response(curve(), 0.0, [0.1, 1.0], [1.0, 10.0], progress=shares.append)
    assert all(a < b for a, b in pairwise(shares))
    assert shares[-1] == pytest.approx(1.0, abs=1e-12)
    # By hundreds: 628 samples of rest, 629 + 942 of each size of the slow sine, and 62 and 63 + 94 for the fast one.
    assert len(shares) == (7 + 2 * 16) + (1 + 2 * 2)


def test_rows_read_at_the_start_are_the_same_loop(curve):
    end, start = (
        sine_response(curve(lag=0.1, reading=r), 0.0, [0.1, 1.0], WHOLE)
        for r in (ReadingTime.END_OF_HOLD, ReadingTime.START_OF_HOLD)
    )
    np.testing.assert_array_equal(end.values, start.values)


def test_between_the_points_it_is_linear_in_logarithms_and_holds_at_the_ends():
    """A power law is linear in logarithms, and so is a delay's phase in the logarithm between two near points."""
    sizes, omega = np.array([0.1, 0.3, 1.0]), np.array([1.0, 2.0, 4.0])
    law = sizes[:, None] ** -0.5 * omega[None, :] ** -1.5 * np.exp(-0.5j * np.pi * np.log2(2 * omega))
    response = SineResponse(amplitudes=sizes, omega=omega, values=law)
    assert response(0.17, 2.9) == pytest.approx(
        0.17**-0.5 * 2.9**-1.5 * np.exp(-0.5j * np.pi * np.log2(2 * 2.9)), rel=1e-12
    )
    assert response(1e-9, 0.1) == pytest.approx(law[0, 0], rel=1e-12)
    assert response(7.0, 99.0) == pytest.approx(law[-1, -1], rel=1e-12)
    np.testing.assert_allclose(response(sizes[:, None], omega[None, :]), law, rtol=1e-12)
    law[0, 0] = 2.0  # the caller's array stays writable


def test_the_phase_does_not_wrap_between_two_points():
    omega = np.array([1.0, 2.0])
    values = np.tile(np.exp(-1j * np.array([3.0, 3.4])), (2, 1))
    response = SineResponse(amplitudes=np.array([1.0, 2.0]), omega=omega, values=values)
    assert response(1.5, np.sqrt(2.0)) == pytest.approx(np.exp(-3.2j), rel=1e-12)


def test_the_ends_are_reached_from_any_axis():
    """A logarithm of many numbers may differ from that of one in its last digit."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        sizes, omega = np.sort(rng.uniform(0.01, 5.0, 3)), np.sort(rng.uniform(0.01, 150.0, 3))
        response = SineResponse(amplitudes=sizes, omega=omega, values=np.ones((3, 3), dtype=complex))
        for size in (sizes[0], sizes[-1], float(sizes[-1])):
            assert np.isfinite(response(size, omega[-1])).all()


def test_a_plant_that_does_not_move_has_no_logarithm_and_yet_an_answer():
    values = np.array([[0.0, 0.0], [1.0, 1.0]], dtype=complex)
    response = SineResponse(amplitudes=np.array([1.0, 2.0]), omega=np.array([1.0, 2.0]), values=values)
    for size in (0.5, 1.0, 1.5, 2.0):
        assert np.isfinite(response(size, 1.5)).all()
    assert abs(response(1.0, 1.0)) < 1e-200
    assert response(2.0, 1.5) == pytest.approx(1.0)


def test_amplitudes_at_which_the_film_pulls_in_are_left_out():
    soft, omega = Plant(rig=Diaphragm()), 2 * np.pi * np.array([1.0, 3.0])
    found = sine_response(soft, 3.0, [0.1, 0.5, 9.0, 12.0], omega)
    assert found.amplitudes.tolist() == [0.1, 0.5]
    assert found.values.shape == (2, 2)
    assert np.isfinite(found.values).all()
    assert sine_response(soft, 3.0, [0.1, 9.0], omega) is None
    assert sine_response(soft.with_values({"mass": 1.0}), 3.0, [0.1, 0.2], omega) is None  # there is no rest
