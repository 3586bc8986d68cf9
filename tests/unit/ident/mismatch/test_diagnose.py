"""The whole engine on small simulated experiments in which something is concealed, or nothing."""

import importlib
import json
from dataclasses import replace
from importlib.resources import files
from types import SimpleNamespace

import jsonschema
import numpy as np
import pytest
from needs import COMPILED
from runs import blank

from deatwin.ident.mismatch import Diagnosis, Verdict, diagnose
from deatwin.ident.mismatch.advise.distance import confusion
from deatwin.ident.mismatch.diagnose import _verdict
from deatwin.ident.mismatch.quality.quality import Soundness
from deatwin.ident.mismatch.refit.base import Base
from deatwin.ident.mismatch.verify import verify as verifying
from deatwin.ident.mismatch.verify.verify import verify
from deatwin.plant import Creep, Diaphragm, ElectrodeRC, Experiment, PermittivityDrift, Plant, Recording, SensorLag
from deatwin.plant.effects.catalogue import effect_named
from deatwin.plant.excitation import band_limited_noise, random_holds

pytestmark = COMPILED
NOMINAL = Plant(rig=Diaphragm())
WRONG_PARAMETERS = {"shear_modulus": 29e3, "stretch_limit": 140.0, "permittivity": 4.3, "damping": 0.06}
CATALOGUE = [Creep(), ElectrodeRC(), PermittivityDrift()]


def recorded(*effects, seed: int = 0, values=WRONG_PARAMETERS, share: float = 1.0) -> Experiment:
    """A minute of noise and 40 s of holds, or a share of each, by a plant with other parameters and concealed effects."""
    rng = np.random.default_rng(seed)
    noise = band_limited_noise(rng, 60.0 * share, 0.02)
    holds = random_holds(rng, 40.0 * share, 0.02, 1.2, 3.1)
    records = (*blank(noise).recordings, *blank(holds, start=60.0 * share).recordings)
    return NOMINAL.with_values(values).with_effects(*effects).record(Experiment(recordings=records), rng)


@pytest.fixture(scope="module")
def creeping():
    return diagnose(NOMINAL, recorded(Creep(modulus=50e3, time=20.0)), effects=CATALOGUE)


@pytest.fixture(scope="module")
def clean():
    return diagnose(NOMINAL, recorded(share=0.5), effects=CATALOGUE)


def test_a_concealed_effect_is_named_alone(creeping):
    assert creeping.verdict is Verdict.NAMED
    assert [cause.effect for cause in creeping.causes] == ["creep"]
    assert creeping.names == ("creep",)
    assert creeping.causes[0].family == "film"
    assert creeping.causes[0].share_explained > 0.9
    assert 0.94 < creeping.causes[0].probability <= 0.95  # no law of a catalogue is certain


def test_its_parameters_are_found(creeping):
    time = creeping.causes[0].parameters["time"]
    # data and fit share the plant here, so only noise stands between estimate and truth
    assert time.low <= 20.0 <= time.high
    assert time.value == pytest.approx(20.0, rel=0.1)
    assert time.unit == "s"


def test_the_amended_plant_is_as_good_as_the_sensor(creeping):
    unseen = creeping.fit.unseen
    assert unseen.after == pytest.approx(2.0, rel=0.05)  # the sensor alone is 2.0 µm
    assert unseen.before > 1.5 * unseen.after
    assert unseen.gain_low > 0
    assert creeping.model.plant.effect_names == ("creep",)


def test_locations_and_smallest_sizes_are_reported(creeping):
    assert creeping.location.time
    assert creeping.location.frequency[0].from_Hz < 0.1
    places = {place.place: place.score for place in creeping.location.place}
    assert places["film"] == max(places.values()) > 0.9
    assert {"film", "drive", "parameter"} <= set(places)
    assert set(creeping.detection.smallest_detectable) == {"creep", "electrode_rc", "permittivity_drift"}
    # a refit can only make an effect harder to see than the model error it must exceed
    assert all(size >= 1.0 for size in creeping.detection.smallest_detectable.values() if size is not None)


