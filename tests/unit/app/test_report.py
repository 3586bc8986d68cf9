"""The page of a diagnosis: of every verdict, without evidence, and with all steps in their order."""

import re
from dataclasses import dataclass, replace
from html import unescape
from itertools import pairwise
from math import inf
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_verification import VERIFIED
from pages import Page

from deatwin.ident.mismatch import (
    AdviceSummary,
    CandidateSummary,
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
    Unexplained,
    Verdict,
    how_sure,
    next_step,
)
from deatwin.ident.mismatch.layout import laid_out
from deatwin.ident.mismatch.located import PlaceSummary, Region, Window
from deatwin.ident.mismatch.quality.quality import check_quality
from deatwin.ident.mismatch.result import (
    Errors,
    Fault,
    FormSummary,
    IndistinguishablePair,
    OriginSummary,
    Output,
    ShapeSummary,
    Statistic,
    TermSummary,
    UnseenErrors,
)
from deatwin.plant import Diaphragm, Experiment, Plant, Recording
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.errors import ModelError
from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord
from deatwin.studies.report.figures import _faulty
from deatwin.studies.report.page import write_report
from deatwin.studies.report.quantities import in_interval, with_interval
from deatwin.studies.report.rendering import Origin
from deatwin.studies.report.story import Note, StoryPage, write_story

DIAGNOSIS = Diagnosis(
    output=Output(name="displacement", unit="um"),
    verdict=Verdict.UNKNOWN,
    noise=2.0,
    model_error=1.2,
    detection=DetectionSummary(p_value=0.0, excess=4.0, smallest_detectable={}),
    location=None,
    sentence="Something is <missing>. It moves the film.",
    fit=FitSummary(fitted=Errors(before=5.0, after=None), unseen=UnseenErrors(before=6.0, after=None, gain_low=None)),
    warnings=("the fitted stretch_limit lies at a bound of its allowed range",),
)


def page_of(diagnosis: Diagnosis, folder: Path) -> str:
    """The page of a diagnosis, with plain spaces."""
    made = ResultFolder(folder / "new")
    write_report(made, diagnosis, Origin(inputs=[], seed=3))
    return (made.path / "report.html").read_text(encoding="utf-8").replace("\xa0", " ").replace("&nbsp;", " ")


def test_numbers_have_minus_signs_and_a_command_keeps_its_characters(tmp_path):
    command = ("deatwin", "diagnose", "rig.toml", "--start", "-1", "V = 5 s")
    write_report(
        ResultFolder(tmp_path / "new"),
        replace(DIAGNOSIS, sentence="It lies at -2.5 s."),
        Origin(inputs=[], seed=3, command=command),
    )
    page = (tmp_path / "new" / "report.html").read_text(encoding="utf-8")
    assert "It lies at −2.5\xa0s." in page
    assert "deatwin diagnose rig.toml --start -1 &#39;V = 5 s&#39;" in re.sub("</?span[^>]*>", "", page)


def test_what_is_left_unexplained_is_shown_with_its_place(tmp_path):
    left = Unexplained(rms=1.23, mismatch=9.61, share=0.0164, fitted=1.1, unseen=1.4, place="ball")
    page = page_of(replace(DIAGNOSIS, verdict=Verdict.PARTLY, unexplained=left), tmp_path)
    assert "Of a mismatch of 9.61 µm rms, these effects leave 1.23 µm rms unexplained (1.6 % of its power)." in page
    assert "The signals at the ball predict the unexplained mismatch best." in page


def test_a_place_is_listed_with_what_effects_explain_there_and_what_its_signals_predict(whole):
    """Creep was tried in the film, a drift at the drive, another effect at the sensor; nothing was tried at the ball."""
    cells = [re.sub("<[^>]*>", "", cell) for cell in re.findall("<td.*?</td>", whole)]
    rows = dict(pairwise(cells))
    assert (
        rows["film: permittivity"]
        == "0 % is explained by the best effect there, 66 % can be predicted from the signals there"
    )
    assert (rows["ball"], rows["sensor"]) == (
        "50 % can be predicted from the signals there",
        "30 % is explained by an effect",
    )
    assert unescape(rows["drive"]) == "20 % is explained by drift of the amplifier's gain alone"
    assert [c for c in cells if c in ("film: permittivity", "ball", "sensor")] == [
        "film: permittivity",
        "ball",
        "sensor",
    ]


