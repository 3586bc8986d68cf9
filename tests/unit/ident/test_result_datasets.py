"""Results of single steps as datasets: a NetCDF file keeps the values of their fields, with their units."""

from collections.abc import Iterator, Mapping
from dataclasses import fields, replace
from enum import Enum
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_fits import made_fit
from made_verification import VERIFIED

from deatwin.ident.frequency import design_excitation
from deatwin.ident.greybox.filter import Latent
from deatwin.ident.greybox.filter_openings import Opening
from deatwin.ident.greybox.identifiability import Profile
from deatwin.ident.mismatch import Base, Candidate, Naming
from deatwin.ident.mismatch.advise.advice import Advice
from deatwin.ident.mismatch.advise.offer import PricedReading
from deatwin.ident.mismatch.discover.discovery import Discovery, FoundTerm
from deatwin.ident.mismatch.locate.frequency import Band, Bands, LineGroup, Lines
from deatwin.ident.mismatch.locate.location import Location
from deatwin.ident.mismatch.locate.place import OpenedPlace, Places
from deatwin.ident.mismatch.locate.region import Bin, Region, Regions
from deatwin.ident.mismatch.locate.response import ResponseDifference
from deatwin.ident.mismatch.locate.time import Times, Window
from deatwin.ident.mismatch.locate.track import Track
from deatwin.ident.mismatch.naming.decide import Distance
from deatwin.ident.mismatch.result import ShapeSummary
from deatwin.ident.narx.svb import PruningStep
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
    calibration = made_fit(Plant(rig=rig), size * RNG.standard_normal(700), "damping")
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
            shape=ShapeSummary(name="width", value=4e-4, unit="m"),
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
    alternatives=("creep", "sensor_lag"),
    recording=INPUT,
    waveform="staircase",
    added_mass=None,
    measure=None,
    confusion_before=0.4,
    confusion_after=0.01,
    undecided=(),
    tried={"staircase": 30.0, "chirp": 2.0},
    predicted=(np.array([0.0, 1e-6, 2e-6]), np.array([0.0, 2e-6, 5e-6])),
    log_odds=15.0,
    readings=(
        PricedReading(reading="current", unit="A", noise=1e-6, noise_source="typical", log_odds=23.0, resolves=True),
    ),
    noise=2e-6,
    output=("displacement", "m"),
)
NAMING = Naming(
    candidates=(BARE, LAG, CREEP),
    best=CREEP,
    alternatives=(LAG,),
    probabilities={("creep",): 0.8},
    noise=2e-6,
    distances=(Distance(effects=("creep", "sensor_lag+creep"), d2=12.0),),
    failed=("tears",),
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


def along(dims: str, unit: str = "", **values: Any) -> dict[str, tuple[tuple[str, ...], str, Any]]:
    """Variables of one unit along the same dimensions."""
    return {name: (tuple(dims.split()), unit, found) for name, found in values.items()}


EXPECTED = {
    "profile": (
        PROFILE,
        along("value", "N/m", value=PROFILE.values) | along("", "N/m", calibrated=300.0, low=281.0, high=10000.0),
        {"parameter": "stiffness", "bounded_below": 1, "bounded_above": 0, "level": 0.95},
    ),
    "test signal": (
        SIGNAL,
        along("time", "V", value=SIGNAL.values) | along("time", "s", time=np.arange(len(SIGNAL)) * 0.01),
        {"sample_time": 0.01, "band_Hz": SIGNAL.band_Hz},
    ),
    "pruning step": (
        STEP,
        along("term", term=["y(k-1)", "u(k-2)^2"]) | along("update", "nat", bound=STEP.bounds),
        {"threshold": 1e-06},
    ),
    "discovery": (
        DISCOVERY,
        along(
            "term",
            term_coefficient=[2.0, 5.0],
            term_unit=["N s/m", "N/m"],
            term_variable=["velocity", "displacement"],
            term_inclusion=[0.9, 0.6],
            term_shape_name=["", "width"],
            term_shape_value=[NONE, 0.0004],
        )
        | along("", "m", before=9e-06)
        | along("sample", "m/s", state=DISCOVERY.state)
        | along("sample", "N", entering=DISCOVERY.entering, smoothed=LATENT.mean, deviation=LATENT.deviation)
        | along("sample", "s", time=LATENT.timepts)
        | along("sample", counted=LATENT.counted, part=LATENT.origin),
        {"place": "ball", "signal": "force"},
    ),
    "advice": (
        ADVICE,
        along("waveform", waveform=["staircase", "chirp"], d2=[30.0, 2.0])
        | along("rival", rival=ADVICE.alternatives)
        | along("", "m", noise=2e-06)
        | along("time", "s", time=[4.0, 4.5, 5.0])
        | along("time", "V", command=INPUT.inputs[0])
        | along("rival time", "m", predicted=ADVICE.predicted),
        {"confusion_before": 0.4, "confusion_after": 0.01, "advised": "staircase", "sentence": ADVICE.sentence},
    ),
    "naming": (
        NAMING,
        along(
            "candidate",
            candidate_effects=["", "sensor_lag+creep", "creep"],
            candidate_role=["base plant", "not ruled out", "best explanation"],
            candidate_adequate=[c.adequate for c in NAMING.candidates],
            candidate_probability=[NONE, NONE, 0.8],
        )
        | along(
            "candidate",
            "m",
            candidate_fitted=[c.fitted_test.rms for c in NAMING.candidates],
            candidate_unseen=[c.unseen_test.rms for c in NAMING.candidates],
            candidate_model_error=[1e-06] * 3,
        )
        | along("candidate", "nat", candidate_evidence=[c.evidence for c in NAMING.candidates])
        | along("candidate sample", "m", residual=[c.calibration.residuals for c in NAMING.candidates])
        | along("candidate unseen_sample", "m", unseen_residual=[c.unseen for c in NAMING.candidates])
        | along("distance", distance_from=["creep"], distance_to=["sensor_lag+creep"], distance_d2=[12.0])
        | along("", "m", noise=2e-06),
        {"failed": "tears"},
    ),
    "base": (
        Base(chosen=BARE, alternatives=(EARLY,), noise=2e-06),
        along("form", form_name=["reading: end of hold", "reading: start of hold"], form_role=["chosen", "other form"])
        | along("form", "m", form_fitted=[c.fitted_test.rms for c in (BARE, EARLY)])
        | along("form sample", "m", residual=[c.calibration.residuals for c in (BARE, EARLY)])
        | along("form unseen_sample", "m", unseen_residual=[c.unseen for c in (BARE, EARLY)])
        | along("", "m", noise=2e-06),
        {},
    ),
    "verification": (
        VERIFIED,
        along("stage", stage=["before", "after"])
        | along("stage", "m", fitted=[9e-06, 2e-06], unseen=[1.02e-05, 2.13e-06])
        | along("", "m", gain_low=7.4e-06, noise=2e-06)
        | along("ablation", "m", ablation_unseen=[1.02e-05])
        | along(
            "sham", sham_rejected=[1.0, 0.0, 1.0]
        )  # the opposite fits as well; one that is not tested is no objection
        | along("transfer", transfer_worse=[0.0, 1.0])
        | along("transfer", "m", transfer_floor=[2.3e-06, 2.3e-06])
        | along("constancy", constancy_holds=[0.0, 1.0]),
        {"holds": 0, "failures": VERIFIED.failures},
    ),
    "times": (
        TIMES,
        along("window", "s", window_from_s=[1.0])
        | along("sample", "s", time=[0.0, 0.5, 5.0, 5.5])
        | along("sample", track=[0, 0, 1, 1], residual=np.concatenate([t.residual for t in TRACKS])),
        {"period_s": 12.0},
    ),
    "regions": (
        REGIONS,
        along("region", "µm", region_mean_residual=[-4.0])
        | along("bin", "µm", bin_mean=[-4.0])
        | along("bin", "samples", bin_count=[90]),
        {},
    ),
    "places": (
        PLACES,
        along("opened", "nat", opened_gain=[40.0, 4.0]),
        {"closure_p_value": 0.01, "repeatable": 1, "among_best": "film"},
    ),
    "location": (
        LOCATION,
        along("locate_time", "um/s", locate_time_slope=[3.0])
        | along("locate_time", "s", locate_time_from_s=[1.0])
        | along("locate_frequency", "dB", locate_frequency_excess_dB=[12.0])
        | along("locate_lines", locate_lines_kind=["odd"])
        | along("locate_lines", "um", locate_lines_rms=[3.0])
        | along("", "s", locate_lines_period=4.0)
        | along("", locate_lines_periods=6)
        | along("locate_region", "um", locate_region_mean_residual=[-4.0])
        | along("locate_place", locate_place_place=["film", "drive"])
        | along("locate_response", locate_response_order=[2]),
        {"period_s": 12.0},
    ),
}
"""Of each result, beside its plain fields: by the name of a variable its dimensions, unit and values; and attributes."""


def plain(result: Any) -> Iterator[tuple[str, Any]]:
    """Fields that stand in the dataset as they are, and the columns of tables, by their names there."""
    for each in fields(result):
        entry, value = each.metadata.get("dataset"), getattr(result, each.name)
        if (
            entry is not None
            and entry.role in ("variable", "coordinate")
            and not isinstance(value, Mapping | type(None))
        ):
            yield entry.name or each.name, value
        elif entry is not None and entry.role == "table" and value:
            for column in fields(value[0]):
                if getattr(column.metadata.get("dataset"), "of", None) is None:
                    cells = [getattr(row, column.name) for row in value]
                    yield f"{entry.dims[0]}_{column.name}", [c.value if isinstance(c, Enum) else c for c in cells]


@pytest.mark.parametrize("which", EXPECTED)
def test_a_result_comes_back_from_a_file_with_its_fields(which, kept):
    result, variables, attributes = EXPECTED[which]
    back = kept(result.to_xarray())
    for name, (dimensions, unit, _) in variables.items():
        assert (back[name].dims, back[name].attrs.get("units", "")) == (dimensions, unit), name
    for name, values in [*plain(result), *((name, values) for name, (_, _, values) in variables.items())]:
        if back[name].dtype.kind in "UO":
            assert back[name].values.tolist() == ["" if value is None else value for value in values], name
        else:  # a missing number is NaN
            np.testing.assert_allclose(back[name].values, np.array(values, dtype=float), rtol=1e-14, err_msg=name)
    for name, value in attributes.items():
        np.testing.assert_array_equal(np.atleast_1d(back.attrs[name]), np.atleast_1d(value), err_msg=name)


def test_what_is_not_there_has_no_variable(kept):
    bare = kept(replace(VERIFIED, ablations=(), shams=(), transfers=(), constancies=()).to_xarray())
    assert not [name for name in bare.variables if str(name).startswith(("ablation", "sham", "transfer"))]
    assert (float(bare["gain_low"]), bare.attrs["holds"]) == (7.4e-6, 1)
    measure = replace(ADVICE, recording=None, waveform="", predicted=(), measure="the current", added_mass=None)
    found = kept(measure.to_xarray())
    assert not {"command", "time", "predicted"} & set(found.variables) and found.attrs["measure"] == "the current"
    found = kept(replace(DISCOVERY, latent=None).to_xarray())
    assert "smoothed" not in found and found["entering"].values.tolist() == DISCOVERY.entering.tolist()
    found = kept(replace(LOCATION, lines=None, response=None).to_xarray())
    assert not [n for n in found.variables if "lines" in str(n)] and found["locate_time_slope"].values.tolist() == [3.0]


def test_a_location_draws_a_panel_of_each_side_where_it_is_told_or_in_new_axes():
    found = LOCATION.plot()
    labels = [axes.get_xlabel() for axes in found]
    assert labels[-1] == "difference of the response over that of the plant (%)"
    assert [bar.get_width() for bar in found[-1].patches] == [30.0]
    assert labels[-2] == "harmonics of the input, which has a period of 4 s"
    assert len(found[0].figure.axes) == len(found) == 6
    assert LOCATION.plot(found) == found
    with pytest.raises(ValueError, match="argument 2 is longer"):
        LOCATION.plot(found[:5])
    bare = replace(LOCATION, lines=None, response=())
    assert len(bare.plot()) == 4
    assert len(replace(bare, lines=LINES).plot()[0].figure.axes) == 5
