"""Several starts: the least of many minima is found, and a status says settled only where it is."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from made_rigs import Bare
from scipy.stats import chi2

from deatwin.ident.greybox import FitStatus, Part, calibrate, profile, starts
from deatwin.ident.greybox.minimum import Minimum
from deatwin.plant import DataError, Experiment, ModelError, Parameter, Plant, Recording, Scale
from deatwin.plant.builder import Builder

H, COUNT, NOISE = 0.02, 450, 0.02
TRUE = {"gain": 8.0, "damping": 1.2, "stiffness": 20.0}


@dataclass(frozen=True, kw_only=True)
class Rotor(Bare):
    """A motor turns an unbalanced rotor, which may turn over: the error over a long record has many minima."""

    sample_time: float = H
    noise: float = 0.0
    kind: ClassVar[str] = "rotor"
    input_name: ClassVar[str] = "voltage"
    output_name: ClassVar[str] = "angle"
    output_unit: ClassVar[str] = "rad"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        log = Scale.LOGARITHMIC
        return (
            Parameter(name="gain", value=4.0, unit="1", lower=0.2, upper=100.0, scale=log),
            Parameter(name="damping", value=1.0, unit="1/s", lower=0.02, upper=50.0, scale=log),
            Parameter(name="stiffness", value=12.0, unit="1/s2", lower=1.0, upper=300.0, scale=log),
        )

    def write(self, build: Builder) -> Any:
        angle, rate = build.state("angle", scale=1.0), build.state("rate", scale=5.0)
        back = build.parameter("stiffness") * ca.sin(angle) + build.parameter("damping") * rate
        build.rate(angle, rate)
        build.rate(rate, build.parameter("gain") * build.command - back)
        return angle


@pytest.fixture(scope="module")
def turned() -> Recording:
    """By another integrator than the plant's: symplectic Euler, twenty steps a sample."""
    rng = np.random.default_rng(11)
    command = np.repeat(rng.uniform(-4, 4, COUNT // 30), 30)
    angle = rate = 0.0
    seen = []
    for u in command:
        for _ in range(20):
            rate += H / 20 * (TRUE["gain"] * u - TRUE["damping"] * rate - TRUE["stiffness"] * np.sin(angle))
            angle += H / 20 * rate
        seen.append(angle)
    assert np.ptp(seen) > 2 * np.pi  # it turned over
    return Recording.from_arrays(command, np.array(seen) + NOISE * rng.normal(size=COUNT), H)


pytestmark = pytest.mark.usefixtures("uncompiled")


def started(seed: int) -> Plant:
    rng = np.random.default_rng(seed)
    return Plant(rig=Rotor(), values={name: value * np.exp(0.8 * rng.normal()) for name, value in TRUE.items()})


def test_the_least_of_many_minima_is_found_from_wherever_it_starts(turned):
    alone = several = 0
    for seed in range(3):
        one, found = calibrate(started(seed), turned, starts=1), calibrate(started(seed), turned)
        alone += one.rms < 1.5 * NOISE
        several += found.rms < 1.5 * NOISE
        assert found.rms < 1.5 * NOISE or found.status is not FitStatus.SETTLED
        if found.status is FitStatus.SETTLED:
            assert found.agreed >= 2 and f"{found.agreed} of {found.starts} starts agree" in str(found)
    assert alone < 2  # a single descent is not enough
    assert several == 3


def test_recordings_and_experiments_are_taken_as_they_are(turned):
    experiment = Experiment(recordings=(turned,))
    part = Part.whole(experiment)
    plant = Plant(rig=Rotor(), values=TRUE)
    given = (turned, experiment, part, [turned], [experiment], [part])
    assert len({calibrate(plant, one, starts=1).rms for one in given}) == 1
    for wrong, message in (([], "no recording"), ([3.0], "a float is not a recording")):
        with pytest.raises(DataError, match=message):
            calibrate(plant, wrong)
    silent = replace(turned, outputs=np.empty((0, turned.n_samples)), output_names=(), output_units=())
    with pytest.raises(DataError, match="no output"):
        calibrate(plant, silent)
    with pytest.raises(ModelError, match="needs a Plant, not a Rotor"):
        calibrate(plant.rig, turned)
    for name in ("starts", "evaluations"):
        for wrong in (0, 2.5, None, "a"):  # two and a half evaluations would never be used up
            with pytest.raises(ModelError, match=f"{name} = {wrong!r}; it must be an integer of at least 1"):
                calibrate(plant, turned, **{name: wrong})
    for name, wrong in (("tolerance", 0.0), ("tolerance", "a"), ("hopeless", None)):
        with pytest.raises(ModelError, match=f"^{name} "):
            calibrate(plant, turned, **{name: wrong})


def test_names_are_free_parameters_each_given_once(turned):
    plant = Plant(rig=Rotor(), values=TRUE)
    name = next(iter(plant.parameters.free))
    found = calibrate(plant, turned, names=name, starts=1)
    assert found.names == (name,)
    for wrong, message in (([], "no name of a parameter"), ([name, name], f"{name} is given twice")):
        with pytest.raises(DataError, match=message):
            calibrate(plant, turned, names=wrong)
    for ask in (found.interval, found.is_determined, lambda other: profile(found, (), other)):
        with pytest.raises(ModelError, match="'zero_' was not fitted"):
            ask("zero_")


def where_it_starts(problem, **_):
    """A search that says at once that it settled."""
    residuals, jacobian = problem.evaluate(problem.start())
    return Minimum(
        coordinates=problem.start(), residuals=residuals, jacobian=jacobian, status=FitStatus.SETTLED, evaluations=1
    )


def test_a_descent_that_stops_on_a_slope_does_not_say_that_it_settled(turned, monkeypatch):
    monkeypatch.setattr(starts, "minimise", where_it_starts)
    start = Plant(rig=Rotor(), values=TRUE | {"gain": 7.0})
    assert calibrate(start, turned.section(0, 200), starts=1).status is FitStatus.UNSETTLED


def test_a_least_minimum_that_one_start_alone_found_is_not_settled(turned, monkeypatch):
    ends = iter([3.0, 2.0, 1.0, 4.0])  # the first two from the given values

    def elsewhere(problem, **options):
        residuals, jacobian = problem.evaluate(problem.start())
        size = next(ends)
        return Minimum(
            coordinates=problem.start(),
            residuals=np.full(residuals.size, size),
            jacobian=0.0 * jacobian,
            status=FitStatus.SETTLED,
            evaluations=1,
        )

    monkeypatch.setattr(starts, "minimise", elsewhere)
    monkeypatch.setattr(starts, "_FIRST", 1.0)  # no openings
    found = calibrate(Plant(rig=Rotor(), values=TRUE), turned.section(0, 100), starts=3)
    assert (found.rms, found.starts, found.agreed, found.evaluations) == (1.0, 3, 1, 4)
    assert found.status is FitStatus.OTHER_MINIMA


def test_an_opening_holds_the_first_samples_that_count(turned):
    experiment = Experiment(recordings=(turned.section(0, 100), turned.section(100, 200)))
    masks = tuple(np.arange(100) % 2 == 0 for _ in range(2))
    part = Part(experiment=experiment, masks=masks)
    for count in (1, 20, 50, 51, 70, 100):
        opening = part.opening(count)
        np.testing.assert_array_equal(opening.measured, part.measured[:count])
        assert opening.masks[-1][-1]


def test_a_parameter_that_the_readings_do_not_show_is_said_to_be_undetermined(turned):
    still = replace(turned, inputs=np.zeros_like(turned.inputs), outputs=np.zeros_like(turned.outputs))
    found = calibrate(Plant(rig=Rotor(), values=TRUE), still, names=["gain"], starts=1)
    assert not found.is_determined("gain")
    assert found.interval("gain") == pytest.approx((0.2, 100.0))
    assert "gain = 8 (undetermined" in str(found)
    assert calibrate(Plant(rig=Rotor(), values=TRUE), turned, starts=1).is_determined("gain")


def test_what_a_range_does_not_allow_is_no_slope_that_was_left(turned, monkeypatch):
    """Noise draws a parameter that hardly matters far out of its range; the fit cannot follow it there."""

    @dataclass(frozen=True, kw_only=True)
    class Faint(Rotor):
        @property
        def parameters(self) -> tuple[Parameter, ...]:
            return (*super().parameters, Parameter(name="faint", value=0.5, unit="1", lower=0.0, upper=1.0))

        def write(self, build: Builder) -> Any:
            return super().write(build) + 1e-6 * build.parameter("faint") * ca.cos(3.0 * build.command)

    best = calibrate(Plant(rig=Rotor(), values=TRUE), turned, starts=1, tolerance=1e-9).plant.parameters
    values = {name: best[name].value for name in TRUE}
    monkeypatch.setattr(starts, "minimise", where_it_starts)
    found = calibrate(Plant(rig=Faint(), values=values), turned, starts=1)
    assert found.status is FitStatus.SETTLED
    assert calibrate(Plant(rig=Faint(), values=values | {"gain": 8.2}), turned, starts=1).status is FitStatus.UNSETTLED


@dataclass(frozen=True, kw_only=True)
class Squared(Rotor):
    """A lag whose gain is the square of a parameter: its sign can never be known."""

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (
            Parameter(name="rate", value=2.0, unit="1/s", lower=0.1, upper=10.0, scale=Scale.LOGARITHMIC),
            Parameter(name="root", value=0.5, unit="1", lower=-3.0, upper=3.0),
        )

    def write(self, build: Builder) -> Any:
        level = build.state("level", scale=1.0)
        build.rate(level, build.parameter("root") ** 2 * build.command - build.parameter("rate") * level)
        return level


def test_equally_good_values_of_the_parameters_are_told():
    rng = np.random.default_rng(3)
    command, level = np.repeat(rng.uniform(-1, 1, 20), 10), [0.0]
    for u in command:  # exact: the lag of a held command
        level.append(np.exp(-H) * level[-1] + 2.25 * u * (1.0 - np.exp(-H)))
    noise = 0.01 * rng.standard_normal(command.size)
    found = calibrate(Plant(rig=Squared()), Recording.from_arrays(command, np.array(level[1:]) + noise, H))
    assert found.status is FitStatus.EQUAL_MINIMA
    assert sorted([found.plant.parameters["root"].value, found.equals[0][1]]) == pytest.approx([-1.5, 1.5], rel=0.02)
    assert found.equals[0][0] == pytest.approx(1.0, rel=0.05) and ", or " in str(found)


def test_a_parameter_outside_of_an_expressions_domain_is_named_with_it(turned):
    @dataclass(frozen=True, kw_only=True)
    class Rooted(Squared):
        def write(self, build: Builder) -> Any:
            level = build.state("level", scale=1.0)
            mass = ca.sqrt(build.parameter("root"))
            build.rate(level, build.command - build.parameter("rate") * level, mass=mass)
            return level

    found = calibrate(Plant(rig=Rooted(), values={"root": -1.0}), turned)
    assert found.status is FitStatus.IMPOSSIBLE and np.isnan(found.rms)
    assert "the mass of state level has no finite value: sqrt(root) has no finite value at root = -1" in str(found)


def test_without_parameters_an_error_scatters_as_that_of_white_noise():
    """Twice the log likelihood of two equal models differs by less than the 95 % quantile of its chi-squared law."""
    left = np.random.default_rng(4).standard_normal(900)
    limit = starts.largest_alike(left, np.empty((900, 0)))
    assert limit**2 == pytest.approx((1.0 + chi2.ppf(0.95, 1) / 900) * np.mean(left**2))
