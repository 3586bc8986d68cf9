"""Arguments of another kind are one clear error that names the argument."""

from collections.abc import Callable

import numpy as np
import pytest

from deatwin.ident import check_identifier, example_recordings, spawn_generators
from deatwin.ident.arguments import real_numbers
from deatwin.ident.frequency import bode, design_excitation, gfrf, input_spectrum, linear_part, propagate
from deatwin.ident.greybox import Calibration, FitStatus, Part, calibrate, profile
from deatwin.ident.look import best_linear_approximation
from deatwin.ident.materials import MaterialTest, calibrate_material
from deatwin.ident.narx import Frols, NarxModel, free_run_band, narx_source, one_step_band
from deatwin.ident.narx.linear import Arx
from deatwin.ident.narx.preprocess import (
    choose_orders,
    choose_sampling,
    choose_sections,
    estimate_dead_time,
    inspect_recordings,
    lags_after,
)
from deatwin.ident.nss import Cascade, Pnlss
from deatwin.plant import Diaphragm, Plant
from deatwin.plant.errors import DeatwinError, ModelError

RECORD = example_recordings(420)[0]
MODEL = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0}, sample_time=0.1)
PLANT = Plant(rig=Diaphragm())
CALIBRATION = Calibration(
    plant=PLANT,
    names=("damping",),
    covariance=np.eye(1),
    residuals=np.zeros(5),
    jacobian=np.ones((5, 1)),
    status=FitStatus.SETTLED,
    at_bound=(),
    evaluations=1,
)
PULL = MaterialTest(name="a", kind="tension", stretch=np.linspace(1.1, 2.0, 9), stress=np.linspace(1e3, 9e3, 9))
LINES = np.sin(np.arange(100.0))
MODEL_FIELDS = {"theta": [0.5], "theta_cov": np.zeros((1, 1)), "noise_variance": 0.0, "sample_time": 0.1}


def model_with(name: str, value: object) -> NarxModel:
    return NarxModel(**{"terms": MODEL.terms[:1], **MODEL_FIELDS, name: value})


WRONG_KINDS: list[tuple[Callable[[object], object], str]] = [
    (lambda value: profile(value, RECORD, "damping"), "calibration must be a Calibration"),
    (lambda value: profile(CALIBRATION, RECORD, value), "name must be a str"),
    (lambda value: calibrate(PLANT, RECORD, names=value), "names must be an Iterable"),
    (lambda value: calibrate(PLANT, RECORD, names=[value]), r"names\[0\] must be a str"),
    (lambda value: Part(experiment=value, masks=()), "experiment must be an Experiment"),
    (lambda value: calibrate_material([PULL], value), "about must be a Mapping"),
    (lambda value: free_run_band(value, RECORD, np.random.default_rng(0)), "is not a NarxModel"),
    (lambda value: free_run_band(MODEL, value, np.random.default_rng(0)), "recording must be a Recording"),
    (lambda value: one_step_band(value, RECORD), "is not a NarxModel"),
    (lambda value: narx_source(value), "is not a NarxModel"),
    (lambda value: narx_source(MODEL, rest_input=value), "the rest of inputs must be real numbers"),
    (lambda value: NarxModel(**MODEL_FIELDS, terms=value), "terms must be a list or a tuple"),
    (lambda value: NarxModel(**MODEL_FIELDS, terms=(value,)), r"terms\[0\] must be a Term"),
    *((lambda value, name=name: model_with(name, value), f"{name} must be") for name in MODEL_FIELDS),
    (lambda value: inspect_recordings(RECORD, level=value), "level must be"),
    (lambda value: inspect_recordings(RECORD, degree=value), "degree = .*; it must be an integer"),
    (lambda value: choose_sections(RECORD, n_segments=value), "n_segments = .*; it must be an integer"),
    (lambda value: choose_sections(RECORD, level=value), "level must be"),
    (lambda value: choose_sections(RECORD, validation_share=value), "validation_share must be"),
    (lambda value: choose_sampling(RECORD, n_lags=value), "n_lags = .*; it must be an integer"),
    (lambda value: estimate_dead_time(RECORD, output=value), "output = .*; it must be an integer"),
    (lambda value: estimate_dead_time(RECORD, max_dead_time=value), "max_dead_time = .*; it must be an integer"),
    (lambda value: estimate_dead_time(RECORD, probability=value), "probability must be"),
    (lambda value: lags_after(value, 2), "dead_times must be a list or a tuple"),
    (lambda value: lags_after((), value), "count = .*; it must be an integer"),
    (lambda value: choose_orders(value, RECORD, RECORD, output_lags=[1]), "identifier must be a NarxIdentifier"),
    (
        lambda value: choose_orders(Frols(), RECORD, RECORD, output_lags=[1], degrees=[value]),
        "a degree = .*; it must be an integer",
    ),
    (lambda value: best_linear_approximation(RECORD, channel=value), "channel = .*; it must be an integer"),
    (lambda value: best_linear_approximation(RECORD, output=value), "output = .*; it must be an integer"),
    (lambda value: linear_part(MODEL, 0.5, value), "output must be"),
    (lambda value: bode(value), "response must be a FrequencyResponse"),
    (lambda value: design_excitation((0.1, 1.0), 0.1, amplitude=1.0, unit=value), "unit must be a str"),
    (lambda value: input_spectrum(LINES, 2, 0.1, unit=value), "unit must be a str"),
    (lambda value: example_recordings(value), "n_samples = .*; it must be an integer of at least 21"),
    (lambda value: spawn_generators(0, value), "count = .*; it must be an integer of at least 0"),
    (lambda value: check_identifier(value), "identifier must be an estimator"),
    (lambda value: Arx(offset=value).fit(RECORD), "offset must be True or False"),
    (lambda value: Pnlss(feedthrough=value).fit(RECORD), "feedthrough must be True or False"),
    (lambda value: Pnlss(inputs_in_products=value).fit(RECORD), "inputs_in_products must be True or False"),
    (lambda value: Cascade(feedthrough=value).fit(RECORD), "feedthrough must be True or False"),
]


@pytest.mark.parametrize("value", [1.5j, object()], ids=["complex", "object"])
@pytest.mark.parametrize(("act", "says"), WRONG_KINDS)
def test_an_argument_of_another_kind_is_named(act, says, value):
    with pytest.raises(DeatwinError, match=says):
        act(value)


def test_a_band_of_a_response_is_not_the_response_itself():
    with pytest.raises(ModelError, match="response must be a FrequencyResponse; got a Propagated"):
        bode(propagate(MODEL, lambda model: gfrf(model, 1, [1.0])))


def test_masked_values_are_no_numbers():
    """Under its mask, an array keeps the values that somebody rejected."""
    with pytest.raises(ModelError, match="omega has masked values"):
        real_numbers(np.ma.masked_greater([1.0, 2.0], 1.5), "omega")
    assert real_numbers(np.ma.array([1.0, 2.0]), "omega").tolist() == [1.0, 2.0]
