"""LinearModel: prediction, free run, frequency response, its forms elsewhere, and its file."""

import numpy as np
import pytest
from made_narx import full_linear
from scipy.signal import lfilter

from deatwin.ident.narx import ResponseStatus
from deatwin.ident.narx.linear import LinearModel
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


def by_filters(model, u, e):
    w = sum(lfilter(b, f, row) for b, f, row in zip(model.b, model.f, u, strict=True))
    return lfilter([1.0], model.a, w + lfilter(model.c, model.d, e) + model.offset)


def draw(seed=0, n=400, noise=0.0):
    rng = np.random.default_rng(seed)
    u, e = rng.normal(size=(2, n)), noise * rng.normal(size=n)
    return Recording.from_arrays(u, by_filters(full_linear(), u, e), 0.1), e


def test_free_run_finds_the_state_at_the_start_of_a_section():
    recording, _ = draw()
    section = recording.section(100, 400)
    for warmup, first in ((4, 6), (None, 2 + 40)):  # 4 poles, input lag 2
        run = full_linear().simulate(section, warmup=warmup)
        assert run.first == first and run.status.ok
        # exact but for rounding, amplified by the condition of the state's least squares (about 1e3)
        assert np.abs(run.residuals).max() < 1e-10
        np.testing.assert_array_equal(run.outputs[:, :first], section.outputs[:, :first])


def test_only_the_warmup_of_the_output_is_used():
    recording, _ = draw(noise=0.1)
    spoilt = recording.outputs.copy()
    spoilt[:, 42:] = 99.0
    other = Recording.from_arrays(recording.inputs, spoilt, 0.1)
    a, b = full_linear().simulate(recording), full_linear().simulate(other)
    np.testing.assert_array_equal(a.outputs[:, a.first :], b.outputs[:, a.first :])


def test_armax_is_a_narmax_model():
    model = LinearModel(a=[1, -0.5], b=[[0, 1.0]], c=[1, 0.4], offset=0.3, sample_time=1.0)
    narx = model.to_narx()
    assert str(narx) == "y(k) = 0.5 y(k-1) + 1 u(k-1) + 0.4 e(k-1) + 0.3 1 + e(k)"
    rng = np.random.default_rng(2)
    u, e = rng.normal(size=(2, 200))
    recording = Recording.from_arrays(u, lfilter([0, 1.0], [1, -0.5], u) + lfilter([1, 0.4], [1, -0.5], e), 1.0)
    np.testing.assert_allclose(
        model.predict(recording).outputs, narx.predict(recording).outputs, rtol=1e-12, atol=1e-13
    )
    with pytest.raises(ModelError, match="D and F"):
        full_linear().to_narx()


def test_one_step_predictions_leave_the_noise():
    recording, e = draw(noise=0.2)
    run = full_linear().predict(recording)
    # 3 states of F are set by 30 errors, with a deviation of about the noise's over sqrt(10); what is left of a
    # wrong state dies out with the slowest pole, |0.71|^k, and C's, 0.32^k
    assert run.first == 2 + 1 + 30
    np.testing.assert_allclose(run.residuals[0, 80:], e[run.first + 80 :], atol=1e-8)


def test_an_unstable_run_is_a_status_with_its_time():
    model = LinearModel(a=[1, -1.2], b=[[0, 1.0]], sample_time=1.0)
    rng = np.random.default_rng(3)
    run = model.simulate(Recording.from_arrays(rng.normal(size=400), rng.normal(size=400), 1.0, start=7.0))
    assert run.status is ResponseStatus.DIVERGED and 7.0 < run.failed_at_s < 7.0 + 100.0
    assert np.all(np.isfinite(run.outputs)) and abs(model.poles[0]) > 1.0
    unstable = LinearModel(a=[1], b=[[0, 1.0]], f=[[1, -1.2]], sample_time=1.0)
    with pytest.raises(ModelError, match="C or F"):
        unstable.predict(Recording.from_arrays(rng.normal(size=50), rng.normal(size=50), 1.0))


def test_poles():
    poles = np.sort_complex(full_linear().poles)
    wanted = np.sort_complex(np.r_[0.4, -0.6, np.roots([1, -1.2, 0.5])])
    np.testing.assert_allclose(poles, wanted, atol=1e-14)


def test_python_control_gives_the_same_responses():
    import control

    model = full_linear()
    omega = np.array([0.1, 1.0, 10.0, 30.0])
    q = np.exp(-0.1j * omega)
    system = model.to_control()
    assert system.dt == 0.1 and system.ninputs == 2 and system.input_labels == ["command", "temperature"]
    np.testing.assert_allclose(
        system(np.exp(1j * omega * 0.1))[0],
        [
            np.polyval(b[::-1], q) / np.polyval(np.convolve(model.a, f)[::-1], q)
            for b, f in zip(model.b, model.f, strict=True)
        ],
        rtol=1e-12,
    )
    u = np.random.default_rng(4).normal(size=60)
    t = 0.1 * np.arange(60)
    _, y = control.forced_response(control.ss(system[0, 0]), t, u)
    np.testing.assert_allclose(y, lfilter(model.b[0], np.convolve(model.a, model.f[0]), u), atol=1e-12)


def test_what_does_not_suit_is_refused():
    model = full_linear()
    rng = np.random.default_rng(6)
    for recording, says in [
        (Recording.from_arrays(rng.normal(size=(2, 60)), rng.normal(size=60), 0.2), "sample time"),
        (Recording.from_arrays(rng.normal(size=60), rng.normal(size=60), 0.1), "inputs"),
        (Recording.from_arrays(rng.normal(size=(2, 5)), rng.normal(size=5), 0.1), "samples"),
    ]:
        with pytest.raises(ModelError, match=says):
            model.simulate(recording)
    with pytest.raises(ModelError, match="warmup = 2"):
        model.simulate(draw()[0], warmup=2)
    for arguments, says in [
        ({"a": [1], "b": [[0, 0]]}, "not zero"),
        ({"a": [1], "b": []}, "0 polynomials"),
        ({"a": [1], "b": [[1]], "f": ([1], [1])}, "as many f"),
        ({"a": [1, np.nan], "b": [[1]]}, "finite"),
        ({"a": [1], "b": [[1]], "noise_variance": -1.0}, "noise_variance"),
        ({"a": [1, 1j], "b": [[1]]}, "a must be real numbers; got complex numbers"),
        ({"a": [1], "b": None}, "b must be a list or a tuple; got None"),
        ({"a": [1], "b": [[1], ["a"]]}, r"b\[1\] must be real numbers; got text"),
        ({"a": [1], "b": [[1]], "f": "1"}, "f must be a list or a tuple; got text"),
        ({"a": [1], "b": [[1]], "offset": 1j}, "offset must be real numbers; got complex numbers"),
        ({"a": [1], "b": [[1]], "input_units": 3}, "names and units of inputs must be texts"),
    ]:
        with pytest.raises(ModelError, match=says):
            LinearModel(sample_time=1.0, **arguments)


def test_it_prints_and_is_read_only():
    text = str(full_linear())
    assert "A = 1 - 0.4 q^-1" in text and "B1 = 0 + 1 q^-1 + 0.5 q^-2" in text and "offset = 0.25" in text
    with pytest.raises(ValueError):
        full_linear().b[0][0] = 1.0
