"""The sentences of a diagnosis: licensed by the verdict, and every number in them a field of the file."""

import json
import re
from dataclasses import replace
from importlib.resources import files
from types import SimpleNamespace

import jsonschema
import numpy as np
import pytest
from needs import COMPILED
from strips import pulled, strip

from deatwin.ident.mismatch import (
    AdviceSummary,
    Cause,
    DetectionSummary,
    Diagnosis,
    Explanation,
    FitSummary,
    FittedParameter,
    FreeFormSummary,
    Interval,
    LocationSummary,
    Readings,
    Verdict,
    VerificationSummary,
    diagnose,
    how_sure,
    next_step,
)
from deatwin.ident.mismatch.located import Band, PlaceSummary, Region, Unexplained, Window
from deatwin.ident.mismatch.result import Errors, Fault, OriginSummary, Output, Statistic, UnseenErrors
from deatwin.ident.mismatch.say import MOST_NAMED, notes_of, number, risk, say, title_of
from deatwin.ident.mismatch.verdict import Shown
from deatwin.plant import (
    CalibratedPlant,
    Coupon,
    Creep,
    Diaphragm,
    Effect,
    Experiment,
    Planar,
    Plant,
    Recording,
    SensorDrift,
)
from deatwin.plant.effects.catalogue import catalogue
from deatwin.plant.records import plain

SCHEMA = json.loads((files("deatwin.ident") / "schemas" / "diagnosis.schema.json").read_text(encoding="utf-8"))
LEVEL = "(95 % interval: "
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?")


def numbers_of(value) -> list[float]:
    """All numbers of a document; texts hold none."""
    if isinstance(value, dict):
        return [x for v in value.values() for x in numbers_of(v)]
    if isinstance(value, list):
        return [x for v in value for x in numbers_of(v)]
    return [float(value)] if isinstance(value, int | float) and not isinstance(value, bool) else []


def shows(text: str, unit: str, field: float) -> bool:
    """Whether a text is a field, or a hundred times it, rounded to the digits that the text has, two at least."""
    decimals = len(text.partition(".")[2])
    digits = range(2, max(2, len(text.lstrip("-0.").replace(".", ""))) + 1)
    rounded = {float(f"{x:.{n - 1}e}") for x in (field, 100 * field) for n in digits}
    if unit == "%":
        rounded.add(round(100 * field))
    elif decimals == 2:  # clock times
        rounded.add(round(field, 2))
    return float(text) in rounded


def said_by(data: dict) -> str:
    """The sentence without names of files, which may hold digits."""
    said = data["sentence"].replace(LEVEL, "(", 1)
    for fault in data.get("faults") or ():
        said = said.replace(fault["file"], "the file")
    return said


def foreign_numbers(data: dict) -> list[str]:
    """Numbers of the sentence that are no field of the file, nor the bound of a risk that is one."""
    known = numbers_of({key: value for key, value in data.items() if key != "sentence"})
    changed = numbers_of([[one["value"], one["nominal"]] for one in data["parameters"].values()])
    known += [value / 1000.0**power for value in changed for power in (-2, -1, 1, 2)]  # with a prefix on the unit
    said = said_by(data)
    found = [(place.group(), said[place.end() + 1 :][:1], said[: place.start()]) for place in NUMBER.finditer(said)]
    advised = data["next_experiment"] or {}
    more = len({tuple(rival) for rival in data["rivals"]}) + 1 - MOST_NAMED
    bounded = any(risk is not None and risk < 1e-3 for name, risk in advised.items() if name.startswith("confusion"))
    return [
        text
        for text, unit, before in found
        if not any(shows(text, unit, x) for x in known)
        and not (bounded and text == "0.1" and unit == "%" and before.endswith(" below "))
        and not (text == f"{more}" and before.endswith(", or one of "))
        and not (text == "95" and before.endswith("because the "))
    ]


def cause(effect, rng: np.random.Generator, share: float) -> Cause:
    """A catalogue effect with values from all over its ranges."""
    parameters = {}
    for p in effect.describe():
        low, value, high = np.sort(p.value * rng.uniform(0.3, 2.5, 3))
        parameters[p.name] = Interval(value=float(value), low=float(low), high=float(high), unit=p.unit)
    return Cause(
        effect=effect.name, family=effect.family.value, probability=0.9, share_explained=share, parameters=parameters
    )


