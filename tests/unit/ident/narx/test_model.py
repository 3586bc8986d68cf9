"""NarxModel: prediction, free run, divergence, and its file."""

import numpy as np
import pytest
from made_narx import full_narx

from deatwin.ident.narx import NarxModel, ResponseStatus
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


def make_recording(n=200, seed=0, sample_time=0.1):
    rng = np.random.default_rng(seed)
    return Recording.from_arrays(rng.uniform(-1, 1, n), rng.uniform(-1, 1, n), sample_time, start=5.0)


def test_divergence_is_a_status_with_its_time():
    recording = make_recording()
    with np.errstate(all="raise"):
        run = NarxModel.from_terms({"y(k-1)": 2.0, "1": 1.0}, sample_time=0.1).simulate(recording)
    assert run.status is ResponseStatus.DIVERGED and not run.status.ok
    assert "operating range" in run.status.value
    assert recording.start < run.failed_at_s < recording.end
    assert np.all(np.isfinite(run.outputs))
    failed = round((run.failed_at_s - recording.start) / 0.1)
    assert np.ptp(run.outputs[0, failed - 1 :]) == 0.0


def test_a_model_without_lags_is_a_map():
    recording = make_recording()
    run = NarxModel.from_terms({"u(k)^2": 2.0}, sample_time=0.1).simulate(recording)
    np.testing.assert_allclose(run.outputs, 2 * recording.inputs**2)


def test_plot_has_units():
    axes = full_narx().simulate(make_recording()).plot()
    assert axes.get_xlabel() == "time (s)" and "(m)" in axes.get_ylabel()


PLAIN = {"y(k-1)": 0.5, "u(k-1)": 1.0}


def test_a_text_is_one_name_or_unit_not_its_letters():
    model = NarxModel.from_terms({"y(k-1)": 0.5, "volts(k-1)": 1.0}, sample_time=0.1, input_names="volts")
    assert model.input_names == ("volts",)
    assert NarxModel.from_terms(PLAIN, sample_time=0.1, input_units="mV").input_units == ("mV",)


def test_an_input_that_no_term_uses_has_a_unit_too():
    model = NarxModel.from_terms(PLAIN, sample_time=0.1, input_names=("a", "b"))
    assert model.input_units == ("", "")


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"input_units": ("V", "A")}, r"1 input\(s\) are named, input, but 2 unit\(s\) are given"),
        ({"output_units": ()}, r"1 output\(s\) are named, output, but 0 unit\(s\) are given"),
        ({"input_units": (None,)}, "names and units of inputs must be texts"),
        ({"input_names": ("a", "a")}, "two inputs of the model have the same name"),
        ({"provenance": {"runs": 3}}, "provenance must be a mapping of texts to texts"),
        ({"provenance": "a.csv"}, "provenance must be a mapping of texts to texts"),
    ],
)
def test_signals_that_cannot_be(wrong, says):
    with pytest.raises(ModelError, match=says):
        NarxModel.from_terms(PLAIN, sample_time=0.1, **wrong)