def test_a_share_that_returns_is_shown_beside_the_errors_of_all_data_that_it_is_of(whole):
    (table,) = [one for one in re.findall("<table>.*?</table>", whole, re.DOTALL) if "removed effect" in one]
    head = re.findall("<th[^>]*>(.*?)</th>", table)
    assert [one for one in head if "data" in one] == [
        "error on fitted data (µm rms)",
        "error on held-out data (µm rms)",
        "share of the mismatch that returns, over fitted and held-out data",
    ]
    (ablation,) = VERIFIED.summary.ablation
    cells = re.findall("<td[^>]*>(.*?)</td>", table)[1:]
    assert [float(one) for one in cells[:2]] == pytest.approx([ablation.fitted, ablation.unseen], rel=5e-3)
    assert "over fitted and held-out data together" in whole[: whole.index("removed effect")]


def test_the_number_of_a_tile_stands_alone_on_its_line(whole):
    """A tile of a report of 1400 px is too narrow for a number and a remark."""
    shown = dict(re.findall(r'<div class="tile"><dt>(.*?)</dt>\s*<dd>(.*?)</dd>', whole))
    assert shown["probability of creep (maximum)"] == "95 %"


def test_a_formula_is_not_said_to_show_the_place_of_the_cause(tmp_path):
    form = FreeFormSummary(place="ball", signal="force", terms=(), before=27.1, after=15.8, gain_low=9.0)
    page = page_of(replace(DIAGNOSIS, verdict=Verdict.UNKNOWN, free_form=form), tmp_path)
    assert "as an addition to the force at the ball." in page
    assert "so the place says nothing about where the cause is." in page


def test_what_an_advised_input_leaves_undecided_is_named(tmp_path):
    left = ("permittivity_drift", "sensor_drift_at_command_gain")
    advised = AdviceSummary(
        file="next_input.csv",
        seconds=300.0,
        confusion_before=0.38,
        confusion_after=0.2,
        measure="the capacitance",
        undecided=left,
    )
    page = unescape(page_of(replace(DIAGNOSIS, verdict=Verdict.AMBIGUOUS, advice=advised), tmp_path))
    assert (
        "falls from 38 to 20 %. Even with this recording, each of these explanations may be confused with another one: "
        in page
    )
    assert "permittivity drift, drift of the amplifier's gain. So also measure the capacitance." in page


def test_an_interval_has_the_prefix_of_its_value():
    assert with_interval(950.0, 900.0, 1100.0, "Pa") == ("950 Pa", "900 to 1100 Pa")
    assert with_interval(26.1e3, 24.5e3, 27.7e3, "Pa") == ("26.1 kPa", "24.5 to 27.7 kPa")
    assert with_interval(-0.1, -0.12, -0.08, "1") == ("-0.1", "-0.12 to -0.08")


def test_a_narrow_interval_has_the_digits_that_tell_its_ends_apart():
    assert with_interval(25.012, 24.98, 25.04, "s") == ("25.01 s", "24.98 to 25.04 s")
    assert with_interval(25.0, 24.99999, 25.00002, "s") == ("25.00000 s", "24.99999 to 25.00002 s")
    assert with_interval(12345.6, 12340.0, 12351.0, "1") == ("12346", "12340 to 12351")
    assert with_interval(25.0, 25.0, 25.0, "s") == ("25 s", "25 to 25 s")  # nothing to tell apart
    assert in_interval(2.0, -inf, inf) == "2 (-inf to inf)"
    assert in_interval(10.0, 9.98, 10.02) == "10.00 (9.98 to 10.02)"
    assert in_interval(54.12, 50.2, 59.3) == "54.1 (50.2 to 59.3)"


def test_code_of_a_note_is_shown_as_it_is(tmp_path):
    folder = ResultFolder(tmp_path)
    code = "if a < b:\n        print('<b>')  # two  spaces\n"
    notes = [Note(title="Monday", paragraphs=["Text."], code=code), Note(title="Tuesday", paragraphs=["No code."])]
    page = StoryPage(title="a story", sentence="Told.", rows=[], notes=notes, figures=[])
    write_story(folder, page, RunRecord(command=["test"], inputs=[], seed=0, jobs=1))
    found = re.findall("<pre[^>]*><code>(.*?)</code></pre>", (tmp_path / "report.html").read_text("utf-8"), re.DOTALL)
    assert [unescape(text) for text in found] == [code]


@dataclass(frozen=True)
class Step:
    """The result of a step: draws as many panels as it is given."""

    name: str
    opened: tuple[str, ...] = ("force",)  # As the step of the places has them
    bins: tuple[Any, ...] = (SimpleNamespace(signal="displacement_rate"),)  # As the step of the regions has them

    def plot(self, ax: Any = None, units: Any = None) -> Any:
        for axes in ax if isinstance(ax, list) else [ax]:
            axes.plot([0, 1], [0, 1], color="0.5", label=self.name)
            axes.set_xlabel(f"drawn by {self.name}")
            if units is not None:
                axes.set_ylabel(f"units: {units}")
        return ax