def made_up(verdict: Verdict, *causes: Cause, unit: str = "um", size: float = 1.0, **fields) -> Diagnosis:
    """A diagnosis of this verdict, with its sentence; amplitudes are `size` times those of a film in µm."""
    after, gain_low = 2.0961 * size, fields.pop("gain_low", 7.4) * size
    rivals = ("delay",) if verdict is Verdict.AMBIGUOUS else ()
    named = (tuple(c.effect for c in causes), *((name,) for name in rivals))
    diagnosis = Diagnosis(
        output=Output(name="displacement", unit=unit),
        verdict=verdict,
        noise=2.0 * size,
        model_error=1.1873 * size,
        detection=fields.pop(
            "detection",
            DetectionSummary(
                p_value=1e-9, excess=4.1 * size, smallest_detectable={"creep": 0.4 * size, "leakage": None}
            ),
        ),
        location=fields.pop(
            "location",
            LocationSummary(time=(Window(from_s=118.0, to_s=240.0, score=0.9),), frequency=(), region=(), place=()),
        ),
        sentence="",
        causes=causes,
        names=(*(c.effect for c in causes), *rivals),
        rivals=tuple((name,) for name in rivals),
        explanations=()
        if verdict is Verdict.PARTLY or not causes
        else tuple(Explanation(effects=effects, probability=0.9 / len(named)) for effects in named),
        fit=FitSummary(
            fitted=Errors(before=9.8123 * size, after=after if causes else None),
            unseen=UnseenErrors(
                before=10.2419 * size, after=after if causes else None, gain_low=gain_low if causes else None
            ),
        ),
        parameters={"shear_modulus": FittedParameter(value=26e3, low=25e3, high=27e3, unit="Pa", nominal=3e4)},
        **fields,
    )
    return replace(diagnosis, sentence=say(diagnosis))


