"""Which forms of the base plant are fitted to all samples."""

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, ClassVar

import casadi as ca
import numpy as np
import pytest
from made_fits import made_fit, made_problem
from made_rigs import Bare
from runs import blank
from scipy.signal import lfilter

from deatwin.ident.greybox import Calibration, FitStatus
from deatwin.ident.greybox.parts import Part
from deatwin.ident.mismatch.refit import base
from deatwin.ident.mismatch.refit.search import OPENING_SAMPLES, approach, where_it_acts
from deatwin.plant import Diaphragm, Experiment, Parameter, Plant, ReadingTime, Recording, Scale, SensorJump
from deatwin.plant.builder import Builder

ALONG, ACROSS = np.tile([1.0, 1.0], 50), np.tile([1.0, -1.0], 50)


def opened(form: str, rms: float, linearised: float, status: FitStatus = FitStatus.STOPPED) -> Calibration:
    """A fit of the openings whose linear model would leave so much."""
    residuals = linearised * ACROSS + float(np.sqrt(rms**2 - linearised**2)) * ALONG
    return made_fit(form, residuals, "a", jacobian=ALONG[:, None], status=status, evaluations=8)


def test_a_form_that_ran_out_of_simulations_is_judged_by_its_linear_model(monkeypatch):
    openings = {
        "as well": opened("as well", 2.3, 2.3),
        "worse": opened("worse", 2.5, 2.5),
        "on its way": opened("on its way", 4.0, 2.3),
        "elsewhere": opened("elsewhere", 4.0, 2.5),
        "worse at its end": opened("worse at its end", 2.5, 2.3, FitStatus.SETTLED),
    }
    nominal = SimpleNamespace(rig=SimpleNamespace(noise=0.1, rivals=lambda: list(openings)), with_rig=lambda rig: rig)
    # whatever a form is given, the nominal one leaves 2 on the openings: the limit is 2.4
    first = SimpleNamespace(adequate=False, calibration=SimpleNamespace(plant=None), noise=0.1)
    settled: list[str] = []
    monkeypatch.setattr(base, "_fitted_well", lambda problem, form: first)
    monkeypatch.setattr(base, "free_run_rms", lambda plant, parts: 2.0)
    monkeypatch.setattr(base, "approach", lambda form, parts: openings[form])
    monkeypatch.setattr(base, "_settled", lambda near, form, parts, noise: settled.append(near))
    monkeypatch.setattr(base, "_judged", lambda problem, fit: None)
    monkeypatch.setattr(base, "replace", lambda candidate, noise: candidate)
    monkeypatch.setattr(base, "_preferred", lambda usable: usable[0])
    base.calibrate_base(made_problem(nominal=nominal))
    assert settled == ["as well", "on its way"]


def test_what_is_within_reach_of_a_fit():
    stopped = opened("", 4.0, 2.3)
    assert np.isclose(stopped.within_reach, 2.3)
    for status in (FitStatus.SETTLED, FitStatus.GIVEN_UP):
        assert np.isclose(replace(stopped, status=status).within_reach, 4.0)


def fitted(rig: Diaphragm) -> Any:
    return SimpleNamespace(calibration=SimpleNamespace(plant=SimpleNamespace(rig=rig)), noise=1e-6)


def test_the_form_of_the_rig_file_is_chosen_whatever_its_model_error_was_found_to_be():
    filed, early = fitted(replace(Diaphragm(), model_error=3e-6)), fitted(Diaphragm(reading=ReadingTime.START_OF_HOLD))
    bonded = fitted(Diaphragm(ball="bonded"))
    chosen = base.Base(chosen=early, alternatives=(bonded, filed), noise=1e-6).as_filed(Diaphragm())
    assert chosen.chosen is filed
    assert chosen.alternatives == (early, bonded)


def test_where_the_form_of_the_rig_file_could_not_be_simulated_another_one_stays():
    early = base.Base(chosen=fitted(Diaphragm(reading=ReadingTime.START_OF_HOLD)), alternatives=(), noise=1e-6)
    assert early.as_filed(Diaphragm()) is early


def test_the_other_starts_have_other_parameters_but_events_at_their_time():
    plant = Plant(rig=Diaphragm()).with_effects(SensorJump(change=30e-6, at=52.0))
    first, *others = base._starts(plant)
    assert first is plant and len(others) == base.MORE_STARTS
    for other in others:
        assert other.parameters["sensor_jump.at"].value == 52.0
        assert other.parameters["sensor_jump.change"].value != 30e-6


def test_the_rival_forms_are_asked_where_something_is_missing_in_one_that_was_good_enough(monkeypatch):
    """A small mismatch of the held-out part only is none to the calibration; the other reading may be all that it is."""
    early, bonded = fitted(Diaphragm(reading=ReadingTime.START_OF_HOLD)), fitted(Diaphragm(ball="bonded"))
    early.evidence, bonded.evidence, asked = 5.0, 9.0, []
    found = [early, fitted(Diaphragm()), bonded]  # the same form fitted once more is no alternative
    monkeypatch.setattr(base, "_other_forms", lambda problem, first: asked.append(first) or found)
    monkeypatch.setattr(
        base,
        "replace",
        lambda thing, **new: (
            SimpleNamespace(**vars(thing) | new) if isinstance(thing, SimpleNamespace) else replace(thing, **new)
        ),
    )
    chosen = fitted(Diaphragm())
    alone = base.Base(chosen=chosen, alternatives=(), noise=3e-6)
    found = base.beside_alternatives(None, alone)
    assert asked == [chosen] and found.chosen is chosen
    assert [form.evidence for form in found.alternatives] == [9.0, 5.0]
    assert {form.noise for form in found.alternatives} == {3e-6}  # they are judged by the same
    assert base.beside_alternatives(None, found) is found
    monkeypatch.setattr(base, "_other_forms", lambda problem, first: [])
    assert base.beside_alternatives(None, alone) is alone