def with_everything() -> Diagnosis:
    """A diagnosis with two recordings, all optional fields, and a result of each step."""
    rng = np.random.default_rng(0)
    records = [
        Recording.from_arrays(rng.uniform(1, 3, 700), 1e-4 * rng.normal(size=700), 0.02, start=start)
        for start in (0.0, 20.0)
    ]
    experiment = Experiment(recordings=tuple(records))
    plant = Plant(rig=Diaphragm())
    unseen = (tuple(np.arange(700) >= 490 for _ in records),)
    findings: Any = SimpleNamespace(
        checked=check_quality(plant, (experiment,)),
        detection=Step("detection"),
        location=SimpleNamespace(region=Step("region"), place=Step("place"), lines=None),
        discovery=Step("discovery"),
        advice=Step("advice"),
        verification=VERIFIED,
        named=True,
    )
    return replace(
        DIAGNOSIS,
        verdict=Verdict.NAMED,
        base_model=CalibratedPlant.nominal(plant),
        candidates=(
            CandidateSummary(effects=(), fitted=9e-6, unseen=10e-6),
            CandidateSummary(effects=("creep",), fitted=2e-6, unseen=2.1e-6, d2=0.0),
            CandidateSummary(effects=("delay",), fitted=8e-6, unseen=8.1e-6, d2=1234.0),
        ),
        readings=Readings(
            experiments=(experiment,),
            base=(tuple(np.zeros(700) for _ in records),),
            amended=(tuple(np.zeros(700) for _ in records),),
            unseen=unseen,
        ),
        findings=findings,
        verification=VERIFIED.summary,
        names=("creep",),
        causes=(
            Cause(
                effect="creep",
                family="film",
                probability=0.95,
                share_explained=0.97,
                parameters={"time": Interval(value=54.0, low=50.0, high=59.0, unit="s")},
            ),
        ),
        detection=replace(
            DIAGNOSIS.detection,
            noise_source="rests",
            practical=0.61,
            taken_up=True,
            smallest_detectable={"creep": 0.4},
            statistics=(Statistic(name="variance", value=4.0, where="", score=3.0, p_value=0.0025),),
        ),
        location=LocationSummary(
            time=(Window(from_s=1.0, to_s=9.0, score=0.9),),
            frequency=(),
            region=(
                Region(signal="time_since_rest", low=0.0, high=49.99, mean_residual=1.0),
                Region(signal="displacement_rate", low=-332.0, high=326.0, mean_residual=-1.0),
                Region(signal="branch", low=-1.0, high=0.0, mean_residual=0.5),
            ),
            place=(
                PlaceSummary(place="ball", score=0.52, explained=0.5, among_best=False),
                PlaceSummary(
                    place="film", effect="creep", signal="permittivity", score=0.0, explained=0.662, among_best=True
                ),
                PlaceSummary(place="sensor", score=0.3),  # a file of an earlier version, which does not name the effect
                PlaceSummary(place="drive", effect="sensor_drift_at_command_gain", score=0.2),
            ),
        ),
        parameters={
            "shear_modulus": FittedParameter(value=26.4e3, low=25e3, high=27e3, unit="Pa", nominal=30e3, at_bound=True)
        },
        advice=AdviceSummary(
            file="next_input.csv", seconds=120.0, confusion_before=0.3, confusion_after=0.02, waveform="holds"
        ),
        free_form=FreeFormSummary(
            place="ball",
            before=10.2,
            after=4.41,
            gain_low=5.0,
            terms=(
                TermSummary(
                    term="x^2 beyond a dead band",
                    coefficient=-0.0123,
                    unit="N s/m2",
                    shape=ShapeSummary(name="width", value=1.76e-5, unit="m"),
                    inclusion=0.94,
                ),
            ),
        ),
        indistinguishable=(IndistinguishablePair(effects=("creep", "delay"), d2=9.1),),
        forms=(
            FormSummary(form={"ball": "sliding"}, fitted=9.77, unseen=10.4),
            FormSummary(form={}, fitted=11.3, unseen=12.6),
        ),
    )


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The page with everything."""
    return page_of(with_everything(), tmp_path_factory.mktemp("whole"))


def test_the_page_shows_every_step_in_order(whole):
    page = whole
    outline = Page(page)
    assert outline.headings == [
        "What the model lacks",
        "Recordings",
        "The calibrated model",
        "Is anything missing?",
        "Where the mismatch lies",
        "What was tried",
        "A formula without physics",
        "What to record next",
        "Does the explanation hold?",
        "Provenance",
    ]
    assert page.count("<svg") == 11  # four of the recordings, seven of the steps
    assert re.search(r"<text[^>]*>90 %</text>", page)  # the share of the mismatch, beside its colour
    for name in ("detection", "region", "place", "discovery", "advice"):
        assert f"drawn by {name}" in page
    assert "units: {'displacement_rate': 'µm/s'}" in page.replace("&#39;", "'").replace("&apos;", "'")
    assert len(page) < 5e6
    shown = (
        "is taken from the readings while the command rests",
        "at a bound of its allowed range",
        "30 kPa",
        "26.4 kPa",
        "25 to 27 kPa",
        "0.00250",
        "0.610 µm",
        "After a refit to all recordings, the error beyond sensor noise is smaller than this limit",
        "1234",
        "Alternatives to the chosen explanation: delay (d² = 9.10).",
        "x² beyond a dead band (half-width: 17.6 µm)",
        "<td>N s/m²</td>",
        "−0.0123",
        "94 %",
        "at the ball",
        "from 30 to 2.0 %",
        "ball = &#39;sliding&#39;",
        "as the rig file states",
        "12.6",
        "A placebo effect (creep with the opposite sign) fits as well as creep itself",
        "The explanation raises the error on a part of the held-out data: lowest amplitudes.",
        "6.78",
        "97 %",
        "3.12 %",
        "not tested: it hardly differs",
        "−126 ± 8 %",
        "not determined",
        "during rests of the command and up to 50.0 s after the last one, or after the start of the recording if there was none",
        "displacement rate from −332 to 326 µm/s",
        "<td>falling reading</td>",
        "The strength of creep is not constant: in a fit that lets it vary, it changes by −126 % over the fitted data",
    )
    for text in shown:
        assert text in page, text


def test_greys_of_the_figures_follow_the_page(whole):
    drawn = "".join(re.findall(r"<svg.*?</svg>", whole, re.DOTALL))
    assert "color-mix(in srgb, var(--ink) 50%, var(--page))" in drawn  # 0.5, half way between ink and page
    assert re.search(r"#([0-9a-f]{2})\1\1\b", drawn) is None


def test_a_diagnosis_draws_itself_or_says_why_not():
    axes = with_everything().plot()
    assert axes.get_title() == "named: creep"
    assert axes.get_ylabel() == "measured − simulated (µm)"
    legend = [text.get_text() for text in axes.get_legend().get_texts()]
    assert legend == ["calibrated model", "amended model", "held out"]
    assert len(axes.patches) == 2  # one held-out part in each recording
    with pytest.raises(ModelError, match="no evidence"):
        DIAGNOSIS.plot()


CREEP = Cause(effect="creep", family="film", probability=0.912, share_explained=0.97, parameters={})
EXPLANATIONS = {
    Verdict.NAMED: (Explanation(effects=("creep",), probability=0.9),),
    Verdict.AMBIGUOUS: (
        Explanation(effects=("creep",), probability=0.62),
        Explanation(effects=("creep", "sensor_drift"), probability=0.309),
        Explanation(effects=(), probability=0.001),
    ),
}


@pytest.mark.parametrize(
    ("verdict", "said"),
    [
        (
            Verdict.NONE,
            "the error beyond sensor noise is 0.340 µm rms (the larger of the errors on fitted and on held-out data); all tests "
            "of the residual together give p = 0.230, and a mismatch would need at least 1.19 µm rms and p < 0.01.",
        ),
        (
            Verdict.PARAMETERS,
            "the error beyond sensor noise is 0.340 µm rms (the larger of the errors on fitted and on held-out data); all tests "
            "of the residual together give p = 0.230, and a mismatch would need at least 1.19 µm rms and p < 0.01.",
        ),
        (
            Verdict.UNKNOWN,
            "the error beyond sensor noise is 0.340 µm rms (the larger of the errors on fitted and on held-out data), and "
            "errors below 1.19 µm rms do not count as a mismatch; of all effects and signals, each taken alone, one at the film accounts "
            "for the largest share of the mismatch, 34 %.",
        ),
        (
            Verdict.DISTURBANCE,
            "2 % of the power of the mismatch repeats with the command (upper limit: 9 %), and a mismatch counts as a disturbance "
            "only if this limit is below 30 %.",
        ),
        (Verdict.DATA_FAULT, "201 of 1000 samples (20.1 %) are faulty, and at most 10 are accepted."),
        (
            Verdict.NOT_TESTABLE,
            "the command moves the reading by only 3.00 µm rms, while sensor noise is 2.00 µm rms and the allowed model error "
            "is ",
        ),
        (
            Verdict.NAMED,
            "creep is 90 % likely, other explanations from the catalogue 5 %, and causes that were not tried 5 %.",
        ),
        (
            Verdict.AMBIGUOUS,
            "creep alone is 62 % likely, creep and sensor drift 31 %, no effect at all below 1 %, and any other cause 7 %.",
        ),
        (Verdict.PARTLY, "creep is 91 % likely to be a part of what is missing."),
    ],
)
def test_the_first_screen_says_how_sure_a_verdict_is(tmp_path, verdict, said):
    detection = DetectionSummary(
        p_value=0.23,
        excess=0.34,
        practical=1.19,
        taken_up=False,
        moved=3.0,
        smallest_detectable={},
        origin=OriginSummary(by="repeats", share=0.02, low=-0.05, high=0.09, left=1.0, conclusion="disturbance"),
    )
    silent = Recording.from_arrays(np.zeros(1000), np.zeros(1000), 0.02)
    diagnosis = replace(
        DIAGNOSIS,
        verdict=verdict,
        detection=detection,
        location=LocationSummary(time=(), frequency=(), region=(), place=(PlaceSummary(place="film", score=0.34),)),
        faults=(Fault(experiment=1, recording=1, file="a", fault="stuck", samples=201, from_s=0.0, to_s=4.0),),
        readings=Readings(experiments=(Experiment(recordings=(silent,)),), base=(), amended=None, unseen=()),
        explanations=EXPLANATIONS.get(verdict, ()),
        causes=(CREEP,) if verdict.has_causes else (),
    )
    assert said in how_sure(diagnosis) + "."
    assert how_sure(replace(diagnosis, readings=None))
    certain = replace(diagnosis, detection=replace(detection, p_value=1e-4))  # a small error that is beyond chance
    assert "would need" not in how_sure(certain)
    page = page_of(replace(diagnosis, readings=None), tmp_path)
    assert "<h1>Something is &lt;missing&gt;.</h1>" in page and verdict.value.replace("_", " ") in page
    assert "stretch_limit lies at a bound" in page and "6.00" in page
    header = unescape(page[: page.index("</header>")])
    assert f"<strong>How sure:</strong> {how_sure(replace(diagnosis, readings=None))}." in header
    then = re.sub(r"<[^>]*>", "", header.partition("<strong>Next:</strong> ")[2])
    assert then.startswith(f"{next_step(diagnosis)}.".replace("`", ""))
    assert "&lt;code&gt;" not in page
    assert diagnosis.sentence.partition(". ")[2] in then  # details after what a phone shows first


def test_the_closer_look_of_a_faulty_recording_shows_the_largest_fault():
    silent = Recording.from_arrays(np.zeros(1000), np.zeros(1000), 0.02)
    later = Recording.from_arrays(np.zeros(1000), np.zeros(1000), 0.02, start=30.0)
    experiments = (Experiment(recordings=(silent, later)),)
    still = ((np.zeros(1000), np.zeros(1000)),)
    unseen = ((np.zeros(1000, dtype=bool), np.zeros(1000, dtype=bool)),)
    tracks = laid_out(Readings(experiments=experiments, base=still, amended=None, unseen=unseen), 1e-6)
    small = Fault(experiment=1, recording=1, file="a", fault="the reading is stuck", samples=11, from_s=1.0, to_s=1.2)
    large = replace(small, recording=2, samples=301, from_s=40.0, to_s=46.0)
    further = replace(large, fault="the capacitance is stuck", samples=900)  # not drawn, and decides nothing
    found = _faulty(tracks, [small, large, further])
    assert found is not None and found[0] is tracks[1]
    ends = found[0].clock[[found[1], found[2] - 1]]
    assert ends == pytest.approx([37.0, 49.0], abs=0.03)  # half as long again on each side
    found = _faulty(tracks, [small])
    assert found is not None and found[0] is tracks[0]
    assert found[1:] == pytest.approx((0, 181), abs=2)  # 250 samples about the fault, of which 69 lie before the start
    assert _faulty(tracks, []) is None


def test_the_rest_of_the_highest_probability_is_explained():
    sure = replace(DIAGNOSIS, verdict=Verdict.NAMED, explanations=(Explanation(effects=("creep",), probability=0.95),))
    assert how_sure(sure) == "creep is 95 % likely, and the remaining 5 % is kept for causes that were not tried"
    both = replace(sure, explanations=(Explanation(effects=("creep", "delay"), probability=0.95),))
    assert how_sure(both).startswith("creep and delay are 95 % likely, and the remaining ")