CREEP = Cause(
    effect="creep",
    family="film",
    probability=0.98,
    share_explained=0.967,
    parameters={
        "time": Interval(value=54.12, low=50.2, high=59.3, unit="s"),
        "modulus": Interval(value=25.1e3, low=24e3, high=26e3, unit="Pa"),
    },
)
JUMP = Cause(
    effect="sensor_jump",
    family="sensor",
    probability=0.6,
    share_explained=0.214,
    parameters={
        "at": Interval(value=151.43, low=151.39, high=151.47, unit="s"),
        "change": Interval(value=-1.234e-5, low=-1.3e-5, high=-1.1e-5, unit="m"),
    },
)
RC = Cause(
    effect="electrode_rc",
    family="electrical",
    probability=0.6,
    share_explained=0.0312,
    parameters={
        "time": Interval(value=0.0381, low=0.0302, high=0.0477, unit="s"),
        "film_share": Interval(value=0.5, low=0.0, high=1.0, unit="1"),
    },
)
FAULTS = tuple(
    Fault(
        experiment=e,
        recording=r,
        file=f"run_{r}_2026-11.csv",
        fault="the reading is stuck",
        samples=317,
        from_s=1203.48,
        to_s=1209.8,
    )
    for e, r in ((1, 1), (1, 2), (2, 1), (2, 2))
)
ADVICE = AdviceSummary(file="next_input.csv", seconds=120.0, confusion_before=0.3014, confusion_after=0.0193)
NO_INPUT = AdviceSummary(file=None, seconds=None, confusion_before=0.3, measure="the current")
ORIGIN = OriginSummary(by="repeats", share=0.0412, low=0.0, high=0.1, left=4.0, conclusion="disturbance")
DETECTED = DetectionSummary(
    p_value=0.0025,
    excess=4.1,
    smallest_detectable={},
    practical=0.52,
    moved=141.0,
    noise_source="sheet",
    statistics=(Statistic(name="variance", value=4.2, where="", score=9.0, p_value=0.0025),),
    origin=ORIGIN,
)
REFUTED = VerificationSummary(
    holds=False, failures=("creep backwards in time does as well",), gain_low=-0.2, ablation=(), shams=(), transfer=()
)
LEFT = Unexplained(
    rms=1.2345,
    mismatch=9.6063,
    share=0.016515,
    fitted=1.0871,
    unseen=1.4412,
    time=Window(from_s=118.04, to_s=131.26, score=0.62),
    frequency=Band(from_Hz=0.025, to_Hz=0.4762, excess_dB=6.1),
    region=Region(signal="displacement_rate", low=-12.3, high=-3.21, mean_residual=1.7),
    place="ball",
)
LOCATED = LocationSummary(
    time=(Window(from_s=0.0, to_s=24.0, score=0.35), Window(from_s=24.0, to_s=118.04, score=0.3)),
    frequency=(Band(from_Hz=0.0, to_Hz=1.375, excess_dB=24.1), Band(from_Hz=5.2, to_Hz=9.7, excess_dB=3.1)),
    region=(
        Region(signal="command", low=2.2931, high=2.4027, mean_residual=3.19),
        Region(signal="time_since_rest", low=0.52, high=58.32, mean_residual=-6.714),
    ),
    place=(
        PlaceSummary(place="ball", score=0.989, explained=0.98, among_best=False),
        PlaceSummary(place="film", score=0.97, explained=0.985, among_best=True),
        PlaceSummary(place="sensor", score=0.3, explained=0.31, among_best=True),
    ),
)
DIAGNOSES = {
    "none": made_up(Verdict.NONE),
    "parameters": made_up(Verdict.PARAMETERS),
    "parameters, once all is fitted": made_up(Verdict.PARAMETERS, detection=replace(DETECTED, taken_up=True)),
    "named": made_up(Verdict.NAMED, CREEP),
    "named, weakly": made_up(Verdict.NAMED, RC),
    "named, by too few": made_up(Verdict.NAMED, CREEP, gain_low=-0.31),
    "two causes": made_up(Verdict.NAMED, CREEP, JUMP),
    "three causes": made_up(Verdict.NAMED, CREEP, JUMP, RC),
    "ambiguous": made_up(Verdict.AMBIGUOUS, CREEP),
    "ambiguous, two and advice": made_up(Verdict.AMBIGUOUS, CREEP, RC, advice=ADVICE),
    "ambiguous, heavier": made_up(Verdict.AMBIGUOUS, JUMP, advice=replace(ADVICE, added_mass_g=4.5)),
    "ambiguous, surely": made_up(Verdict.AMBIGUOUS, CREEP, advice=replace(ADVICE, confusion_after=1e-269)),
    "ambiguous, in part": made_up(
        Verdict.AMBIGUOUS, CREEP, advice=replace(ADVICE, undecided=("creep", "leakage"), measure="the current")
    ),
    "ambiguous for good": made_up(Verdict.AMBIGUOUS, CREEP, advice=NO_INPUT),
    "partly, when": made_up(Verdict.PARTLY, CREEP, unexplained=LEFT),
    "partly, at which frequencies": made_up(
        Verdict.PARTLY, RC, unexplained=replace(LEFT, time=Window(from_s=1.5, to_s=3.5, score=0.31))
    ),
    "partly, in which region": made_up(
        Verdict.PARTLY, CREEP, JUMP, unexplained=replace(LEFT, time=None, frequency=None)
    ),
    "partly, nowhere": made_up(
        Verdict.PARTLY, JUMP, unexplained=replace(LEFT, time=None, frequency=None, region=None, place=None)
    ),
    "unknown": made_up(Verdict.UNKNOWN),
    "unknown, refuted": made_up(Verdict.UNKNOWN, verification=REFUTED),
    "unknown, free form": made_up(
        Verdict.UNKNOWN, free_form=FreeFormSummary(place="ball", terms=(), before=10.2419, after=4.4123, gain_low=5.1)
    ),
    "unknown, located": made_up(Verdict.UNKNOWN, location=LOCATED),
    "disturbance": made_up(Verdict.DISTURBANCE),
    "disturbance, known": made_up(Verdict.DISTURBANCE, detection=DETECTED),
    "disturbance, all of it": made_up(
        Verdict.DISTURBANCE, detection=replace(DETECTED, origin=replace(ORIGIN, share=-0.031))
    ),
    "data_fault": made_up(Verdict.DATA_FAULT, faults=FAULTS),
    "data_fault, one experiment": made_up(Verdict.DATA_FAULT, faults=FAULTS[:2]),
    "not_testable": made_up(Verdict.NOT_TESTABLE),
    "newtons": made_up(Verdict.NAMED, CREEP, unit="N", size=1.37e-3),
    "volts": made_up(Verdict.UNKNOWN, unit="V", size=4.4e-6),
    "no unit": made_up(Verdict.PARAMETERS, unit="", size=1234.5),
}


def test_every_verdict_is_there():
    assert {diagnosis.verdict for diagnosis in DIAGNOSES.values()} == set(Verdict)


@pytest.mark.parametrize("name", DIAGNOSES)
def test_every_number_is_a_field_and_every_other_number_is_noticed(name):
    data = DIAGNOSES[name].to_dict()
    said = said_by(data)
    found = NUMBER.findall(said)
    assert found
    assert foreign_numbers(data) == []
    for place in NUMBER.finditer(said):
        wrong = f"{1.07 * float(place.group()) or 0.0123457:.7f}"  # 7 % off
        spoilt = said[: place.start()] + wrong + said[place.end() :]
        assert foreign_numbers({**data, "sentence": spoilt}) == [wrong]


