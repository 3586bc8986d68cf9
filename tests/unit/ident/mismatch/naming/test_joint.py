"""Which pairs are tried because they promise most together, on a linear problem whose answer is known."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.mismatch.naming.screen import Lead, LinearisedResponse
from deatwin.ident.mismatch.naming.sets import joint_trials
from deatwin.plant import Creep, Delay, Diaphragm, ElectrodeRC, Hysteresis, Plant, SensorDrift, SensorJump

PLANT = Plant(rig=Diaphragm())
ALIKE = np.linalg.qr(np.random.default_rng(3).normal(size=(400, 5)))[0].T
"""Five orthonormal signals."""
EFFECTS = {
    Creep(): ALIKE[0],
    SensorDrift(): 0.9 * ALIKE[0] + np.sqrt(1 - 0.9**2) * ALIKE[1],
    Hysteresis(): ALIKE[1] + 0.6 * ALIKE[2],
    Delay(): ALIKE[2],
    ElectrodeRC(): ALIKE[3],
}
"""What they do to the readings. Creep and the drift are nearly the same."""
RESIDUAL = 10e-6 * (EFFECTS[SensorDrift()] - EFFECTS[Creep()]) + 1e-6 * ALIKE[4]
"""Of a film that creeps one way while the sensor drifts the other; what creeps and what drifts alone explain little."""


def left_by(*effects) -> tuple[np.ndarray, np.ndarray]:
    columns = np.stack([EFFECTS[e] for e in effects], axis=1)
    return RESIDUAL - columns @ np.linalg.lstsq(columns, RESIDUAL, rcond=None)[0], columns


def fit_of(*effects) -> SimpleNamespace:
    left, columns = left_by(*effects)
    rms = float(np.sqrt(np.mean(left**2)))
    plant = PLANT.with_effects(*effects)
    fit = SimpleNamespace(plant=plant, residuals=left, jacobian=columns, movable=columns, rms=rms)
    return SimpleNamespace(calibration=fit)


def search_with(*sets) -> SimpleNamespace:
    known = [LinearisedResponse(effect=e, change=change) for e, change in EFFECTS.items()]
    tried = {tuple(e.name for e in effects): fit_of(*effects) for effects in sets}
    return SimpleNamespace(
        tried=tried,
        least_rms=lambda names: min((tried[n].calibration.rms for n in names), default=np.inf),
        is_possible=lambda candidate: True,
        known=lambda: known,
        event_leads=lambda *several: [() for _ in several],
        problem=SimpleNamespace(nominal=PLANT, everywhere=()),
    )


def names_of(trial) -> set[str]:
    return set(trial.start.effect_names)


def test_two_that_work_against_each_other_promise_most():
    alone = {e.name: np.linalg.norm(left_by(e)[0]) for e in EFFECTS}
    assert min(alone, key=alone.get) == "hysteresis"  # which is neither
    found = joint_trials(search_with((Hysteresis(),), (Creep(),)))
    assert names_of(found[0]) == {"creep", "sensor_drift"}
    # in a linear problem, to first order is all of it
    promised = [trial.promised for trial in found]
    exact = [fit_of(*(e for e in EFFECTS if e.name in names_of(trial))).calibration.rms for trial in found]
    assert promised == pytest.approx(exact, rel=1e-6)
    assert promised == sorted(promised)
    assert promised[0] == pytest.approx(1e-6 / np.sqrt(RESIDUAL.size), rel=1e-6)


def test_a_pair_is_promised_once_from_the_single_effect_that_promises_more():
    found = joint_trials(search_with((Hysteresis(),), (Creep(),), (SensorDrift(),)))
    # of seven pairs in which one of those is
    assert len(found) == len({frozenset(names_of(trial)) for trial in found}) == 3


def test_what_the_own_parameters_of_a_fit_that_was_given_up_would_take_is_no_promise():
    """Short of its minimum a fit leaves what no second effect can have, and promises as much as from there."""
    search = search_with((Hysteresis(),), (Creep(),), (SensorDrift(),))
    exact = [names_of(trial) for trial in joint_trials(search)]
    for candidate in search.tried.values():
        fit = candidate.calibration
        fit.residuals = fit.residuals - 3e-6 * fit.jacobian[:, 0]
        fit.rms = float(np.sqrt(np.mean(fit.residuals**2)))
    assert [names_of(trial) for trial in joint_trials(search)] == exact
    assert exact[0] == {"creep", "sensor_drift"}


def test_pairs_that_were_tried_are_not_tried_again():
    alone, pair = ((Hysteresis(),), (Creep(),)), (Delay(), Creep())
    anew = [names_of(trial) for trial in joint_trials(search_with(*alone))]
    assert anew[0] == {"creep", "sensor_drift"}
    again = [names_of(trial) for trial in joint_trials(search_with(*alone, pair))]
    assert again == [names for names in anew if names != {"creep", "delay"}]
    assert joint_trials(search_with(pair)) == []  # nothing was tried alone


def test_what_was_tried_takes_no_place_from_what_was_not():
    """Three pairs that promise most were tried: as many are made of the others that promise more than these kept."""
    alone = ((Hysteresis(),), (Creep(),), (Delay(),))
    first = joint_trials(search_with(*alone))
    assert len(first) == 3
    poor = fit_of(Delay(), ElectrodeRC())
    search = search_with(*alone)
    search.tried.update({tuple(trial.start.effect_names): poor for trial in first})  # their fits ended badly
    found = joint_trials(search)
    assert found and not {frozenset(names_of(t)) for t in found} & {frozenset(names_of(t)) for t in first}
    assert all(trial.promised < 1.1 * poor.calibration.rms for trial in found)


def test_what_promises_less_than_a_possible_pair_has_kept_is_not_tried():
    search = search_with((Hysteresis(),), (Creep(),), (SensorDrift(),), (Creep(), SensorDrift()))
    assert joint_trials(search) == []  # that one leaves next to nothing
    search.is_possible = lambda candidate: False  # but only in a film that is none
    assert len(joint_trials(search)) == 3


@pytest.mark.parametrize(("kept", "asked"), [(0.92, True), (0.89, False)])
def test_what_promises_nearly_as_much_is_tried(kept, asked):
    """To first order it is uncertain by a tenth."""
    search = search_with((Hysteresis(),), (Creep(),))
    first = joint_trials(search)[0]
    search.tried["delay", "electrode_rc"] = SimpleNamespace(
        calibration=SimpleNamespace(rms=kept * first.promised, plant=PLANT.with_effects(Delay(), ElectrodeRC()))
    )
    assert (names_of(first) in map(names_of, joint_trials(search))) is asked


def test_effects_of_the_plant_itself_belong_to_no_pair():
    search = search_with((Hysteresis(),), (Creep(),))
    search.problem.nominal = PLANT.with_effects(Delay())
    for candidate in search.tried.values():
        candidate.calibration.plant = candidate.calibration.plant.with_effects(Delay())
    found = joint_trials(search)
    assert all("delay" in names_of(trial) and len(names_of(trial)) == 3 for trial in found)
    search.tried["creep", "sensor_drift"] = search.tried["creep",]
    assert {"creep", "sensor_drift", "delay"} not in map(names_of, joint_trials(search))


def test_when_an_event_came_is_asked_of_each_single_effect():
    """It is ranked by what it leaves in its own plant or in the single fit, whichever is more."""
    search = search_with((Hysteresis(),), (Creep(),))
    asked = []
    at = SensorJump(at=3.0)
    found_at_three = Lead(effect=at, share=0.9999, estimate=at, left=1e-17)
    seen = {("hysteresis",): (found_at_three,), ("creep",): ()}
    search.event_leads = lambda *several: asked.append(several) or [seen[names] for names in several]
    found = joint_trials(search)
    assert asked == [(("hysteresis",), ("creep",))]
    assert names_of(found[0]) == {"hysteresis", "sensor_jump"}  # next to nothing is left
    assert found[0].start.parameters["sensor_jump.at"].value == 3.0
    for worse in ({"left": np.inf}, {"share": 1e-3}):
        seen[("hysteresis",)] = (replace(found_at_three, **worse),)
        assert {"hysteresis", "sensor_jump"} not in map(names_of, joint_trials(search))
