"""Where a fit looks for the time of an event."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from needs import COMPILED
from runs import blank

from deatwin.ident.greybox import Part, calibrate
from deatwin.ident.greybox.parts import simulated
from deatwin.ident.greybox.status import FitStatus
from deatwin.ident.mismatch.refit import search
from deatwin.ident.mismatch.refit.search import at_its_time, finish, further, gap_around, in_a_wider_range, in_its_gap
from deatwin.plant import Delay, Diaphragm, Experiment, Plant, ReadingTime, Recording, SensorJump
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.simulate import Simulator

pytestmark = COMPILED
JUMP = SensorJump(change=30e-6, at=13.3)
"""Fifteen times the noise: one sample shows it."""
AT = "sensor_jump.at"
FAR = {"shear_modulus": 29e3, "stretch_limit": 140.0, "permittivity": 4.3, "damping": 0.06}


@pytest.fixture(scope="module")
def parts():
    """Twenty seconds in which a jump lies between what is fitted."""
    commands = band_limited_noise(np.random.default_rng(0), 20.0, 0.02)
    whole = Part.whole(Plant(rig=Diaphragm()).with_effects(JUMP).record(blank(commands), np.random.default_rng(1)))
    times = whole.timepts
    return replace(whole, masks=((times < 10.0) | (times > 16.0),)), whole


def test_an_event_between_fitted_stretches_is_placed_by_what_lies_there(parts):
    fitted, whole = parts
    wrong = Plant(rig=Diaphragm()).with_effects(replace(JUMP, at=11.0))
    fit = calibrate(wrong, [fitted], evaluations=4, starts=1)
    placed = in_its_gap(fit, [fitted], [whole])
    assert placed.plant.parameters[AT].value == pytest.approx(JUMP.at, abs=0.02)  # one sample
    rests = fitted.timepts
    # a reading is taken at the end of its sample
    assert gap_around(placed.plant, AT, [fitted], [whole]) == pytest.approx(
        (rests[rests < JUMP.at].max() + 0.02, rests[rests > JUMP.at].min() + 0.02)
    )
    left = fitted.measured - simulated(placed.plant, [fitted])
    np.testing.assert_allclose(placed.residuals, left, rtol=0, atol=1e-12)  # of the plant that was moved
    assert placed.rms < 1.01 * fit.rms  # the fit knows hardly anything of it


def test_a_finished_fit_counts_the_simulations_of_all_its_rounds(parts, monkeypatch):
    """Three more rounds make two simulations each besides the known one, and the last gains nothing."""
    _, whole = parts
    rough = replace(calibrate(Plant(rig=Diaphragm()), [whole], evaluations=3, starts=1), evaluations=7)
    shares = iter((0.9, 0.8, 0.8))
    monkeypatch.setattr(
        search, "further", lambda *_, **__: replace(rough, residuals=next(shares) * rough.residuals, evaluations=3)
    )
    assert finish(rough, [whole]).evaluations == 7 + 3 * 2


def test_a_fit_that_leaves_nothing_is_finished(parts, monkeypatch):
    """Nothing can be gained from a residual of zero, which readings of the plant itself leave."""
    _, whole = parts
    rough = calibrate(Plant(rig=Diaphragm()), [whole], evaluations=1, starts=1)
    exact = replace(rough, residuals=np.zeros_like(rough.residuals))
    monkeypatch.setattr(search, "further", lambda *_, **__: exact)
    assert finish(exact, [whole]).rms == 0.0


def test_where_the_moved_plant_has_no_fit_the_one_before_stays(parts, monkeypatch):
    fitted, whole = parts
    fit = calibrate(Plant(rig=Diaphragm()).with_effects(replace(JUMP, at=11.0)), [fitted], evaluations=4, starts=1)
    monkeypatch.setattr(search, "descend", lambda *_, **__: replace(fit, status=FitStatus.IMPOSSIBLE))
    assert in_its_gap(fit, [fitted], [whole]) is fit


def test_a_fit_that_goes_on_does_not_make_its_last_simulation_again(parts, monkeypatch):
    _, whole = parts
    fit = calibrate(Plant(rig=Diaphragm()), [whole], evaluations=3, starts=1)
    monkeypatch.setattr(Simulator, "run_with_sensitivities", lambda *_, **__: pytest.fail("it was made again"))
    again = further(fit, [whole], evaluations=1)
    assert again.plant.parameters == fit.plant.parameters
    np.testing.assert_array_equal(again.residuals, fit.residuals)


def test_an_event_is_placed_as_finely_as_is_asked(parts, monkeypatch):
    """Moved by a tenth of a second, five samples of a thousand err by fifteen times the noise: 1.1 times its square."""
    _, whole = parts
    fit = calibrate(Plant(rig=Diaphragm()).with_effects(replace(JUMP, at=12.6)), [whole], evaluations=4, starts=1)
    looks, squares = [], search._squares
    monkeypatch.setattr(search, "_squares", lambda plant, parts: looks.append(plant) or squares(plant, parts))
    fine = at_its_time(fit, [whole])
    many = len(looks)
    rough = at_its_time(fit, [whole], enough=0.5)
    assert fine.plant.parameters[AT].value == pytest.approx(JUMP.at, abs=0.02)
    assert rough.plant.parameters[AT].value == pytest.approx(JUMP.at, abs=0.4)
    assert len(looks) - many < many - 5


def test_a_fit_beside_an_event_reaches_its_minimum_as_if_its_time_were_known(parts):
    """Times of events stay: were they moved with the rest, the steps of all would shrink at the first sample passed."""
    _, whole = parts
    start = Plant(rig=Diaphragm()).with_effects(replace(JUMP, at=13.305, change=15e-6)).with_values(FAR)
    known = [name for name in start.parameters.free if name != AT]
    fit, right = calibrate(start, [whole], starts=1), calibrate(start, [whole], names=known, starts=1)
    assert fit.plant.parameters[AT].value == 13.305
    assert fit.rms == right.rms < 1.02 * fit.plant.rig.noise  # 1 / sqrt(2000) is 2 %, and parameters lower it
    assert fit.names == tuple(start.parameters.free)
    assert 0.0 < fit.covariance[fit.names.index(AT), fit.names.index(AT)] < np.inf


def test_an_event_among_fitted_samples_stays_where_the_fit_has_it(parts):
    fitted, whole = parts
    fit = calibrate(Plant(rig=Diaphragm()).with_effects(replace(JUMP, at=5.0)), [fitted], evaluations=2, starts=1)
    assert gap_around(fit.plant, AT, [fitted], [whole]) is None
    assert in_its_gap(fit, [fitted], [whole]) is fit


@pytest.mark.parametrize(("reading", "stays"), [(ReadingTime.END_OF_HOLD, True), (ReadingTime.START_OF_HOLD, False)])
def test_whether_a_reading_comes_after_an_event_is_told_by_the_time_that_it_is_taken_at(parts, reading, stays):
    """The last row before the gap begins at 9.98 s: a jump in it shows in its reading at the end, not at the start."""
    fitted, whole = parts
    rough = calibrate(Plant(rig=Diaphragm(reading=reading)).with_effects(JUMP), [fitted], evaluations=2, starts=1)
    fit = replace(rough, plant=rough.plant.with_values({AT: 9.99}))
    assert (in_its_gap(fit, [fitted], [whole]) is fit) is stays


@pytest.fixture
def rough(monkeypatch):
    """``rough(loss)``: where the search puts an event at 10 s, one sample being a second, by the loss at each time."""

    def placed(loss: Callable[[float], float]) -> float:
        tried: list[float] = []

        def squares(plant, parts):
            assert plant.at not in tried  # each costs a simulation
            tried.append(plant.at)
            return loss(plant.at)

        monkeypatch.setattr(search, "_squares", squares)
        monkeypatch.setattr(search, "reading_times", lambda plant, parts: np.arange(0.0, 101.0))
        return search._moved(_Timed(10.0), AT, []).at

    return placed


@dataclass(frozen=True)
class _Timed:
    at: float

    @property
    def rig(self) -> Any:
        return SimpleNamespace(sample_time=1.0)

    @property
    def parameters(self) -> dict[str, Any]:
        return {AT: SimpleNamespace(value=self.at, lower=0.0, upper=1e4)}

    def with_values(self, values):
        return _Timed(values[AT])


def test_an_event_is_placed_within_a_sample(rough):
    assert rough(lambda at: (at - 41.3) ** 2) == pytest.approx(41.3, abs=search.FINEST)


@pytest.mark.parametrize(("hollow", "found"), [(3.3, True), (-3.3, True), (9.0, False)])
def test_a_lesser_residual_some_samples_on_is_found_and_gone_down_to(rough, hollow, found):
    """Beside the valley at 41.3 s lies a deeper hollow, a sample wide."""

    def loss(at: float) -> float:
        return min((at - 41.3) ** 2, 5.0 * (at - 41.3 - hollow) ** 2 - 1.0)

    assert (abs(rough(loss) - 41.3 - hollow) < search.FINEST) is found


def test_a_dead_time_beyond_the_usual_is_found_in_a_wider_range():
    """The commands of a film come 15 samples of 20 ms late; the usual range ends at 100 ms."""
    commands = band_limited_noise(np.random.default_rng(2), 15.0, 0.02)
    late = np.concatenate([np.full(15, commands[0]), commands[:-15]])
    plant = Plant(rig=Diaphragm())
    blank = np.zeros_like(commands)
    driven = Experiment(recordings=(Recording.from_arrays(late, blank, 0.02),))
    read = plant.record(driven, np.random.default_rng(3)).recordings[0]
    part = Part.whole(Experiment(recordings=(replace(read, inputs=commands[None]),)))
    part = replace(part, masks=(part.timepts > 1.0,))
    late_plant = plant.with_effects(Delay())
    fit = search.search(late_plant, [part])
    assert "delay.time" in fit.at_bound
    wider = finish(in_a_wider_range(fit, late_plant, [part]), [part])
    assert wider.plant.parameters["delay.time"].value == pytest.approx(0.3, abs=0.002)
    assert wider.rms == pytest.approx(plant.rig.noise, rel=0.1)
    assert in_a_wider_range(wider, late_plant, [part]) is wider  # it lies inside