@pytest.mark.parametrize("name", DIAGNOSES)
def test_the_file_keeps_its_schema_and_comes_back_as_sure_as_it_was(name, tmp_path):
    diagnosis, path = DIAGNOSES[name], tmp_path / "diagnosis.json"
    diagnosis.save(path)
    data, said = json.loads(path.read_text(encoding="utf-8")), how_sure(diagnosis)
    jsonschema.validate(data, SCHEMA)
    assert Diagnosis.load(path).to_dict() == data and how_sure(Diagnosis.load(path)) == said
    assert said and not re.search(r"\de[-+]?\d|  |\.$", said)
    held = data["explanations"]
    assert [one["effects"] for one in held[1:]] == ([["delay"]] if diagnosis.verdict is Verdict.AMBIGUOUS else [])
    for one in held:
        assert f"{100 * one['probability']:.0f} %" in said


def test_after_the_answer_the_likeliest_alternative_is_stated_first():
    weighed = (("creep", 0.3), ("delay", 0.02), ("sensor_drift", 0.4), ("electrode_loss", 0.1))
    made = tuple(Explanation(effects=(name,), probability=share) for name, share in weighed)
    said = how_sure(replace(DIAGNOSES["ambiguous"], explanations=made))
    assert said == "creep is 30 % likely, sensor drift 40 %, electrode loss 10 %, delay 2 %, and any other cause 18 %"
    fifth = Explanation(effects=("leakage",), probability=0.02)
    said = how_sure(replace(DIAGNOSES["ambiguous"], explanations=(*made, fifth)))
    assert said == "creep is 30 % likely, sensor drift 40 %, electrode loss 10 %, and any other cause 20 %"


def test_probabilities_as_shown_add_up_to_one():
    weighed = ("creep", 0.386), ("sensor_drift", 0.318), ("delay", 0.166)  # the rest, 13.0 %, would make it 101 %
    made = tuple(Explanation(effects=(name,), probability=share) for name, share in weighed)
    said = how_sure(replace(DIAGNOSES["ambiguous"], explanations=made))
    assert said == "creep is 39 % likely, sensor drift 32 %, delay 17 %, and any other cause 12 %"
    named = replace(DIAGNOSES["named"], explanations=(Explanation(effects=("creep",), probability=0.925),))
    assert [int(share) for share in re.findall(r"(\d+) %", how_sure(named))] == [92, 3, 5]


def test_the_place_to_suspect_and_the_share_of_the_best_effect_or_signal_agree():
    """An effect at the ball explains more than one at the drive, but the signals at the drive predict most."""
    places = (
        PlaceSummary(place="ball", score=0.51, explained=0.44, among_best=False),
        PlaceSummary(place="drive", score=0.0, explained=0.662, among_best=True),
    )
    detected = replace(DETECTED, p_value=None)
    found = replace(DIAGNOSES["unknown"], detection=detected, location=replace(LOCATED, place=places))
    assert "first look for the cause at the drive, because" in say(found)
    assert (
        how_sure(found)
        == "of all effects and signals, each taken alone, one at the drive accounts for the largest share of the mismatch, 66 %"
    )


def test_no_exponent_and_one_fact_in_each_sentence():
    for diagnosis in DIAGNOSES.values():
        assert not re.search(r"\de[-+]?\d", diagnosis.sentence)
        assert diagnosis.sentence.endswith(".")
        assert "  " not in diagnosis.sentence and ";" not in diagnosis.sentence
        for one in diagnosis.sentence.removesuffix(".").split(". "):
            assert one[0].isupper() or one[0].isdigit(), one


def test_a_headline_names_three_explanations_and_counts_the_others_unless_there_is_one():
    weighed = (("creep",), 0.3), (("delay",), 0.02), (("sensor_drift",), 0.4), (("electrode_loss",), 0.1), ((), 0.01)
    made = tuple(Explanation(effects=effects, probability=share) for effects, share in weighed)
    found = replace(DIAGNOSES["ambiguous"], explanations=made, rivals=tuple(effects for effects, _ in weighed[1:]))
    headline = "from the model: perhaps creep, sensor drift, electrode loss, or one of 2 others. "
    assert headline in say(found)
    assert foreign_numbers(replace(found, sentence=say(found)).to_dict()) == []
    assert "what: perhaps creep, sensor drift, or delay. " in say(replace(found, explanations=made[:3]))
    four = replace(found, explanations=made[:4])
    assert "what: perhaps creep, sensor drift, electrode loss, or delay. " in say(four)