@dataclass(frozen=True, kw_only=True)
class Lag(Bare):
    """It follows its command late."""

    kind: ClassVar[str] = "lag"
    late: float = 1e-4

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(name="late", value=self.late, unit="s", lower=1e-6, upper=1e4, scale=Scale.LOGARITHMIC),)

    def write(self, build: Builder) -> Any:
        position = build.state("position", scale=1.0)
        build.rate(position, build.command - position, mass=build.parameter("late"))
        return position


def test_a_parameter_that_does_nothing_where_a_fit_ended_is_looked_for_by_half_decades():
    commands = np.random.default_rng(1).normal(size=300)
    readings = Plant(rig=Lag(late=0.05)).simulate(blank(commands)).require().outputs[0][0]
    parts = [Part.whole(Experiment(recordings=(Recording.from_arrays(commands, readings, 0.02),)))]
    known = approach(Plant(rig=Lag(late=0.06)), parts)
    assert where_it_acts(known, parts, known.names) is known.plant
    # The lag is over within each sample: of its size the readings say nothing.
    asleep = replace(known, plant=Plant(rig=Lag()), covariance=np.full((1, 1), 1e4), residuals=readings - commands)
    found = where_it_acts(asleep, parts, asleep.names).parameters["late"].value
    assert abs(np.log10(found / 0.05)) <= 0.25  # the nearest of half decades


@dataclass(frozen=True, kw_only=True)
class Tipping(Bare):
    """Its reading grows without limit as the command nears a tipping point."""

    kind: ClassVar[str] = "tipping"

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(name="share", value=0.5, unit="1/V2", lower=0.0, upper=2.0),)

    def write(self, build: Builder) -> Any:
        position = build.state("position", scale=1.0)
        build.rate(position, -ca.log(1.0 - build.parameter("share") * build.command**2) - position, mass=0.05)
        return position


def test_a_plant_that_fits_the_opening_but_tips_later_is_fitted_from_its_nominal_values():
    """Missing physics makes it three times as sensitive in the opening, where the commands are small."""
    rng = np.random.default_rng(1)
    commands = np.concatenate([0.5 * rng.uniform(-1, 1, OPENING_SAMPLES), rng.uniform(-1, 1, 500)])
    share = np.where(np.arange(commands.size) < OPENING_SAMPLES, 1.5, 0.5)
    readings = lfilter([1 - np.exp(-0.4)], [1, -np.exp(-0.4)], -np.log(1 - share * commands**2))
    record = Recording.from_arrays(commands, readings + 1e-3 * rng.normal(size=commands.size), 0.02)
    parts = (Part.whole(Experiment(recordings=(record,))),)
    opened = approach(Plant(rig=Tipping(noise=1e-3)), parts)
    assert opened.plant.parameters["share"].value > 1.0  # from there the largest commands cannot be simulated
    found = base.calibrate_base(
        made_problem(nominal=Plant(rig=Tipping(noise=1e-3)), fitted=parts, unseen=parts, everything=parts)
    ).chosen
    assert 0.4 < found.calibration.plant.parameters["share"].value < 1.0


@dataclass(frozen=True, kw_only=True)
class Mass(Bare):
    """A mass on a spring that hardly dissipates."""

    kind: ClassVar[str] = "mass"
    spring: float = 1e4

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        return (Parameter(name="spring", value=self.spring, unit="1/s2", lower=0.0, upper=1e6),)

    def write(self, build: Builder) -> Any:
        position, velocity = build.state("position", scale=1.0), build.state("velocity", scale=100.0)
        build.rate(position, velocity)
        build.rate(velocity, build.parameter("spring") * (build.command - position) - velocity)
        return position


@pytest.mark.parametrize(("spring", "noise", "enough"), [(1e4, 1e-3, 5), (1e4, 10.0, 4), (1e2, 1e-3, 4)])
def test_candidates_are_simulated_with_fewer_stages_where_no_reading_shows_it(spring, noise, enough):
    # A step of four stages errs by 1.6e-4 of a mode at two radians a sample (`test_collocation`), by 2e-12 of one at a
    # tenth of that. Noise of 1e-3 shows the former in 300 samples; noise of 10 hides it.
    commands = np.random.default_rng(1).normal(size=300)
    plant = Plant(rig=Mass(spring=spring))
    chosen = SimpleNamespace(calibration=SimpleNamespace(plant=plant))
    parts = SimpleNamespace(fitted=[Part.whole(blank(commands))])
    assert base.enough_stages(parts, base.Base(chosen=chosen, alternatives=(), noise=noise)) == enough