def test_clean_data_only_want_other_parameters(clean):
    assert clean.verdict is Verdict.PARAMETERS
    assert clean.causes == ()
    assert clean.names == ()
    assert clean.model.plant.effect_names == ()
    assert clean.fit.unseen.after is None


def test_clean_data_of_the_nominal_plant_lack_nothing():
    found = diagnose(NOMINAL, recorded(values={}, seed=3, share=0.35), effects=CATALOGUE)
    assert found.verdict is Verdict.NONE


def test_physics_outside_the_catalogue_is_unknown():
    experiment = recorded(Creep(modulus=50e3, time=20.0), seed=4, share=0.35)
    found = diagnose(NOMINAL, experiment, effects=[ElectrodeRC()])
    assert found.verdict is Verdict.UNKNOWN
    assert found.causes == ()
    # a free form may stand in the model, never among the causes
    assert found.model.plant.effect_names == (() if found.free_form is None else ("free_form",))
    assert found.sentence.startswith("Something is missing from the model, and no effect of the catalogue explains it")


def test_a_lag_is_named_though_readings_taken_a_sample_early_would_leave_little():
    """In that form of the rig nothing is missing for certain, so it calibrates best; but what it leaves is detected."""
    experiment = recorded(SensorLag(time=0.017, inertia=0.4), share=0.3)
    steps = {}
    diagnosis = diagnose(
        NOMINAL, experiment, effects=[SensorLag(), Creep()], through=lambda step: steps.update({step.name: step})
    )
    assert steps["base"].model.plant.rig.reading is NOMINAL.rig.reading  # as in the steps that follow
    assert (diagnosis.verdict, diagnosis.names) == (Verdict.NAMED, ("sensor_lag",))
    time = diagnosis.causes[0].parameters["time"]
    assert time.low < 0.017 < time.high


@pytest.mark.parametrize(
    ("there", "certain", "taken_up", "taken"),
    [
        (True, True, None, True),
        (False, False, None, True),
        (False, True, "the refit", True),
        (False, True, None, False),  # one test is certain that something is missing, the other is not
    ],
)
def test_the_form_of_the_rig_file_is_gone_on_with_whether_something_is_missing_there_or_not(
    monkeypatch, there, certain, taken_up, taken
):
    """Where nothing is, nothing is missing: another reading is no better for what it leaves."""
    module = importlib.import_module("deatwin.ident.mismatch.diagnose")
    filed = SimpleNamespace(chosen=SimpleNamespace(mismatch=certain))
    again = SimpleNamespace(mismatch=there, taken_up=taken_up)
    monkeypatch.setattr(module, "detect", lambda base, problem, rng: again if base is filed.chosen else None)
    problem, base = SimpleNamespace(nominal=NOMINAL), SimpleNamespace(as_filed=lambda rig: filed)
    seen = SimpleNamespace(mismatch=True)
    assert module._as_filed(problem, base, seen, None) == ((filed, again) if taken else (base, seen))


@pytest.mark.parametrize(
    ("alternatives", "taken"),
    [
        ({"bonded": (True, True), "early": (True, False)}, "early"),
        ({"bonded": (True, True), "early": (False, False)}, None),  # it leaves too much, whatever chance allows
        ({}, None),
    ],
)
def test_what_another_reading_of_the_rig_file_does_is_not_missing(monkeypatch, alternatives, taken):
    """Each form is adequate or not, and something is seen to be missing in it or not."""
    module = importlib.import_module("deatwin.ident.mismatch.diagnose")
    forms = tuple(SimpleNamespace(name=name, adequate=adequate) for name, (adequate, _) in alternatives.items())
    detections = {n: SimpleNamespace(mismatch=missing, taken_up=None) for n, (_, missing) in alternatives.items()}
    monkeypatch.setattr(module, "detect", lambda form, problem, rng: detections[form.name])
    base = SimpleNamespace(alternatives=forms, in_variant_of=lambda form: form.name)
    seen = SimpleNamespace(mismatch=True)
    found = module._in_a_variant_that_lacks_nothing(None, base, seen, None)
    assert found == ((taken, detections[taken]) if taken else (base, seen))
    nothing = SimpleNamespace(mismatch=False)
    assert module._in_a_variant_that_lacks_nothing(None, base, nothing, None) == (base, nothing)