def test_what_an_input_leaves_open_is_said_with_what_to_measure():
    assert (
        " Also measure the current, because the input in next_input.csv cannot distinguish all explanations."
        in DIAGNOSES["ambiguous, in part"].sentence
    )
    assert "measure" not in DIAGNOSES["ambiguous, two and advice"].sentence


def test_each_verdict_says_only_what_it_may():
    for diagnosis in DIAGNOSES.values():
        said = diagnosis.sentence
        assert ("to the model lowers the error on held-out data from " in said) is bool(diagnosis.causes)
        low = diagnosis.fit.unseen.gain_low
        assert ("but this reduction could be due to chance" in said) is (low is not None and low <= 0.0)
        assert said.startswith("The model lacks ") is (diagnosis.verdict in (Verdict.NAMED, Verdict.PARTLY))
        assert ("perhaps" in said) is (diagnosis.verdict is Verdict.AMBIGUOUS)
        assert ("After a fit to all recordings" in said) is bool(diagnosis.detection.taken_up)


@pytest.mark.parametrize(
    ("causes", "rivals", "said"),
    [
        ((CREEP, JUMP), (("sensor_jump",),), "creep and sensor jump, or sensor jump alone. "),
        ((CREEP, JUMP), (("sensor_jump",), ("creep",)), "creep and sensor jump, sensor jump alone, or creep alone. "),
        (
            (CREEP, JUMP),
            (("sensor_jump", "delay"), ("delay",)),
            "creep and sensor jump, sensor jump and delay, or delay alone. ",
        ),
        ((CREEP, JUMP, RC), (("creep",),), "creep, sensor jump and electrode RC, or creep alone. "),
        ((CREEP,), (("creep", "delay"),), "creep alone, or creep and delay. "),
        ((CREEP,), ((), ("delay",)), "creep, no effect at all, or delay. "),
    ],
)
def test_an_explanation_is_named_with_all_its_effects(causes, rivals, said):
    sets = (tuple(c.effect for c in causes), *rivals)
    made = tuple(Explanation(effects=effects, probability=0.9 / len(sets)) for effects in sets)
    found = replace(made_up(Verdict.AMBIGUOUS, *causes), explanations=made)
    assert f"perhaps {said}" in say(found)
    turned = replace(made[0], effects=made[0].effects[::-1])  # the order of the causes counts
    assert f"perhaps {said}" in say(replace(found, explanations=(turned, *made[1:])))


def test_the_sentences_of_one_cause():
    assert DIAGNOSES["named"].sentence == (
        "The model lacks an effect: the film keeps creeping with a relaxation time of 54.1 s (95 % interval: 50.2 to 59.3). "
        "Creep explains 97 % of the mismatch between model and recordings. Adding creep to the model lowers the error on "
        "held-out data from 10.2 to 2.1 µm rms (sensor noise: 2.0 µm rms)."
    )


def test_the_sentences_of_a_part():
    assert DIAGNOSES["partly, when"].sentence == (
        "The model lacks creep, and something else that could not be identified. The film keeps creeping with a relaxation time "
        "of 54.1 s (95 % interval: 50.2 to 59.3). Creep explains 97 % of the mismatch between model and recordings. Of the "
        "9.6 µm rms mismatch, 1.2 µm rms remain unexplained, mostly between 118 and 131 s. Adding creep to the model lowers the "
        "error on held-out data from 10.2 to 2.1 µm rms (sensor noise: 2.0 µm rms)."
    )
    assert "unexplained, mostly from 0.025 to 0.48 Hz. " in DIAGNOSES["partly, at which frequencies"].sentence
    said = DIAGNOSES["partly, in which region"].sentence
    assert "unexplained, mostly at a displacement rate from -12.3 to -3.21 µm/s. " in said
    assert "remain unexplained. " in DIAGNOSES["partly, nowhere"].sentence


def test_an_experiment_that_lowers_no_risk_is_not_offered():
    idle = replace(ADVICE, confusion_before=1e-9, confusion_after=1e-12)
    assert "next_input.csv" not in made_up(Verdict.AMBIGUOUS, CREEP, RC, advice=idle).sentence
    partial = replace(idle, undecided=("creep", "leakage"), measure="the current")
    assert "measure the current" in made_up(Verdict.AMBIGUOUS, CREEP, RC, advice=partial).sentence


