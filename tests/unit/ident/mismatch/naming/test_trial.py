"""Where the fit of a set of effects begins, and when it begins again."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_fits import made_fit
from made_rigs import Pushed

from deatwin.ident.greybox import Calibration, FitStatus
from deatwin.ident.greybox.fit import descend
from deatwin.ident.greybox.parts import parts_of
from deatwin.ident.mismatch.naming import trial
from deatwin.ident.mismatch.naming.trial import Trial, _is_near, _otherwise, _tried, refitted, run_trials, unbiased_like
from deatwin.plant import (
    CoulombFriction,
    Creep,
    CubicStiffness,
    Diaphragm,
    Disc,
    Experiment,
    PeriodicDisturbance,
    Plant,
    Recording,
    SensorJump,
    catalogue,
)
from deatwin.plant.effects import Effect
from deatwin.plant.parameters import Parameter

PLANT = Plant(rig=Diaphragm()).with_effects(Creep())


def fit_of(rms: float, plant: Plant | None = None) -> SimpleNamespace:
    """A settled fit, by default of the rig alone."""
    known = plant or Plant(rig=Diaphragm())
    told = {"status": FitStatus.SETTLED, "given_up": False, "at_bound": ()}
    names, exact = known.parameters.free, np.zeros(2 * (len(known.parameters.free),))
    return SimpleNamespace(**told, rms=rms, foreseen=rms, plant=known, names=names, covariance=exact)


@pytest.mark.parametrize(
    "share, ended",
    [
        (0.0, 3.3),  # better than without the effect, and no more was promised
        (0.7, 3.3),  # 6.4 sqrt(0.3) = 3.5: kept
        (0.9, 2.1),  # 2.0 was promised: the search lost its way, and the biased plant is nearer
    ],
)
def test_a_search_that_does_not_keep_what_the_score_promises_is_made_from_the_bent_plant(monkeypatch, share, ended):
    monkeypatch.setattr(trial, "search", lambda *_: fit_of(3.3))
    monkeypatch.setattr(trial, "descend", lambda *_, **__: fit_of(2.1))
    monkeypatch.setattr(trial, "at_its_time", lambda fit, *_, **__: fit)
    task = Trial(start=PLANT, biased=PLANT, without=fit_of(6.4), share=share)
    assert _tried(SimpleNamespace(fitted=()), task, float("inf")).rms == ended


@pytest.mark.parametrize("damping", [2.0, 1e-6])  # of the fit without the effect, which may be wrong itself
def test_a_parameter_without_influence_at_its_nominal_value_is_found(damping):
    """A nominal damping that is a hundred times too small changes no reading, so nothing leads a fit away from it."""
    rng, noise = np.random.default_rng(1), 1e-6
    nominal = Plant(rig=Disc(noise=noise))
    true = nominal.with_effects(Creep(modulus=36e3, time=12.0)).with_values({"damping": 2.0})
    commands = np.repeat(rng.uniform(1.0, 4.0, 60), 25)
    silent = Recording.from_arrays(commands, np.zeros(commands.size), nominal.rig.sample_time)
    exact = true.simulate(Experiment(recordings=(silent,))).outputs[0][0]
    measured = exact + noise * rng.standard_normal(exact.size)
    recording = Recording.from_arrays(commands, measured, nominal.rig.sample_time)
    parts = parts_of([Experiment(recordings=(recording,))], nominal.rig)
    without = descend(nominal.with_values({"damping": damping}), parts)
    biased = without.plant.with_effects(Creep())
    found = _tried(
        SimpleNamespace(fitted=parts),
        Trial(start=nominal.with_effects(Creep()), biased=biased, without=without),
        np.inf,
    )
    assert not found.at_bound
    assert found.rms == pytest.approx(noise, rel=3 / np.sqrt(2 * exact.size))  # three standard deviations


@pytest.mark.parametrize(("found", "ended"), [(6.6, 5.1), (6.5, 6.5)])  # more than 1.02 times 6.4, or not
def test_a_fit_that_leaves_more_than_without_the_effect_begins_where_there_is_little_of_it(monkeypatch, found, ended):
    begun = []
    monkeypatch.setattr(trial, "search", lambda *_: fit_of(found))
    monkeypatch.setattr(trial, "descend", lambda *_, **__: fit_of(found))
    monkeypatch.setattr(trial, "roughly", lambda plant, *_: begun.append(plant) or fit_of(5.1))
    monkeypatch.setattr(trial, "at_its_time", lambda fit, *_, **__: fit)
    spring = CubicStiffness(stiffness=-2e7)
    without = PLANT.with_values({"shear_modulus": 2e4})
    start = PLANT.with_effects(spring).with_values({"creep.modulus": 3e4})
    task = Trial(start=start, biased=start, without=fit_of(6.4, without))
    assert _tried(SimpleNamespace(fitted=()), task, float("inf")).rms == ended
    for plant in begun:
        values = {name: plant.parameters[name].value for name in ("shear_modulus", "creep.modulus")}
        assert values == {name: without.parameters[name].value for name in values}  # all as it was
        assert plant.parameters["cubic_stiffness.stiffness"].value == pytest.approx(-2e4)
    assert len(begun) == (ended == 5.1)


@pytest.mark.parametrize("rms, ended", [(4.0, 2.1), (5.0, 5.0)])  # 4.0^2 is less than half of 6.4^2, 5.0^2 more
def test_a_fit_that_already_takes_most_of_the_mismatch_is_not_given_up(monkeypatch, rms, ended):
    """As that of a lag whose size is off by a factor of twenty, and whose linearised minimum says little."""
    given_up = SimpleNamespace(status=FitStatus.GIVEN_UP, rms=rms, foreseen=rms, given_up=True, plant=None, at_bound=())
    monkeypatch.setattr(trial, "search", lambda *_: given_up)
    monkeypatch.setattr(trial, "further", lambda *_, **__: fit_of(2.1))
    monkeypatch.setattr(trial, "at_its_time", lambda fit, *_, **__: fit)
    monkeypatch.setattr(trial, "descend", lambda *_, **__: fit_of(9.0))  # from the biased plant
    task = Trial(start=PLANT, biased=PLANT, without=fit_of(6.4), share=0.1)
    assert _tried(SimpleNamespace(fitted=()), task, 3.0).rms == ended


def test_what_is_explained_to_first_order_is_promised():
    assert Trial(start=None, biased=None, without=fit_of(5.0), share=0.64).promised == pytest.approx(3.0)


def rough(rms: float, linearised: float, status: FitStatus) -> Calibration:
    """A fit whose linear model would leave so much, by one more step of its only parameter."""
    along, across = np.tile([1.0, 1.0], 50), np.tile([1.0, -1.0], 50)
    residuals = linearised * across + float(np.sqrt(rms**2 - linearised**2)) * along
    free = Parameter(name="a", value=0.0, unit="1", lower=-100.0, upper=100.0)
    plant = SimpleNamespace(rig=SimpleNamespace(model_error=0.1), parameters={"a": free}, event_times=())
    return made_fit(plant, residuals, "a", jacobian=along[:, None], status=status, evaluations=10)


def test_what_ran_out_of_simulations_on_its_way_to_the_best_is_carried_to_the_end(monkeypatch):
    """The place of a stop is found step by step; a rough fit of it may leave more than a wrong effect does at best."""
    settled, stopped = FitStatus.SETTLED, FitStatus.STOPPED
    fits = {
        "best": rough(2.0, 2.0, settled),
        "at its own end": rough(3.0, 2.1, settled),  # its linear model errs: it has ended there
        "on its way": rough(3.0, 2.19, stopped),  # 1.1 x 2.0 is 2.2
        "on its way elsewhere": rough(3.0, 2.21, stopped),
        "beside": rough(2.19, 2.19, settled),
    }
    finished: list[Calibration] = []
    monkeypatch.setattr(trial, "_tried", lambda problem, fit, hopeless: fit)
    monkeypatch.setattr(trial, "_finished", lambda problem, fit, noise: finished.append(fit) or fit)
    monkeypatch.setattr(trial, "judge", lambda problem, fit, noise: fit)
    assert run_trials(SimpleNamespace(jobs=1), list(fits.values()), 0.5) == list(fits.values())
    assert finished == [fits["best"], fits["on its way"], fits["beside"]]


@pytest.mark.parametrize("linearised, near", [(3.60, True), (3.61, False)])  # 3.606 is the root of 2.0^2 + 3.0^2
def test_what_may_leave_no_more_than_the_model_error_beyond_the_best_is_carried_to_the_end(linearised, near):
    fit = rough(4.0, linearised, FitStatus.STOPPED)
    fit.plant.rig.model_error = 3.0
    assert _is_near(fit, 2.0) is near


def strengths(plant: Plant, *before: Effect) -> list[dict[str, float]]:
    """With what strengths a fit begins where it cannot with those of `plant`, which had the effects `before`."""
    task = Trial(start=plant, biased=plant, without=fit_of(6.4, Plant(rig=Diaphragm()).with_effects(*before)))
    names = ("cubic_stiffness.stiffness", "creep.modulus", "amplifier_saturation.voltage")
    return [{n: p.parameters[n].value for n in names if n in p.parameters} for p in _otherwise(task)]


def test_a_fit_begins_with_an_effect_the_other_way_or_weaker_where_it_must():
    spring, creep = CubicStiffness(stiffness=-2e7), Creep(modulus=1e5)
    plant = Plant(rig=Diaphragm()).with_effects(creep, spring)
    beside_creep = [{"creep.modulus": 1e5, "cubic_stiffness.stiffness": value} for value in (2e7, -2e6, -2e4)]
    assert strengths(plant, creep) == beside_creep
    one_sided = Plant(rig=Diaphragm()).with_effects(creep)  # negative moduli are out of range
    assert [found["creep.modulus"] for found in strengths(one_sided)] == pytest.approx([1e4, 1e2])


def test_what_begins_otherwise_is_what_is_new_wherever_its_name_stands():
    """Effects are kept in the order of the alphabet: what was fitted before may be the last, and stays as it is."""
    spring, creep = CubicStiffness(stiffness=-2e7), Creep(modulus=1e5)
    plant = Plant(rig=Diaphragm()).with_effects(creep, spring)
    assert plant.effect_names[-1] == "cubic_stiffness"
    found = strengths(plant, spring)
    assert [one["cubic_stiffness.stiffness"] for one in found] == [-2e7, -2e7]
    assert [one["creep.modulus"] for one in found] == pytest.approx([1e4, 1e2])
    both = strengths(plant)  # where both are new, those go that can
    assert [one["cubic_stiffness.stiffness"] for one in both] == [2e7, -2e6, -2e4]
    assert [one["creep.modulus"] for one in both] == pytest.approx([1e5, 1e4, 1e2])


def test_a_further_effect_begins_beside_typical_values_except_for_what_is_sought_in_the_data():
    """A fit without the next effect biases sizes and times; directions, events and periods it can tell."""
    effects = (
        Creep(modulus=3e4, time=900.0),
        CubicStiffness(stiffness=-5e8),
        PeriodicDisturbance(amplitude=3e-6, frequency=3.3),
        SensorJump(change=-7e-6, at=12.5),
    )
    fitted = Plant(rig=Diaphragm()).with_effects(*effects).with_values({"shear_modulus": 3e4})
    nominal = Plant(rig=Diaphragm())
    problem = SimpleNamespace(nominal=nominal, everywhere=catalogue())
    begun = unbiased_like(problem, fitted)
    assert begun.effect_names == fitted.effect_names
    values = {name: parameter.value for name, parameter in begun.parameters.items()}
    assert values["shear_modulus"] == nominal.parameters["shear_modulus"].value
    assert (values["creep.modulus"], values["creep.time"]) == (Creep().modulus, Creep().time)
    assert values["cubic_stiffness.stiffness"] == -abs(CubicStiffness().stiffness)
    assert (values["periodic_disturbance.amplitude"], values["periodic_disturbance.frequency"]) == (3e-6, 3.3)
    assert (values["sensor_jump.change"], values["sensor_jump.at"]) == (-7e-6, 12.5)


@pytest.mark.parametrize(
    ("near", "far", "ended"),
    [
        (FitStatus.SETTLED, FitStatus.SETTLED, [3.0]),
        (
            FitStatus.IMPOSSIBLE,
            FitStatus.SETTLED,
            [2.0],
        ),  # with the values it had beside another effect it snaps through
        (FitStatus.IMPOSSIBLE, FitStatus.IMPOSSIBLE, []),
    ],
)
def test_what_is_fitted_again_begins_from_where_it_is_and_from_afar_only_where_it_must(monkeypatch, near, far, ended):
    fit = {"near": SimpleNamespace(status=near, rms=3.0), "far": SimpleNamespace(status=far, rms=2.0)}
    finished = []
    monkeypatch.setattr(trial, "roughly", lambda plant, parts: fit["near"])
    monkeypatch.setattr(trial, "search", lambda plant, parts: fit["far"])
    monkeypatch.setattr(trial, "at_its_time", lambda found, *_, **__: found)
    monkeypatch.setattr(trial, "_finished", lambda problem, found, noise: finished.append(found) or found)
    monkeypatch.setattr(trial, "judge", lambda problem, found, noise: SimpleNamespace(calibration=found, unseen=None))
    seen = []
    found = refitted(SimpleNamespace(jobs=1, fitted=()), [PLANT], 0.5, lambda found, _: seen.append(found))
    assert [one.calibration.rms for one in found] == ended
    assert [one.calibration for one in found] == finished == seen


def test_a_fit_of_friction_is_completed_with_as_many_steps_as_it_needs():
    """A mass of 10 g on 25 N/m is steered from stop to stop; the data are made with 64 steps per sample."""
    slow = Plant(rig=Pushed(noise=1e-6), values={"mass": 0.01, "damping": 0.05, "stiffness": 25.0})
    plant = slow.with_effects(CoulombFriction(force=5e-3, slip=1e-4))
    commands = np.repeat([0.0, 12.0, 4.0, 10.0, -6.0, 3.0], 20)
    recording = Recording(inputs=commands[None], outputs=np.zeros((1, commands.size)), sample_time=0.02)
    made = parts_of([replace(plant, steps=64).record(recording, np.random.default_rng(0))], plant.rig)
    problem = SimpleNamespace(fitted=made, everything=made, of_first=SimpleNamespace(fitted=made))
    coarse = descend(plant, problem.fitted)
    completed = trial._finished(problem, coarse, plant.rig.noise)
    assert coarse.plant.steps == 1 < completed.plant.steps
    # One step per sample leaves an error of 18 µm here, and eight of 1 µm (test_resolution).
    assert completed.rms < coarse.rms / 3