@pytest.mark.parametrize("filed", [False, True])
def test_where_something_is_missing_a_form_that_lacks_nothing_is_gone_on_with_that_of_the_file_first(
    monkeypatch, filed
):
    """Rivals that the calibration did not ask are asked then; no form is looked into twice, nor one after that."""
    module = importlib.import_module("deatwin.ident.mismatch.diagnose")
    own, early = SimpleNamespace(mismatch=False), SimpleNamespace(adequate=True)
    right, nothing = own if filed else early, SimpleNamespace(mismatch=False, taken_up=None)
    monkeypatch.setattr(module, "detect", lambda form, problem, rng: {id(right): nothing}[id(form)])
    monkeypatch.setattr(module, "beside_alternatives", lambda problem, base: replace(base, alternatives=(early,)))
    monkeypatch.setattr(Base, "as_filed", lambda self, rig: replace(self, chosen=own) if filed else self)
    monkeypatch.setattr(Base, "in_variant_of", lambda self, form: replace(self, chosen=form, alternatives=()))
    alone = Base(chosen=SimpleNamespace(mismatch=False), alternatives=(), noise=2e-6)
    base, found = module._among_variants(SimpleNamespace(nominal=NOMINAL), alone, SimpleNamespace(mismatch=True), None)
    assert base.chosen is right and found is nothing


@pytest.fixture(scope="module")
def doubted():
    """Two effects, of which held-out data are made not to show the second for certain."""
    with pytest.MonkeyPatch.context() as patch:

        def unsure(*arguments):
            found = verify(*arguments)
            no_longer = {"creep": {"gain_low": -1e-9, "counts": False}}
            return replace(found, ablations=tuple(replace(a, **no_longer.get(a.effect, {})) for a in found.ablations))

        patch.setattr(verifying, "verify", unsure)
        module = importlib.import_module("deatwin.ident.mismatch.diagnose")
        patch.setattr(module, "advise", lambda *_, **__: None)  # which has tests of its own
        hidden = recorded(ElectrodeRC(time=0.05), Creep(modulus=20e3, time=20.0), share=0.35)
        return diagnose(NOMINAL, hidden, effects=CATALOGUE[:2])


def test_a_doubt_of_one_of_two_effects_ends_as_ambiguous(doubted):
    assert doubted.verdict is Verdict.AMBIGUOUS
    assert {cause.effect for cause in doubted.causes} == {"creep", "electrode_rc"}
    assert doubted.verification.failures == (
        "it is not certain that the error on held-out data rises if creep is removed",
    )
    assert doubted.verification.holds is False
    assert doubted.verification.failures[0] in doubted.warnings
    certain = {cause.effect: cause.probability for cause in doubted.causes}
    assert certain["electrode_rc"] == pytest.approx(0.95)  # of both explanations, a margin left for others
    assert certain["creep"] == pytest.approx(0.95 / 2)
    assert doubted.rivals == (("electrode_rc",),)
    both, alone = doubted.explanations
    assert (set(both.effects), alone.effects) == ({"creep", "electrode_rc"}, ("electrode_rc",))
    assert [both.probability, alone.probability] == pytest.approx([0.95 / 2, 0.95 / 2])
    assert "perhaps electrode RC and creep, or electrode RC alone." in doubted.sentence