def test_a_risk_below_a_thousandth_is_said_as_a_bound():
    assert "from 30 to below 0.1 %." in DIAGNOSES["ambiguous, surely"].sentence
    data = DIAGNOSES["ambiguous, surely"].to_dict()
    assert foreign_numbers({**data, "next_experiment": plain(ADVICE)}) == ["0.1"]  # a bound of nothing is no field
    assert [risk(share) for share in (0.3014, 0.0193, 0.00123, 0.001, 0.000999, 0.0)] == [
        "30",
        "1.9",
        "0.12",
        "0.10",
        "below 0.1",
        "below 0.1",
    ]


def test_a_narrow_interval_has_the_digits_that_tell_its_ends_apart():
    rng = np.random.default_rng(3)
    for _ in range(300):
        low = float(10 ** rng.uniform(-6, 6) * rng.choice([-1, 1]))
        width = float(abs(low) * 10 ** rng.uniform(-7.5, 1))
        at = Interval(value=low + 0.4 * width, low=low, high=low + width, unit="s")
        told = made_up(Verdict.NAMED, replace(CREEP, parameters={**CREEP.parameters, "time": at})).to_dict()
        shown = re.search(r"relaxation time of \S+ \S+ \(95 % interval: (\S+) to (\S+)\)", told["sentence"])
        assert shown is not None and shown[1] != shown[2]
        assert foreign_numbers(told) == []
    assert (
        "54.13 s (95 % interval: 54.12 to 54.15)"
        in made_up(
            Verdict.NAMED,
            replace(
                CREEP, parameters={**CREEP.parameters, "time": Interval(value=54.13, low=54.12, high=54.15, unit="s")}
            ),
        ).sentence
    )


def test_a_small_share_is_said_to_be_small():
    assert "only 3 % of the mismatch" in DIAGNOSES["named, weakly"].sentence
    said = (
        "Without creep, 97 % of the mismatch between model and recordings would return, and without sensor jump, 21 %."
    )
    assert said in DIAGNOSES["two causes"].sentence


def test_a_refuted_explanation_and_a_free_form_are_no_causes():
    assert "failed its tests on held-out data" in DIAGNOSES["unknown, refuted"].sentence
    assert "without physical meaning" in DIAGNOSES["unknown, free form"].sentence


def test_an_unknown_mismatch_is_said_to_lie_where_and_what_to_suspect():
    assert (
        "(sensor noise: 2.0 µm rms). The mismatch is spread over the recordings. Most of the power of the mismatch lies at frequencies below "
        "1.4 Hz. The mean residual is largest in magnitude, -6.7 µm, 0.520 to 58.3 s after the last "
        "rest of the command, or after the start of the recording if there was none. If the readings are sound, first look for the cause at the film, because the signals there predict the mismatch best."
    ) in DIAGNOSES["unknown, located"].sentence
    assert (
        " Of the mismatch between model and recordings, 90 % lies between 118 and 240 s."
        in DIAGNOSES["unknown"].sentence
    )
    falling = Region(signal="branch", low=-1.0, high=0.0, mean_residual=9.1)
    other = replace(LOCATED, time=(), frequency=LOCATED.frequency[1:], region=(falling,), place=LOCATED.place[2:])
    said = made_up(Verdict.UNKNOWN, location=other).sentence
    assert said.endswith(
        " Most of the power of the mismatch lies at frequencies from 5.2 to 9.7 Hz. The mean residual is largest in magnitude, 9.1 µm, "
        "while the reading falls."
    )


@pytest.mark.parametrize(("starts", "said"), [((0.0, 120.0), " of run_1.csv"), ((0.0, 0.0), ""), ((0.0,), "")])
def test_the_recording_of_a_mismatch_is_named_if_there_are_several_and_its_clock_tells_it(starts, said):
    records = tuple(
        replace(
            Recording.from_arrays(np.zeros(121), np.zeros(121), 1.0, start=start), provenance={"file": f"run_{k}.csv"}
        )
        for k, start in enumerate(starts)
    )
    experiments = tuple(Experiment(recordings=(record,)) for record in records)
    window = (
        Window(from_s=121.5, to_s=180.0, score=0.9) if len(set(starts)) > 1 else Window(from_s=5.0, to_s=9.0, score=0.9)
    )
    diagnosis = made_up(Verdict.UNKNOWN, location=replace(LOCATED, time=(window,)))
    known = replace(diagnosis, readings=Readings(experiments=experiments, base=(), amended=None, unseen=()))
    between = "between 122 and 180 s" if len(set(starts)) > 1 else "between 5.0 and 9.0 s"
    assert f" Of the mismatch between model and recordings, 90 % lies {between}{said}. Most" in say(known)


