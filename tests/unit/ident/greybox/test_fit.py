"""Calibration against known truths, on a rig that solves in milliseconds."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest
from made_fits import made_fit
from made_rigs import Bare
from stopping import StopAt

from deatwin.ident.greybox import Calibration, FitStatus, Part, calibrate
from deatwin.ident.greybox.covariance import covariance
from deatwin.ident.greybox.parts import reading_times, simulated
from deatwin.ident.greybox.problem import Problem
from deatwin.plant import Builder, DataError, Diaphragm, Experiment, Place, Plant, ReadingTime, Recording, SensorJump
from deatwin.plant.parameters import Parameter, Scale
from deatwin.plant.simulate import Simulator

TRUTH = {"mass": 1.3, "damping": 2.6, "stiffness": 520.0}


def noise_command(seed: int, n: int = 1500) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal(n)


def recorded(plant: Plant, command: np.ndarray, seed: int | None = None) -> Experiment:
    blank = Experiment(recordings=(Recording.from_arrays(command, np.zeros_like(command), plant.rig.sample_time),))
    if seed is None:
        outputs = plant.simulate(blank).require().outputs[0]
        return Experiment(recordings=(replace(blank.recordings[0], outputs=outputs),))
    return plant.record(blank, np.random.default_rng(seed))


@pytest.fixture
def plant(oscillator) -> Plant:
    return Plant(rig=oscillator(noise=1e-4))


def test_the_truth_is_found_without_noise(plant):
    experiment = recorded(plant.with_values(TRUTH), noise_command(0))
    # the position is linear in 1/mass: mass, damping and stiffness share no scale here because force is known
    found = calibrate(plant, [Part.whole(experiment)])
    assert found.status is FitStatus.SETTLED
    for name, value in TRUTH.items():
        assert found.plant.parameters[name].value == pytest.approx(value, rel=1e-4)


def test_jacobian_agrees_with_central_differences(plant):
    experiment = recorded(plant.with_values(TRUTH), noise_command(1, 300))
    problem = Problem(plant=plant, parts=(Part.whole(experiment),), names=plant.parameters.free)
    x = problem.start()
    residuals, jacobian = problem.evaluate(x)
    for k in range(x.size):
        step = 1e-5 * abs(x[k])
        shift = np.eye(x.size)[k] * step
        plus, minus = problem.evaluate(x + shift)[0], problem.evaluate(x - shift)[0]
        numeric = -(plus - minus) / (2 * step)
        # central differences are good to step**2 relative
        assert np.linalg.norm(jacobian[:, k] - numeric) <= 1e-6 * np.linalg.norm(numeric)
    assert residuals.shape == (300,)


@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_a_plant_whose_derivative_is_not_finite_has_failed(plant, monkeypatch, value):
    problem = Problem(plant=plant, parts=(Part.whole(recorded(plant, noise_command(1, 300))),), names=("mass",))
    assert problem.evaluate(problem.start()) is not None
    run = Simulator.run_with_sensitivities

    def broken(*arguments, **named):
        found = run(*arguments, **named)
        sensitivities = found.sensitivities.copy()
        sensitivities[7] = value
        return replace(found, sensitivities=sensitivities)

    monkeypatch.setattr(Simulator, "run_with_sensitivities", broken)
    assert problem.evaluate(problem.start()) is None


def test_95_percent_intervals_cover_the_truth(plant):
    truth = plant.with_values(TRUTH)
    command = noise_command(2)
    hits = []
    for seed in range(40):
        found = calibrate(plant, [Part.whole(recorded(truth, command, seed))], starts=1)
        for name, value in TRUTH.items():
            low, high = found.interval(name)
            hits.append(low <= value <= high)
    # 120 intervals of 95 %: the number that cover is below 103 once in 10,000 (binomial; parameters taken as
    # independent, and a small sample costs a consistent covariance some coverage)
    assert sum(hits) >= 103
    assert sum(hits) < 120


def test_only_counted_samples_matter(plant):
    experiment = recorded(plant.with_values(TRUTH), noise_command(3))
    record = experiment.recordings[0]
    spoiled = record.outputs.copy()
    spoiled[0, 1000:] += 1.0
    early = np.arange(record.n_samples) < 1000
    part = Part(experiment=Experiment(recordings=(replace(record, outputs=spoiled),)), masks=(early,))
    found = calibrate(plant, [part])
    assert found.residuals.shape == (1000,)
    assert found.plant.parameters["stiffness"].value == pytest.approx(TRUTH["stiffness"], rel=1e-4)


@pytest.mark.parametrize("reading", [ReadingTime.END_OF_HOLD, ReadingTime.START_OF_HOLD])
def test_readings_are_taken_when_the_simulation_has_them(reading):
    """A jump between two of these times is in all readings from the later one on, and in none before."""
    plant = Plant(rig=Diaphragm(reading=reading))
    step = 1.0009 * plant.rig.sample_time  # as near as it must be
    blank = Experiment(
        recordings=(
            Recording.from_arrays(np.full(40, 2.0), np.zeros(40), step, start=3.0),
            Recording.from_arrays(np.full(900, 2.0), np.zeros(900), step, start=3.0 + 60 * step),
        )
    )
    part = Part.whole(blank)
    times = reading_times(plant, [part])
    for k in (7, 39, 40, 55, 930):
        at = (times[k - 1] + times[k]) / 2
        change = simulated(plant.with_effects(SensorJump(change=1e-4, at=at)), [part]) - simulated(plant, [part])
        assert np.array_equal(change > 0.5e-4, times > at)  # it takes a quarter of a sample


def test_several_experiments_start_from_rest_each(plant):
    truth = plant.with_values(TRUTH)
    parts = [Part.whole(recorded(truth, noise_command(seed, 400))) for seed in (4, 5)]
    found = calibrate(plant, parts)
    assert found.rms < 1e-9
    assert found.residuals.shape == (800,)


def test_a_parameter_on_its_bound_is_reported(plant):
    experiment = recorded(plant.with_values({**TRUTH, "damping": 0.0}), noise_command(6), seed=1)
    found = calibrate(plant, [Part.whole(experiment)])
    low, _ = found.interval("damping")
    assert low == 0.0
    assert set(found.at_bound) <= {"damping"}


def test_a_plant_that_cannot_be_simulated_is_a_status():
    soft = Plant(rig=Diaphragm()).with_values({"shear_modulus": 6e3, "stretch_limit": 1e4})
    command = np.full(200, 3.7)
    command[:100] = 3.5
    experiment = Experiment(recordings=(Recording.from_arrays(command, np.zeros(200), 0.02),))
    found = calibrate(soft, [Part.whole(experiment)])
    assert found.status is FitStatus.IMPOSSIBLE
    assert not found.status.ok


def test_masks_must_fit_the_recordings(plant):
    experiment = recorded(plant, noise_command(7, 100))
    with pytest.raises(DataError, match=r"masks have \[99\] samples, the recordings \[100\]"):
        Part(experiment=experiment, masks=(np.ones(99, dtype=bool),))


def test_the_covariance_is_that_of_newey_and_west():
    """Econometrica 55 (1987) 703, doi:10.2307/1913610, equation 5, written as its sum over lags."""
    rng = np.random.default_rng(0)
    jacobian = np.cumsum(rng.normal(size=(400, 3)), axis=0)
    noise = np.convolve(rng.normal(size=420), np.ones(21), "valid")  # correlated: the lags count
    residuals = noise - jacobian @ np.linalg.lstsq(jacobian, noise)[0]
    scores, lags = jacobian * residuals[:, None], 20
    meat = scores.T @ scores
    for lag in range(1, lags + 1):
        gamma = scores[lag:].T @ scores[:-lag]
        meat += (1 - lag / (lags + 1)) * (gamma + gamma.T)
    bread = np.linalg.inv(jacobian.T @ jacobian)
    expected = 400 / 397 * bread @ meat @ bread
    white = residuals @ residuals / 397 * np.diag(bread)
    assert np.all(np.diag(expected) > white)
    np.testing.assert_allclose(covariance(residuals, jacobian), expected, rtol=1e-9)


def test_a_parameter_that_all_but_does_nothing_is_like_one_that_does_nothing():
    rng = np.random.default_rng(3)
    jacobian, residuals = rng.standard_normal((500, 3)), rng.standard_normal(500)
    none, hardly = (covariance(residuals, np.hstack([jacobian, np.full((500, 1), size)])) for size in (0.0, 1e-156))
    assert np.isfinite(hardly).all()
    np.testing.assert_allclose(hardly, none, rtol=1e-12, atol=1e-100)
    assert (np.diag(hardly)[:3] > 0.0).all()


def test_a_covariance_of_parameters_that_are_all_but_one_has_no_negative_eigenvalue():
    """What rounding leaves of a product of a matrix with itself is below n eps of its diagonal (Higham 2002, 3.12)."""
    rng = np.random.default_rng(5)
    one = np.cumsum(rng.standard_normal(3000))
    jacobian = (one[:, None] + 1e-4 * rng.standard_normal((3000, 6))) * 10.0 ** np.arange(-3, 3)
    found = covariance(np.cumsum(rng.standard_normal(3000)), jacobian)
    scaled = found / np.sqrt(np.outer(np.diag(found), np.diag(found)))
    rounding = 3000 * np.finfo(float).eps
    np.testing.assert_allclose(scaled, scaled.T, rtol=0, atol=rounding)
    assert np.linalg.eigvalsh(scaled).min() > -rounding


def fit_with(*columns: np.ndarray) -> Calibration:
    """Of parameters between 1 and 100 whose readings change so, with white noise left."""
    names = tuple("abcd"[: len(columns)])
    kind = {"value": 10.0, "unit": "1", "lower": 1.0, "upper": 100.0, "scale": Scale.LOGARITHMIC}
    parameters = {name: Parameter(name=name, **kind) for name in names}
    jacobian, residuals = np.column_stack(columns), np.random.default_rng(2).standard_normal(500)
    known = {"covariance": covariance(residuals, jacobian), "jacobian": jacobian}
    return made_fit(SimpleNamespace(parameters=parameters), residuals, *names, **known)


def test_a_parameter_that_the_readings_do_not_show_may_be_anywhere_in_its_range():
    one, other = 10.0 * np.random.default_rng(1).standard_normal((2, 500))
    found = fit_with(one, other, np.zeros(500))
    assert found.undetermined == {"c"}
    assert found.interval("c") == (1.0, 100.0)
    low, high = found.interval("a")
    # the logarithm of ten scatters by 1 / |column|, 1 / (10 root 500)
    assert np.log(high / low) == pytest.approx(2 * 1.96 / (10 * np.sqrt(500)), rel=0.3)


def test_two_that_do_the_same_are_both_undetermined_and_the_others_are_not():
    one, other = 10.0 * np.random.default_rng(1).standard_normal((2, 500))
    found = fit_with(one, other, 0.1 * one)
    assert found.undetermined == {"a", "c"}
    assert found.interval("a") == found.interval("c") == (1.0, 100.0)
    assert found.interval("b") == pytest.approx(fit_with(other).interval("a"), rel=0.01)
    # one that does nothing over its whole range takes nothing from the other, though their columns are alike
    assert fit_with(one, other, 1e-7 * one).undetermined == {"c"}
    # one whose range is far too wide, as that of an arbitrary zero, is no measure of what the others do
    assert fit_with(one, other, one[::-1], 1e8 * other[::-1]).undetermined == frozenset()
    assert fit_with(one, other, 0.1 * one, 1e8 * other[::-1]).undetermined == {"a", "c"}
    # what can be told apart, if badly, is
    assert not fit_with(one, other, one + 1e-4 * other[::-1]).undetermined


@pytest.mark.parametrize(
    ("name", "said"), [("width", "width is not a parameter"), ("stifness", 'did you mean "stiffness"')]
)
def test_a_name_that_cannot_be_fitted_is_refused(plant, name, said):
    experiment = recorded(plant, noise_command(0, 50))
    with pytest.raises(DataError, match=said):
        calibrate(plant, [Part.whole(experiment)], names=[name])


def test_progress_grows_and_counts_simulations(plant):
    told = []
    found = calibrate(
        plant, recorded(plant.with_values(TRUTH), noise_command(3), 3), progress=lambda *now: told.append(now)
    )
    shares = [share for share, _ in told]
    assert shares == sorted(shares)
    assert 0.0 < shares[0] < 0.3 < shares[-1] < 1.0
    assert len(told) >= found.evaluations / 2  # openings count by their lengths
    assert told[0][1] == "fit from the given values, 1 simulations"


@pytest.mark.parametrize("call", [3, 13, 41])
def test_an_interrupt_keeps_the_best_so_far(plant, call):
    experiment = recorded(plant.with_values(TRUTH), noise_command(4), 4)
    stop = StopAt(call)
    found = calibrate(plant, experiment, progress=stop)
    if len(stop.told) < call:
        pytest.skip("the search ended before")
    assert found.status is FitStatus.INTERRUPTED
    assert found.status.ok
    assert "interrupted" in str(found)
    problem = Problem(plant=plant, parts=(Part.whole(experiment),), names=plant.parameters.free)
    start = problem.evaluate(problem.start())[0]
    assert found.rms < np.sqrt(np.mean(start**2))
    with pytest.raises(KeyboardInterrupt):
        calibrate(plant, experiment, progress=StopAt(1))


@pytest.mark.parametrize(
    ("upper", "foreseen"),
    [
        (100.0, 2.5),  # a step of 1 leaves the linear model's minimum
        (0.5, np.sqrt(6.25 + 0.25)),  # half of it is possible
        (0.0, np.sqrt(7.25)),  # none: the fit is at its minimum
    ],
)
def test_a_fit_that_stopped_foresees_its_minimum_within_the_bounds(upper, foreseen):
    along, across = np.tile([1.0, 1.0], 50), np.tile([1.0, -1.0], 50)
    free = Parameter(name="a", value=0.0, unit="1", lower=-100.0, upper=upper)
    plant = SimpleNamespace(parameters={"a": free}, event_times=())
    residuals, jacobian = along + 2.5 * across, along[:, None]
    stopped, settled = (
        made_fit(plant, residuals, "a", jacobian=jacobian, status=status, evaluations=3)
        for status in (FitStatus.STOPPED, FitStatus.SETTLED)
    )
    assert stopped.foreseen == pytest.approx(foreseen)
    assert settled.foreseen == settled.rms == pytest.approx(np.sqrt(7.25))
    far = made_fit(plant, 3.0 * along + across, "a", jacobian=jacobian, status=FitStatus.STOPPED, evaluations=3)
    assert far.foreseen == far.rms  # its linear model is not trusted that far


@dataclass(frozen=True, kw_only=True)
class Cliff(Bare):
    """The reading is the command, and near a = 1 it changes by 1e160 m per unit of a: its square overflows."""

    kind: ClassVar[str] = "cliff"
    follows_at_once: ClassVar[bool] = True

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(name="a", value=1.0, unit="1", lower=0.5, upper=2.0),)

    def write(self, build: Builder) -> Any:
        return build.place(Place.SENSOR, "reading", build.command + 1e160 * (build.parameter("a") - 1.0))


def test_a_derivative_whose_square_overflows_is_no_start_and_no_crash():
    """The readings themselves are finite. A fit of a candidate that is so steep must fail, not the whole diagnosis."""
    command = noise_command(3, 50)
    fit = calibrate(Plant(rig=Cliff()), Recording.from_arrays(command, command, Cliff().sample_time))
    assert fit.status is FitStatus.IMPOSSIBLE