def test_a_rival_on_another_form_of_the_rig_has_its_own_distance():
    """A lag of the sensor is no delay, unless readings were taken a sample later than the rig file says."""
    rng, rig = np.random.default_rng(1), Plant(rig=Diaphragm(noise=8e-6))
    noise = band_limited_noise(rng, 24.0, 0.02)
    hidden = rig.with_effects(effect_named("delay")).record(blank(noise), rng)
    found = diagnose(rig, hidden, effects=[effect_named("delay"), effect_named("sensor_lag")])
    assert found.verdict is Verdict.AMBIGUOUS
    assert found.rivals == (("sensor_lag",),)
    needed = "the alternative explanation, sensor lag, requires that the rig has reading = 'start of hold'"
    assert needed in found.warnings
    (pair,) = found.indistinguishable
    # that of the lag on the rig of the file is above 100: it was distinguished, and is no alternative
    assert pair.d2 < 16
    assert found.advice.confusion_before >= confusion(pair.d2)
    lags = [c for c in found.candidates if c.effects == ("sensor_lag",)]
    elsewhere, filed = sorted(lags, key=lambda c: c.fitted)
    assert (elsewhere.d2, filed.d2) == (pair.d2, None)


def test_the_plant_of_a_refuted_explanation_is_not_the_answer(monkeypatch):
    """Nor is its fit to all recordings, which verification had to make."""

    def refuting(base, amended, *others):
        found = verify(base, amended, *others)
        return replace(found, gain_low=-1e-9, counts=False, ablations=(), whole=amended.calibration)

    monkeypatch.setattr(verifying, "verify", refuting)
    found = diagnose(NOMINAL, recorded(Creep(modulus=50e3, time=20.0), share=0.3), effects=[Creep()])
    assert found.verdict is Verdict.UNKNOWN
    assert "it is not certain that the explanation lowers the error on held-out data" in found.warnings
    assert "creep" not in found.model.plant.effect_names


def test_a_fault_of_the_recording_is_said_before_physics():
    experiment = recorded(Creep(modulus=50e3, time=20.0), share=0.3)
    first, second = experiment.recordings
    outputs = first.outputs.copy()
    outputs[0, 500:800] = np.median(outputs)
    spoiled = Recording.from_arrays(first.inputs, outputs, 0.02)
    found = diagnose(NOMINAL, Experiment(recordings=(spoiled, second)), effects=[Creep()])
    assert found.verdict is Verdict.DATA_FAULT
    assert "stuck" in found.sentence
    assert found.causes == ()


@pytest.mark.parametrize("which", ["creeping", "clean", "doubted"])
def test_the_file_keeps_its_schema_and_comes_back(which, request, tmp_path):
    diagnosis = request.getfixturevalue(which)
    path = tmp_path / "diagnosis.json"
    diagnosis.save(path)
    data = json.loads(path.read_text(encoding="utf-8"))
    schema = json.loads((files("deatwin.ident") / "schemas" / "diagnosis.schema.json").read_text(encoding="utf-8"))
    jsonschema.validate(data, schema)
    assert Diagnosis.load(path).to_dict() == data


def test_a_dataset_holds_tables_readings_and_the_whole_file(creeping, kept):
    back = kept(creeping.to_xarray())
    assert back["cause_effect"].values.tolist() == ["creep"] and back.attrs["verdict"] == "named"
    assert back["cause_parameter_name"].values.tolist() == ["creep.modulus", "creep.time"]
    named = creeping.causes[0].parameters["time"]
    assert float(back["cause_parameter_high"][1]) == named.high and str(back["cause_parameter_unit"][1].values) == "s"
    error = back["measured"] - back["amended"]
    assert error.sizes["sample"] == 5000 and back["measured"].attrs["units"] == "um"
    after = float(np.sqrt((error**2).where(back["unseen"], drop=True).mean()))
    assert after == pytest.approx(2.0, rel=0.1)  # the sensor's noise
    assert float(np.sqrt(((back["measured"] - back["base"]) ** 2).mean())) > 1.2 * after
    assert back["record"].values.tolist() == [0] * 3000 + [1] * 2000
    assert Diagnosis.from_dict(json.loads(str(back["document"].values))).to_dict() == creeping.to_dict()