def test_a_late_answer_within_the_timing_of_readings_is_said_with_its_time():
    late = FittedParameter(value=3.7e-3, low=3.5e-3, high=3.9e-3, unit="s")
    diagnosis = replace(DIAGNOSES["parameters, once all is fitted"], parameters={"delay.time": late})
    dead_time = "The fit to all recordings includes a dead time of 3.70 ms (95 % interval: 3.50 to 3.90)."
    assert say(diagnosis).endswith(dead_time)


def test_an_estimate_below_nothing_is_said_as_nothing():
    assert " 4 % of the mismatch repeats with the command." in DIAGNOSES["disturbance, known"].sentence
    assert " None of the mismatch repeats with the command." in DIAGNOSES["disturbance, all of it"].sentence


def test_without_repeats_a_share_is_said_to_be_that_of_a_regression_on_other_data():
    """A correlation within the fitted data may be larger than what a regression predicts elsewhere."""
    origin = replace(ORIGIN, by="prediction", share=0.001, high=0.004)
    found = replace(DIAGNOSES["disturbance"], detection=replace(DETECTED, origin=origin))
    unseen = "in data to which it was not fitted"
    assert say(found).endswith(f" A regression on command and motion predicts none of the mismatch {unseen}.")
    assert how_sure(found) == (
        f"a regression on command and motion predicts 0.1 % of the power of the mismatch {unseen} (upper limit: 0.4 %), and a "
        "mismatch counts as a disturbance only if this limit is below 10 %"
    )
    white = replace(found, detection=replace(DETECTED, origin=replace(origin, high=0.15)))
    assert "(upper limit: 15 %), and a mismatch counts as a disturbance only if this share is below" in how_sure(white)


def test_every_effect_of_the_catalogue_can_be_said():
    rng = np.random.default_rng(1)
    for effect in catalogue():
        data = made_up(Verdict.NAMED, cause(effect, rng, 0.8)).to_dict()
        assert foreign_numbers(data) == [], data["sentence"]
        assert "{" not in data["sentence"]


def test_numbers_are_rounded_to_significant_digits():
    shown = [number(x) for x in (0.0029, 54.0, 1234.5, -1.2345e-5, 1e9)]
    assert shown == ["0.0029", "54.0", "1230", "-0.0000123", "1000000000"]
    assert [number(x, 2) for x in (2.0, 0.04)] == ["2.0", "0.040"]


def test_a_value_that_is_nothing_beside_its_interval_is_written_as_none():
    on_bound = Interval(value=6.58e-31, low=0.0, high=0.0093, unit="s")
    assert on_bound.shown == Shown(value=0.0, low=0.0, high=pytest.approx(9.3), unit="ms")
    below = Interval(value=-1e-9, low=-5e-6, high=0.0, unit="m")
    assert below.shown == Shown(value=0.0, low=pytest.approx(-5.0), high=0.0, unit="µm")
    wide = Interval(value=1.0, low=1e-4, high=1e4, unit="s")  # of a logarithmic parameter, which is never 0
    assert wide.shown.value == 1.0
    near = Interval(value=6e-6, low=0.0, high=0.005, unit="1")  # a thousandth of the interval and more is a value
    assert near.shown.value == 6e-6


@COMPILED
def test_every_number_of_a_real_diagnosis_is_a_field():
    data = diagnose(
        strip(), pulled(strip().with_effects(Creep(modulus=60e3, time=25.0)), 1, 10), effects=[Creep()]
    ).to_dict()
    assert data["verdict"] == "named"
    assert len(NUMBER.findall(data["sentence"])) >= 6
    assert foreign_numbers(data) == []


@pytest.mark.parametrize(("low", "said"), [(-2e3, True), (24e3, False)])
def test_an_explanation_that_may_be_absent_is_said_to_be(low, said):
    weak = replace(CREEP, parameters={**CREEP.parameters, "modulus": replace(CREEP.parameters["modulus"], low=low)})
    found = made_up(Verdict.AMBIGUOUS, weak)
    absent = (
        "These recordings do not prove that creep is present, because the 95 % interval of its strength includes zero."
    )
    assert (absent in found.sentence) is said
    beside = tuple(Explanation(effects=effects, probability=0.4) for effects in (("creep",), ("creep", "delay")))
    assert absent not in say(replace(found, explanations=beside))  # every explanation has it


def titled(*rivals: Effect) -> str:
    """What an alternative with one of these effects is called."""
    plants = {str(k): SimpleNamespace(plant=Plant(rig=Diaphragm()).with_effects(e)) for k, e in enumerate(rivals)}
    return title_of(rivals[0].cause, SimpleNamespace(rival_models=plants))


