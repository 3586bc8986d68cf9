"""`Plant`: immutable data that can be stored, sent and compared."""

import json
import pickle
from dataclasses import replace

import numpy as np
import pytest
from rig_files import SOUND

from deatwin.plant import (
    BlockedPlanar,
    Coupon,
    Creep,
    Diaphragm,
    Disc,
    Experiment,
    Plant,
    ReadingTime,
    Recording,
    RigError,
    Roll,
    SensorDrift,
    SimulationError,
    thesis_plant,
)
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.rigs.rigfile import RigFile

NOISE = band_limited_noise(np.random.default_rng(8), 4.0, 0.02)

pytestmark = pytest.mark.usefixtures("uncompiled")


def reading(plant, experiment):
    return plant.simulate(experiment(NOISE)).require().outputs[0]


def test_a_plant_survives_pickle(full, experiment):
    copy = pickle.loads(pickle.dumps(full))
    assert copy.effect_names == full.effect_names
    assert copy.parameters.array().tolist() == full.parameters.array().tolist()
    np.testing.assert_array_equal(reading(copy, experiment), reading(full, experiment))


def test_a_plant_survives_json(full, experiment):
    amended = full.with_values({"shear_modulus": 31e3, "creep.time": 41.0})
    copy = Plant.from_dict(json.loads(json.dumps(amended.to_dict())))
    assert copy.to_dict() == amended.to_dict()
    assert copy.rig == amended.rig
    np.testing.assert_array_equal(reading(copy, experiment), reading(amended, experiment))


def test_values_go_with_the_effects(full):
    changed = full.with_values({"shear_modulus": 31e3, "creep.time": 41.0})
    bare = changed.without_effects()
    assert bare.effect_names == ()
    assert bare.parameters["shear_modulus"].value == 31e3
    assert full.parameters["shear_modulus"].value == 25e3
    assert full.free_values.size == len(full.parameters.free)


def test_plants_that_differ_in_free_values_share_their_code(base):
    assert base.with_values({"shear_modulus": 31e3}).simulator is base.simulator


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"effects": ["crep"]}, 'did you mean "creep"'),
        ({"rig": {"kind": "diafragm"}}, 'did you mean "diaphragm"'),
        ({"rig": {}}, r"malformed Plant: the key 'kind' is missing; give data as Plant\.to_dict"),
        ({"rig": {"kind": "disc"}}, r"malformed Disc: the key 'command_range' is missing; give data as Disc\.to_dict"),
        (
            {"rig": {**Diaphragm().to_dict(), "kind": "diaphragm", "radius": 1}},
            "malformed Diaphragm: the key 'radius' is unknown",
        ),
        ({"rig": {**Diaphragm().to_dict(), "kind": "diaphragm", "material": {}}}, "malformed Material: the key 'name'"),
        ({"effects": [{"name": "delay", "law": "spectrum"}]}, "delay is not known with a spectrum"),
        ({"effects": None}, "malformed Plant: 'NoneType' object is not iterable"),
        ({"parameters": {"shear_modulus": {}}}, "malformed parameters"),
        ({"parameters": {"shear_modulos": {"value": 2e4}}}, 'did you mean "shear_modulus"'),
        ({"parameters": {"shear_modulus": {"value": -1.0}}}, "out of range"),
    ],
)
def test_a_description_that_is_wrong_is_refused(base, change, text):
    with pytest.raises(RigError, match=text):
        Plant.from_dict({**base.to_dict(), **change})


def of_file(**film):
    return Diaphragm.from_rig_file(RigFile.from_dict({**SOUND, "film": {**SOUND["film"], **film}}))


def test_a_rig_file_is_a_plant():
    assert of_file() == Diaphragm(contact_radius=3e-3)


START, END = ReadingTime.START_OF_HOLD, ReadingTime.END_OF_HOLD


@pytest.mark.parametrize(
    ("rig", "rivals"),
    [
        (of_file(), [(START, "sliding", 3.5), (END, "bonded", 3.5)]),
        (of_file(ball="sliding"), [(START, "sliding", 3.5)]),
        (Diaphragm(), [(START, "sliding", 3.5), (END, "bonded", 3.5)]),
        *(  # the farther one of the thesis
            (
                Diaphragm(prestretch=given, prestretch_is_known=False, ball_is_known=True),
                [(START, "sliding", given), (END, "sliding", other)],
            )
            for given, other in ((3.5, 4.5), (4.5, 3.5), (3.7, 4.5), (5.0, 3.5))
        ),
        (
            Diaphragm(prestretch_is_known=False),
            [(START, "sliding", 3.5), (END, "bonded", 3.5), (END, "sliding", 4.5)],
        ),
    ],
)
def test_all_that_is_left_open_has_a_rival_of_its_own(rig, rivals):
    expected = [replace(rig, reading=reading, ball=ball, prestretch=by) for reading, ball, by in rivals]
    assert list(rig.rivals()) == expected


