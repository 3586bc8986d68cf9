"""Results of single steps as datasets: a NetCDF file keeps the values of their fields, with their units."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.frequency import design_excitation
from deatwin.ident.greybox import Calibration, FitStatus
from deatwin.ident.greybox.filter import Latent
from deatwin.ident.greybox.filter_openings import Opening
from deatwin.ident.greybox.identifiability import Profile
from deatwin.ident.mismatch import Base, Candidate, Naming
from deatwin.ident.mismatch.advise.advice import Advice
from deatwin.ident.mismatch.discover.discovery import Discovery, FoundTerm
from deatwin.ident.mismatch.locate import Location
from deatwin.ident.mismatch.locate.frequency import Band, Bands
from deatwin.ident.mismatch.locate.lines import LineGroup, Lines
from deatwin.ident.mismatch.locate.place import OpenedPlace, Places
from deatwin.ident.mismatch.locate.region import Bin, Region, Regions
from deatwin.ident.mismatch.locate.response import ResponseDifference
from deatwin.ident.mismatch.locate.time import Times, Window
from deatwin.ident.mismatch.locate.track import Track
from deatwin.ident.mismatch.naming.decide import Distance
from deatwin.ident.mismatch.verify import Ablation, Verification
from deatwin.ident.mismatch.verify.constancy import Constancy
from deatwin.ident.mismatch.verify.shams import Sham, ShamKind
from deatwin.ident.mismatch.verify.transfer import Transfer
from deatwin.ident.narx.pruning import PruningStep
from deatwin.ident.narx.terms import Term
from deatwin.plant import Diaphragm, Parameter, Plant, ReadingTime, Recording
from deatwin.plant.effects.base import Place
from deatwin.plant.effects.free_form import FreeForm
from deatwin.plant.effects.primitives import DeadBand, Power

pytest.importorskip("xarray")
RNG = np.random.default_rng(0)
RIG = Diaphragm(model_error=1e-6)
NONE = float("nan")


def candidate(*effects: str, size: float, rig: Diaphragm = RIG) -> Candidate:
    """An explanation that leaves noise of a size, SI."""
    calibration = Calibration(
        plant=Plant(rig=rig),
        names=("damping",),
        covariance=np.eye(1),
        residuals=size * RNG.standard_normal(700),
        jacobian=np.ones((700, 1)),
        status=FitStatus.SETTLED,
        at_bound=(),
        evaluations=1,
    )
    return Candidate(effects=effects, calibration=calibration, unseen=size * RNG.standard_normal(300), noise=2e-6)


BARE, CREEP, LAG = candidate(size=9e-6), candidate("creep", size=2e-6), candidate("sensor_lag", "creep", size=3e-6)
EARLY = candidate(size=8e-6, rig=replace(RIG, reading=ReadingTime.START_OF_HOLD))

PROFILE = Profile(
    parameter=Parameter(name="stiffness", value=300.0, unit="N/m", lower=10.0, upper=1e4),
    values=np.array([280.0, 300.0, 1e4]),
    deviances=np.array([4.0, 0.0, 1.5]),
    low=281.0,
    high=1e4,
    bounded=(True, False),
)
SIGNAL = design_excitation((1.0, 5.0), 0.01, amplitude=0.5, unit="V")
STEP = PruningStep(
    terms=(Term.parse("y(k-1)"), Term.parse("u(k-2)^2")),
    indices=np.array([4, 7]),
    relevance=np.array([0.5, 1e-9]),
    threshold=1e-6,
    bounds=(-20.0, 3.0, 3.5),
)
FORM = FreeForm(
    enters=Place.BALL,
    node="force",
    unit="N",
    size=0.1,
    terms=(Power(variable="velocity", order=1, scale=0.1),),
    coefficients=(2.0,),
)
LATENT = Latent(
    opening=Opening(place="ball", signal="force"),
    timepts=np.array([0.1, 0.2, 0.3]),
    mean=np.array([1.0, 2.0, 3.0]),
    deviation=np.array([0.1, 0.2, 0.1]),
    states={},
    counted=np.array([True, False, True]),
    origin=np.array([0, 0, 1]),
    amplitude=1.0,
    memory=0.5,
    log_likelihood=3.0,
)
DISCOVERY = Discovery(
    calibration=SimpleNamespace(plant=Plant(rig=RIG).with_effects(FORM)),
    before=9e-6,
    after=4e-6,
    gain_low=3e-6,
    terms=(
        FoundTerm(term=FORM.terms[0], coefficient=2.0, unit="N s/m", shape=None, inclusion=0.9),
        FoundTerm(
            term=DeadBand(variable="displacement", scale=1e-3, width=0.4),
            coefficient=5.0,
            unit="N/m",
            shape=("width", 4e-4, "m"),
            inclusion=0.6,
        ),
    ),
    unseen=np.array([1e-6, -2e-6]),
    state=np.array([0.0, 0.1, 0.2]),
    entering=np.array([0.0, 0.2, 0.4]),
    latent=LATENT,
)
INPUT = Recording.from_arrays(
    np.array([0.0, 1.0, 2.0]), np.zeros((0, 3)), 0.5, start=4.0, input_names=("command",), input_units=("V",)
)
ADVICE = Advice(
    rivals=("creep", "sensor_lag"),
    recording=INPUT,
    waveform="staircase",
    added_mass=None,
    measure=None,
    confusion_before=0.4,
    confusion_after=0.01,
    undecided=(),
    tried={"staircase": 30.0, "chirp": 2.0},
    predicted=(np.array([0.0, 1e-6, 2e-6]), np.array([0.0, 2e-6, 5e-6])),
    noise=2e-6,
    output=("displacement", "m"),
)
NAMING = Naming(
    candidates=(BARE, LAG, CREEP),
    best=CREEP,
    rivals=(LAG,),
    probabilities={("creep",): 0.8},
    noise=2e-6,
    distances=(Distance(effects=("creep", "sensor_lag+creep"), d2=12.0),),
    failed=("tears",),
)
VERIFICATION = Verification(
    fitted_before=9e-6,
    fitted_after=2e-6,
    unseen_before=10e-6,
    unseen_after=2.1e-6,
    gain_low=7e-6,
    noise=2e-6,
    output_unit="m",
    ablations=(Ablation(effect="creep", fitted=9e-6, unseen=10e-6, gain_low=7e-6, share=0.97),),
    shams=(
        Sham(effect="creep", kind=ShamKind.OPPOSITE, share=0.1, expected=0.0),
        Sham(effect="creep", kind=ShamKind.BACKWARDS, skipped="no memory"),
    ),
    transfers=(
        Transfer(
            part="steps.csv", before=2e-6, after=4e-6, gain_low=-3e-6, gain_high=-1e-6, floor=2.2e-6, model_error=1e-6
        ),
    ),
    constancies=(Constancy(effect="creep", change=-1.5, deviation=0.1, own=0.5), Constancy(effect="delay", own=0.04)),
)
TRACKS = tuple(
    Track(timepts=start + np.array([0.0, 0.5]), residual=np.array([1e-6, 2e-6]) + start, signals={}, sample_time=0.5)
    for start in (0.0, 5.0)
)
TIMES = Times(windows=(Window(from_s=1.0, to_s=2.0, score=0.7, slope=3e-6),), period_s=12.0, tracks=TRACKS)
BANDS = Bands(
    bands=(Band(from_Hz=0.5, to_Hz=2.0, excess_dB=12.0),),
    frequency=np.array([0.0, 1.0, 2.0]),
    ratio=np.array([1.0, 16.0, 3.0]),
)
LINES = Lines(period_s=4.0, periods=6, groups=(LineGroup(kind="odd", rms=3e-6, p_value=1e-4, lines=40),))
REGIONS = Regions(
    regions=(Region(signal="command", low=1.0, high=3.0, mean_residual=-4.0),),
    unit="µm",
    bins=(Bin(signal="command", number=2, low=1.0, high=2.0, mean=-4.0, deviation=0.5, count=90, p_value=1e-9),),
)
PLACES = Places(
    opened=(
        OpenedPlace(place="film", signal="stress", gain=40.0, p_value=1e-6, explained=0.7, score=0.9, among_best=True),
        OpenedPlace(
            place="drive", signal="command", gain=4.0, p_value=0.2, explained=-0.1, score=0.0, among_best=False
        ),
    ),
    closure_p_value=0.01,
)
LOCATION = Location(
    time=TIMES,
    frequency=BANDS,
    lines=LINES,
    region=REGIONS,
    place=PLACES,
    unit=("um", 1e-6),
    response=(ResponseDifference(order=2, from_Hz=0.5, to_Hz=2.0, p_value=0.001, size=0.3),),
)

EXPECTED = {
    "profile": (
        PROFILE,
        {
            "value": (("value",), "N/m", PROFILE.values),
            "deviance": (("value",), "", PROFILE.deviances),
            "calibrated": ((), "N/m", 300.0),
            "low": ((), "N/m", 281.0),
            "high": ((), "N/m", 1e4),
        },
        {"parameter": "stiffness", "bounded_below": 1, "bounded_above": 0, "level": 0.95},
    ),
    "test signal": (
        SIGNAL,
        {"value": (("time",), "V", SIGNAL.values), "time": (("time",), "s", np.arange(len(SIGNAL)) * 0.01)},
        {"sample_time": 0.01, "band_Hz": SIGNAL.band_Hz},
    ),
    "pruning step": (
        STEP,
        {
            "term": (("term",), "", ["y(k-1)", "u(k-2)^2"]),
            "index": (("term",), "", STEP.indices),
            "relevance": (("term",), "", STEP.relevance),
            "bound": (("update",), "nat", STEP.bounds),
        },
        {"threshold": 1e-6},
    ),
    "discovery": (
        DISCOVERY,
        {
            "term_coefficient": (("term",), "", [2.0, 5.0]),
            "term_unit": (("term",), "", ["N s/m", "N/m"]),
            "term_variable": (("term",), "", ["velocity", "displacement"]),
            "term_inclusion": (("term",), "", [0.9, 0.6]),
            "term_shape_name": (("term",), "", ["", "width"]),
            "term_shape_value": (("term",), "", [NONE, 4e-4]),
            "before": ((), "m", 9e-6),
            "after": ((), "m", 4e-6),
            "gain_low": ((), "m", 3e-6),
            "unseen": (("unseen_sample",), "m", DISCOVERY.unseen),
            "state": (("sample",), "m/s", DISCOVERY.state),
            "entering": (("sample",), "N", DISCOVERY.entering),
            "time": (("sample",), "s", LATENT.timepts),
            "smoothed": (("sample",), "N", LATENT.mean),
            "deviation": (("sample",), "N", LATENT.deviation),
            "counted": (("sample",), "", LATENT.counted),
            "part": (("sample",), "", LATENT.origin),
        },
        {"place": "ball", "signal": "force"},
    ),
    "discovery without a smoothed force": (
        replace(DISCOVERY, latent=None),
        {"entering": (("sample",), "N", DISCOVERY.entering)},
        {},
    ),
    "advice": (
        ADVICE,
        {
            "waveform": (("waveform",), "", ["staircase", "chirp"]),
            "d2": (("waveform",), "", [30.0, 2.0]),
            "rival": (("rival",), "", ADVICE.rivals),
            "noise": ((), "m", 2e-6),
            "time": (("time",), "s", [4.0, 4.5, 5.0]),
            "command": (("time",), "V", INPUT.inputs[0]),
            "predicted": (("rival", "time"), "m", ADVICE.predicted),
        },
        {"confusion_before": 0.4, "confusion_after": 0.01, "advised": "staircase", "sentence": ADVICE.sentence},
    ),
    "advice to measure": (
        replace(ADVICE, recording=None, waveform="", predicted=(), measure="the current", added_mass=None),
        {"d2": (("waveform",), "", [30.0, 2.0])},
        {"measure": "the current"},
    ),
    "naming": (
        NAMING,
        {
            "candidate_effects": (("candidate",), "", ["", "sensor_lag+creep", "creep"]),
            "candidate_role": (("candidate",), "", ["base plant", "not ruled out", "best explanation"]),
            "candidate_fitted": (("candidate",), "m", [c.fitted_test.rms for c in NAMING.candidates]),
            "candidate_unseen": (("candidate",), "m", [c.unseen_test.rms for c in NAMING.candidates]),
            "candidate_model_error": (("candidate",), "m", [1e-6] * 3),
            "candidate_evidence": (("candidate",), "nat", [c.evidence for c in NAMING.candidates]),
            "candidate_adequate": (("candidate",), "", [c.adequate for c in NAMING.candidates]),
            "candidate_probability": (("candidate",), "", [NONE, NONE, 0.8]),
            "residual": (("candidate", "sample"), "m", [c.calibration.residuals for c in NAMING.candidates]),
            "unseen_residual": (("candidate", "unseen_sample"), "m", [c.unseen for c in NAMING.candidates]),
            "distance_from": (("distance",), "", ["creep"]),
            "distance_to": (("distance",), "", ["sensor_lag+creep"]),
            "distance_d2": (("distance",), "", [12.0]),
            "noise": ((), "m", 2e-6),
        },
        {"failed": "tears"},
    ),
    "base": (
        Base(chosen=BARE, rivals=(EARLY,), noise=2e-6),
        {
            "form_name": (("form",), "", ["reading: end of hold", "reading: start of hold"]),
            "form_role": (("form",), "", ["chosen", "other form"]),
            "form_fitted": (("form",), "m", [c.fitted_test.rms for c in (BARE, EARLY)]),
            "residual": (("form", "sample"), "m", [c.calibration.residuals for c in (BARE, EARLY)]),
            "unseen_residual": (("form", "unseen_sample"), "m", [c.unseen for c in (BARE, EARLY)]),
            "noise": ((), "m", 2e-6),
        },
        {},
    ),
    "verification": (
        VERIFICATION,
        {
            "stage": (("stage",), "", ["before", "after"]),
            "fitted": (("stage",), "m", [9e-6, 2e-6]),
            "unseen": (("stage",), "m", [10e-6, 2.1e-6]),
            "gain_low": ((), "m", 7e-6),
            "noise": ((), "m", 2e-6),
            "ablation_effect": (("ablation",), "", ["creep"]),
            "ablation_unseen": (("ablation",), "m", [10e-6]),
            "ablation_fitted": (("ablation",), "m", [9e-6]),
            "ablation_gain_low": (("ablation",), "m", [7e-6]),
            "ablation_share": (("ablation",), "", [0.97]),
            "sham_kind": (("sham",), "", ["with the opposite sign", "backwards in time"]),
            "sham_share": (("sham",), "", [0.1, NONE]),
            "sham_expected": (("sham",), "", [0.0, NONE]),
            "sham_skipped": (("sham",), "", ["", "no memory"]),
            "sham_rejected": (("sham",), "", [1.0, 1.0]),
            "transfer_part": (("transfer",), "", ["steps.csv"]),
            "transfer_before": (("transfer",), "m", [2e-6]),
            "transfer_gain_high": (("transfer",), "m", [-1e-6]),
            "transfer_floor": (("transfer",), "m", [2.2e-6]),
            "transfer_model_error": (("transfer",), "m", [1e-6]),
            "transfer_worse": (("transfer",), "", [1.0]),
            "constancy_effect": (("constancy",), "", ["creep", "delay"]),
            "constancy_change": (("constancy",), "", [-1.5, NONE]),
            "constancy_own": (("constancy",), "", [0.5, 0.04]),
            "constancy_deviation": (("constancy",), "", [0.1, NONE]),
            "constancy_holds": (("constancy",), "", [0.0, 1.0]),
        },
        {"holds": 0, "failures": VERIFICATION.failures},
    ),
    "bare verification": (
        replace(VERIFICATION, ablations=(), shams=(), transfers=(), constancies=()),
        {"gain_low": ((), "m", 7e-6)},
        {"holds": 1},
    ),
    "times": (
        TIMES,
        {
            "window_from_s": (("window",), "s", [1.0]),
            "window_to_s": (("window",), "s", [2.0]),
            "window_score": (("window",), "", [0.7]),
            "window_slope": (("window",), "", [3e-6]),
            "time": (("sample",), "s", [0.0, 0.5, 5.0, 5.5]),
            "track": (("sample",), "", [0, 0, 1, 1]),
            "residual": (("sample",), "", np.concatenate([t.residual for t in TRACKS])),
        },
        {"period_s": 12.0},
    ),
    "no times": (Times(windows=(), period_s=None, tracks=()), {"residual": (("sample",), "", [])}, {}),
    "bands": (
        BANDS,
        {
            "band_from_Hz": (("band",), "Hz", [0.5]),
            "band_to_Hz": (("band",), "Hz", [2.0]),
            "band_excess_dB": (("band",), "dB", [12.0]),
            "frequency": (("frequency",), "Hz", BANDS.frequency),
            "ratio": (("frequency",), "", BANDS.ratio),
        },
        {},
    ),
    "lines": (
        LINES,
        {
            "group_kind": (("group",), "", ["odd"]),
            "group_rms": (("group",), "", [3e-6]),
            "group_p_value": (("group",), "", [1e-4]),
            "group_lines": (("group",), "", [40]),
            "period": ((), "s", 4.0),
            "periods": ((), "", 6),
        },
        {},
    ),
    "regions": (
        REGIONS,
        {
            "region_signal": (("region",), "", ["command"]),
            "region_low": (("region",), "", [1.0]),
            "region_mean_residual": (("region",), "µm", [-4.0]),
            "bin_number": (("bin",), "", [2]),
            "bin_mean": (("bin",), "µm", [-4.0]),
            "bin_deviation": (("bin",), "µm", [0.5]),
            "bin_count": (("bin",), "samples", [90]),
            "bin_p_value": (("bin",), "", [1e-9]),
        },
        {},
    ),
    "places": (
        PLACES,
        {
            "opened_place": (("opened",), "", ["film", "drive"]),
            "opened_signal": (("opened",), "", ["stress", "command"]),
            "opened_gain": (("opened",), "nat", [40.0, 4.0]),
            "opened_explained": (("opened",), "", [0.7, -0.1]),
            "opened_score": (("opened",), "", [0.9, 0.0]),
            "opened_among_best": (("opened",), "", [1.0, 0.0]),
        },
        {"closure_p_value": 0.01, "repeatable": 1, "among_best": "film"},
    ),
    "location": (
        LOCATION,
        {
            "locate_time_slope": (("locate_time",), "um/s", [3.0]),
            "locate_time_from_s": (("locate_time",), "s", [1.0]),
            "locate_frequency_excess_dB": (("locate_frequency",), "dB", [12.0]),
            "locate_lines_kind": (("locate_lines",), "", ["odd"]),
            "locate_lines_rms": (("locate_lines",), "um", [3.0]),
            "locate_lines_period": ((), "s", 4.0),
            "locate_lines_periods": ((), "", 6),
            "locate_region_mean_residual": (("locate_region",), "um", [-4.0]),
            "locate_place_place": (("locate_place",), "", ["film", "drive"]),
            "locate_response_order": (("locate_response",), "", [2]),
        },
        {"period_s": 12.0},
    ),
    "location without a period": (
        replace(LOCATION, lines=None, response=None),
        {"locate_time_slope": (("locate_time",), "um/s", [3.0])},
        {"period_s": 12.0},
    ),
}
"""Of each result: by the name of a variable its dimensions, unit and values; and attributes of the whole."""


@pytest.mark.parametrize("which", EXPECTED)
def test_a_result_comes_back_from_a_file_with_its_fields(which, kept):
    result, variables, attributes = EXPECTED[which]
    back = kept(result.to_xarray())
    for name, (dimensions, unit, values) in variables.items():
        assert (back[name].dims, back[name].attrs.get("units", "")) == (dimensions, unit), name
        if np.asarray(values).dtype.kind == "U":
            assert back[name].values.tolist() == list(values), name
        else:
            np.testing.assert_allclose(back[name].values, values, rtol=1e-14, err_msg=name)
    for name, value in attributes.items():
        np.testing.assert_array_equal(np.atleast_1d(back.attrs[name]), np.atleast_1d(value), err_msg=name)


def test_what_is_not_there_has_no_variable():
    bare, measure = (EXPECTED[which][0].to_xarray() for which in ("bare verification", "advice to measure"))
    assert not [name for name in bare.variables if str(name).startswith(("ablation", "sham", "transfer"))]
    assert not {"command", "time", "predicted"} & set(measure.variables)
    assert "smoothed" not in EXPECTED["discovery without a smoothed force"][0].to_xarray()
    assert not [n for n in EXPECTED["location without a period"][0].to_xarray().variables if "lines" in str(n)]


def test_a_location_draws_a_panel_of_each_side_where_it_is_told_or_in_new_axes():
    found = LOCATION.plot()
    labels = [axes.get_xlabel() for axes in found]
    assert labels[-1] == "difference of the response over that of the plant (%)"
    assert [bar.get_width() for bar in found[-1].patches] == [30.0]
    assert labels[-2] == "lines of a period of 4 s"
    assert len(found[0].figure.axes) == len(found) == 6
    assert LOCATION.plot(found) == found
    with pytest.raises(ValueError, match="argument 2 is longer"):
        LOCATION.plot(found[:5])
    bare = replace(LOCATION, lines=None, response=())
    assert len(bare.plot()) == 4
    assert len(replace(bare, lines=LINES).plot()[0].figure.axes) == 5