def test_an_alternative_at_another_place_has_its_name_there():
    drift = SensorDrift()
    assert titled(drift.placed("command_gain")) == "drift of the amplifier's gain"
    assert titled(drift.placed("command"), drift.placed("reading_gain")) == (
        "drift of the amplifier's offset or drift of the sensor's gain"
    )
    assert titled(drift, drift.placed("command")) == "sensor drift"


def test_the_parameters_that_changed_by_the_largest_factors_are_named():
    values = {"damping": (0.96, 0.05, "N s/m"), "mass": (3.1e-3, 3e-3, "kg"), "shear_modulus": (26e3, 3e4, "Pa")}
    fitted = {
        name: FittedParameter(value=value, low=0.99 * value, high=1.01 * value, unit=unit, nominal=nominal)
        for name, (value, nominal, unit) in values.items()
    }
    same = FittedParameter(value=9.0, low=0.5, high=20.0, unit="", nominal=1.0)  # its interval holds the nominal value
    said = replace(DIAGNOSES["parameters"], parameters={**fitted, "zero": same})
    assert (
        "The largest changes are those of damping (from 50 to 960 mN s/m) and shear modulus (from 30 to 26 kPa)."
        in say(said)
    )


def test_an_experiment_with_another_load_stands_alone():
    advised = replace(DIAGNOSES["ambiguous"], advice=ADVICE)
    assert next_step(advised) == (
        "apply the input in next_input.csv, record the response, and diagnose all recordings together"
    )
    heavier = next_step(DIAGNOSES["ambiguous, heavier"])
    assert heavier.startswith(
        "add 4.50 g to the load, state the new mass in the rig file, apply the input in next_input.csv, record the response"
    )
    assert heavier.endswith(", and diagnose this recording alone")


def test_an_alternative_without_any_effect_leaves_open_whether_something_is_missing():
    answer = DIAGNOSES["ambiguous"].explanations[0]
    nothing = Explanation(effects=(), probability=0.1)
    said = say(replace(DIAGNOSES["ambiguous"], explanations=(answer, nothing)))
    assert said.startswith("These recordings cannot decide whether something is missing from the model: perhaps ")


def test_two_faults_of_one_recording_are_those_of_a_recording():
    stuck = FAULTS[0]
    said = say(
        replace(
            DIAGNOSES["none"],
            verdict=Verdict.DATA_FAULT,
            faults=(stuck, replace(stuck, fault="the reading has outliers")),
        )
    )
    assert said.startswith("The recording is faulty. In run_1_2026-11.csv, the reading is stuck in 317 samples")


def test_a_note_that_repeats_the_sentence_is_left_out():
    said = "The recording is faulty: in a.csv, the reading is stuck in 201 samples."
    warnings = ("a.csv: the reading is stuck in 201 samples", "a.csv: the reading jumps", "the reading jumps")
    found = replace(DIAGNOSES["data_fault"], sentence=said, warnings=warnings)
    assert notes_of(found) == list(warnings[1:])


@pytest.mark.parametrize(
    ("rig", "body"),
    [(Diaphragm(), "ball"), (Planar(), "moving part"), (Coupon(), "moving part")],
    ids=["ball", "bar", "strip"],
)
def test_only_a_diaphragm_has_a_ball(rig, body):
    friction = Cause(
        effect="coulomb_friction",
        family="mechanical",
        probability=0.95,
        share_explained=0.9,
        parameters={"force": Interval(value=0.012, low=0.011, high=0.013, unit="N")},
    )
    model = CalibratedPlant.nominal(Plant(rig=rig))
    named = replace(DIAGNOSES["named"], causes=(friction,), model=model)
    assert f"the {body} moves against a dry friction of 12.0 mN" in say(named)
    best = replace(LOCATED, place=(PlaceSummary(place="ball", score=0.9, explained=0.9, among_best=True),))
    located = replace(DIAGNOSES["unknown"], location=best, base_model=model)
    assert f"first look for the cause at the {body}, because" in say(located).lower() + next_step(located).lower()


def test_signals_that_predict_most_are_named_at_their_places():
    """A place with several signals is named once, and a signal that predicts less is left out."""
    places = (
        PlaceSummary(place="film", signal="permittivity", score=0.0, explained=0.7, among_best=True),
        PlaceSummary(place="film", signal="electrode_share", score=0.0, explained=0.69, among_best=True),
        PlaceSummary(place="film", signal="stiffness", score=0.0, explained=0.44, among_best=False),
        PlaceSummary(place="drive", score=0.0, explained=0.7, among_best=True),
    )
    found = replace(DIAGNOSES["unknown"], location=replace(LOCATED, place=places))
    assert "at the film (permittivity, electrode share) or the drive, because" in say(found)