@pytest.mark.parametrize("rig", [Coupon(), Disc(), Roll(reading=ReadingTime.START_OF_HOLD)])
def test_every_rig_may_be_read_at_the_other_end_of_the_hold(rig):
    (rival,) = rig.rivals()
    assert rival == replace(rig, reading=rival.reading) and type(rival) is type(rig)
    assert {rig.reading, rival.reading} == {ReadingTime.START_OF_HOLD, ReadingTime.END_OF_HOLD}


def test_whether_the_prestretch_is_known_changes_no_equations():
    assert Plant(rig=Diaphragm(prestretch_is_known=False)).equations is Plant(rig=Diaphragm()).equations


def test_a_resolution_adds_the_noise_of_rounding():
    coarse = {**SOUND, "sensor": {**SOUND["sensor"], "noise_um": 0.0, "resolution_um": 1.2}}
    rig = Diaphragm.from_rig_file(RigFile.from_dict(coarse))
    assert rig.noise == pytest.approx(1.2e-6 / np.sqrt(12))


def test_the_thesis_plant_has_its_physics_and_its_stroke(experiment):
    plant = thesis_plant()
    assert plant.effect_names == ("hysteresis", "permittivity_drift")
    stroke = plant.simulate(experiment(np.full(250, 3.75))).require().outputs[0][0, -1]
    assert 0.5e-3 < stroke < 1.5e-3  # "about 1 mm"


def test_recordings_are_the_simulation_with_the_sensors_noise(base, experiment):
    made = base.record(experiment(NOISE), np.random.default_rng(0)).recordings[0]
    assert (made.output_names, made.output_units) == (("displacement",), ("m",))
    error = made.outputs - reading(base, experiment)
    assert error.std() == pytest.approx(2e-6, rel=0.2)  # 200 samples: three sigma of the deviation is 15 %
    again = base.record(experiment(NOISE), np.random.default_rng(0)).recordings[0]
    np.testing.assert_array_equal(made.outputs, again.outputs)


def test_a_plant_that_pulls_in_records_nothing(experiment):
    with pytest.raises(SimulationError, match="pull-in"):
        Plant(rig=Diaphragm(), values={"shear_modulus": 8e3, "stretch_limit": 1e4}).record(
            experiment(np.full(100, 3.75)), np.random.default_rng(0)
        )


def test_the_film_remembers_through_a_gap_between_records(base):
    plant = base.with_effects(Creep())
    whole = Recording.from_arrays(np.r_[NOISE, np.full(100, NOISE[-1]), NOISE], np.zeros(500), 0.02)
    parts = Experiment(recordings=(whole.section(0, 200), whole.section(300, 500)))
    together = plant.simulate(Experiment(recordings=(whole,))).outputs[0][0]
    apart = plant.simulate(parts).outputs
    np.testing.assert_allclose(apart[0][0], together[:200], atol=1e-12)
    np.testing.assert_allclose(apart[1][0], together[300:], atol=1e-12)


def test_a_range_of_the_diaphragm_is_told_to_whoever_has_another_rig():
    with pytest.raises(RigError, match=r"sensor_drift: .* m, as on a diaphragm; take rig\.scaled\(SensorDrift\(\)\)"):
        Plant(rig=BlockedPlanar(), effects=(SensorDrift(change=0.1),))
    scaled = replace(BlockedPlanar().scaled(SensorDrift()), change=0.1)
    assert Plant(rig=BlockedPlanar(), effects=(scaled,)).parameters["sensor_drift.change"].unit == "N"
    with pytest.raises(RigError, match=r"^parameter change = 0\.1 m is out of range: allowed is -0\.002 to 0\.002 m$"):
        Plant(rig=Diaphragm(), effects=(SensorDrift(change=0.1),))


@pytest.mark.parametrize("count", [0, -1, 2.5, True, "2", None])
@pytest.mark.parametrize("name", ["stages", "steps"])
def test_stages_and_steps_are_whole_numbers(name, count):
    with pytest.raises(RigError, match=rf"{name} is {count!r}: it must be a whole number, at least 1"):
        Plant(rig=Diaphragm(), **{name: count})
    assert getattr(Plant(rig=Diaphragm(), **{name: np.int64(2)}), name) == 2