def test_each_step_has_a_dataset_of_its_own(creeping, kept):
    findings = creeping.findings
    sound = kept(findings.checked.to_xarray())
    assert bool(sound["sound"].all()) and sound.attrs["soundness"] == "SOUND"
    detected = kept(findings.detection.to_xarray())
    assert detected.attrs["p_value"] == creeping.detection.p_value
    np.testing.assert_array_equal(detected["statistic_p_value"], [s.p_value for s in findings.detection.statistics])
    density = float(detected["spectrum"].integrate("frequency"))
    assert density == pytest.approx(float(findings.detection.size**2 + findings.base.noise**2), rel=0.5)
    located = kept(findings.location.to_xarray())
    # the shares that effects explain are added to the scores of their places afterwards
    assert set(located["locate_place_place"].values) <= {entry.place for entry in creeping.location.place}
    assert located["locate_time_from_s"].attrs["units"] == "s"


@pytest.mark.parametrize(
    ("soundness", "verdict"), [(Soundness.SOUND, Verdict.PARAMETERS), (Soundness.FAULTY, Verdict.DATA_FAULT)]
)
def test_what_the_plant_takes_up_once_all_is_fitted_is_its_parameters(soundness, verdict):
    """However near the nominal plant is, its calibration was off by what counts."""
    taken = SimpleNamespace(taken_up=object(), mismatch=False, testable=False)
    checked = SimpleNamespace(soundness=soundness)
    assert _verdict(None, checked, None, taken, None, None, False, False) is verdict


@pytest.mark.parametrize(
    ("alternatives", "shown", "all_of_it", "verdict"),
    [
        ((), True, True, Verdict.NAMED),
        ((), True, False, Verdict.PARTLY),
        ((), False, True, Verdict.UNKNOWN),
        (("another",), False, False, Verdict.AMBIGUOUS),
    ],
)
def test_what_stands_alone_is_named_if_it_is_all_and_shows_its_cycles(
    monkeypatch, alternatives, shown, all_of_it, verdict
):
    module = importlib.import_module("deatwin.ident.mismatch.diagnose")
    monkeypatch.setattr(module, "shows_its_cycles", lambda best, parts: shown)
    monkeypatch.setattr(module, "explains_all", lambda best, base, whole: all_of_it)
    problem, checked = SimpleNamespace(everything=()), SimpleNamespace(soundness=Soundness.SOUND)
    missing = SimpleNamespace(taken_up=None, mismatch=True, disturbance=False)
    naming, verified = SimpleNamespace(best="one", base="none", alternatives=alternatives), SimpleNamespace(whole=None)
    assert _verdict(problem, checked, None, missing, naming, verified, True, False) is verdict


def test_what_was_taken_up_is_reported_as_it_was_fitted_to_all_recordings(monkeypatch):
    """Small motions in what is fitted, large ones in the held-out part, which shows the stretch limit of the film."""
    module = importlib.import_module("deatwin.ident.mismatch.prepare")
    monkeypatch.setattr(module, "_late_onset", lambda base, checked: None)  # else some of it is fitted at once
    rng = np.random.default_rng(0)
    small, large = band_limited_noise(rng, 42.0, 0.02), random_holds(rng, 18.0, 0.02, 1.2, 3.2, 1.0, 3.0)
    command = np.concatenate([0.84 + 0.3 * small, large])
    experiment = NOMINAL.with_values({"stretch_limit": 200.0}).record(blank(command), np.random.default_rng(1))
    found = diagnose(NOMINAL, experiment, effects=CATALOGUE[:1])
    assert (found.verdict, found.detection.taken_up) == (Verdict.PARAMETERS, True)
    fitted = found.model.plant.parameters
    assert {n: p.value for n, p in found.parameters.items()} == {n: fitted[n].value for n in found.parameters}
    assert found.parameters["stretch_limit"].low < 200.0 < found.parameters["stretch_limit"].high
    assert found.base_model.plant.free_values == pytest.approx(found.model.plant.free_values, rel=1e-12)
    # the same equations made the data: over 3000 samples the power of the noise scatters by 2.6 %
    assert found.model.model_error == found.base_model.model_error < np.sqrt(3 * 0.026) * found.model.noise
