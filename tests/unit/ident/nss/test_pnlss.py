"""Nonlinear state spaces against systems that are known: weights, bands, files, refusals."""

import json

import numpy as np
import pytest
from new_readings import require_hold
from scipy.signal import dlsim, lfilter
from stopping import StopAt, interrupted

from deatwin.ident.narx import FitStatus
from deatwin.ident.nss import NonlinearStateSpace, Pnlss
from deatwin.ident.nss.basis import Basis
from deatwin.ident.nss.identifier import _lines, _on_all, from_lines, from_samples, stabilised
from deatwin.ident.nss.march import System
from deatwin.ident.nss.search import Found, Record, judged
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording

DUFFING = {"states": 2, "degrees": [], "terms": ["x1^3"], "feedthrough": False}


def duffing(rng, n=600, noise=0.0, period=None):
    """A sampled oscillator with a cubic spring, read with noise: x1+ = .8 x1 + .4 x2, x2+ = -.3 x1 + .6 x2 - .1 x1^3 + u."""
    u = rng.uniform(-1.0, 1.0, size=n if period is None else period)
    u = u if period is None else np.tile(u, n // period)
    x, y = np.zeros(2), np.empty(n)
    for k in range(n):
        y[k] = x[0]
        x = np.array([0.8 * x[0] + 0.4 * x[1], -0.3 * x[0] + 0.6 * x[1] - 0.1 * x[0] ** 3 + u[k]])
    return Recording.from_arrays(u, y + noise * rng.normal(size=n), 0.1)


def test_a_known_system_is_recovered():
    # Coordinates of the state are free; the run over other data is not.
    rng = np.random.default_rng(1)
    model = Pnlss(**DUFFING).fit(duffing(rng)).model_
    other = duffing(rng)
    assert model.simulate(other).rms_error < 1e-6 * other.outputs.std()


def test_the_first_states_begin_the_runs_over_the_training_data():
    rng = np.random.default_rng(4)
    records = [duffing(rng, 300).section(50 * i, 250) for i in (1, 2)]
    fitted = Pnlss(**DUFFING).fit(records)
    for record, first in zip(records, fitted.first_states_, strict=True):
        run = fitted.model_.simulate(record, initial=first)
        np.testing.assert_allclose(run.outputs, record.outputs, atol=1e-6)


def test_a_linear_system_of_two_inputs_and_outputs_is_the_known_one():
    rng = np.random.default_rng(2)
    a, b = np.array([[0.8, 0.3], [-0.3, 0.7]]), np.array([[1.0, 0.0], [0.5, -1.0]])
    c, d = np.array([[1.0, 0.0], [0.4, 1.0]]), np.array([[0.0, 0.2], [0.1, 0.0]])
    u = rng.normal(size=(300, 2))
    y = dlsim((a, b, c, d, 1.0), u, x0=[1.0, -1.0])[1]
    fitted = Pnlss(states=2, degrees=[]).fit(Recording.from_arrays(u.T, y.T + 5.0, 0.1))
    assert fitted.error_.max() < 1e-10 and fitted.linear_error_.max() < 1e-8
    np.testing.assert_allclose(np.sort_complex(fitted.model_.poles), np.sort_complex(np.linalg.eigvals(a)), atol=1e-9)
    # The response at 0 Hz, which no change of coordinates moves.
    w, v = (getattr(fitted.model_, name) for name in ("transition", "output"))
    gain = v[:, 1:3] @ np.linalg.solve(np.eye(2) - w[:, 1:3], w[:, 3:5]) + v[:, 3:5]
    gain *= fitted.model_.output_scale[:, None] / fitted.model_.input_scale
    np.testing.assert_allclose(gain, c @ np.linalg.solve(np.eye(2) - a, b) + d, atol=1e-9)


def test_periodic_recordings_start_from_their_best_linear_approximation():
    rng = np.random.default_rng(3)
    record = duffing(rng, n=1500, period=300, noise=0.01)
    sides = {side: (np.zeros(1), np.ones(1)) for side in ("input", "output")}
    response, angles, deviations = _lines([record], sides)
    assert response.shape == (angles.size, 1, 1) and 0 < angles.min() < angles.max() < np.pi and deviations.min() > 0
    assert _lines([duffing(rng)], sides) is None
    assert Pnlss(**DUFFING).fit(record).error_[0] == pytest.approx(0.01, rel=0.1)


def test_directions_learn_where_a_function_bends():
    # A sum of both signals that saturates; products of powers leave a residual, the function of a sum does not.
    rng = np.random.default_rng(4)
    u, x = rng.normal(size=800), np.zeros(801)
    for k in range(800):
        x[k + 1] = 0.3 * x[k] + np.tanh(0.8 * x[k] + 1.5 * u[k])
    record = Recording.from_arrays(u, x[:-1], 0.1)
    common = {"states": 1, "degrees": [], "feedthrough": False}
    fitted = Pnlss(**common, terms=["tanh(s1,1)"], directions=1, starts=2).fit(record)
    assert fitted.error_[0] < 1e-6 < 1e-2 < Pnlss(**common).fit(record).error_[0]


@pytest.mark.parametrize("sets", [8, pytest.param(200, marks=pytest.mark.study)])
def test_bands_hold_what_they_say(sets):
    rng = np.random.default_rng(5)
    require_hold(
        Pnlss(**DUFFING, held_out=0.0)
        .fit(duffing(rng, 200, noise=0.1))
        .model_.free_run_band(duffing(rng, 100, noise=0.1))
        for _ in range(sets)
    )


def test_a_model_comes_back_from_its_file(tmp_path):
    model = Pnlss(**DUFFING).fit(duffing(np.random.default_rng(8), 200, noise=0.1)).model_
    model.save(tmp_path / "nss.json")
    again, record = NonlinearStateSpace.load(tmp_path / "nss.json"), duffing(np.random.default_rng(9), 100)
    np.testing.assert_array_equal(again.simulate(record).outputs, model.simulate(record).outputs)
    np.testing.assert_array_equal(again.free_run_band(record).upper, model.free_run_band(record).upper)
    assert "x1^3" in str(again) and again.provenance["identifier"].startswith("Pnlss(")
    document = json.loads((tmp_path / "nss.json").read_text())
    document["terms"] = ["x1^"]
    (tmp_path / "bad.json").write_text(json.dumps(document))
    with pytest.raises(ModelError, match=r"bad\.json: the term 'x1\^'"):
        NonlinearStateSpace.load(tmp_path / "bad.json")


def test_a_run_that_diverges_says_when():
    model = NonlinearStateSpace(
        terms=["x1^3"], transition=[[0, 1.5, 1, 1]], output=[[0, 1, 0, 0]], sample_time=0.5, output_scale=[2.0]
    )
    run = model.simulate(np.ones(20))
    assert not run.status.ok and np.isfinite(run.outputs).all()
    # x: 0, 1, 3.5, 49.1, 118582 > 1000
    assert run.failed_at_s == 2.0 and run.outputs[0, 4] == run.outputs[0, 3]


@pytest.mark.parametrize(
    ("arguments", "status"),
    [
        ({"max_steps": 1}, FitStatus.NOT_CONVERGED),
        ({}, FitStatus.DONE),
        ({"states": 3, "degrees": [2, 3], "held_out": 0.2}, FitStatus.HELD_OUT),
    ],
)
def test_the_status_says_if_the_error_is_least(arguments, status):
    # A fit that is done leaves the least error of its structure: a longer search lowers it by less than rounding shows.
    record = duffing(np.random.default_rng(1), 600, noise=0.1)
    given = {**DUFFING, "held_out": 0.0} | arguments
    fitted = Pnlss(**given).fit(record)
    longer = Pnlss(**given | {"held_out": 0.0, "max_steps": 200}).fit(record)
    assert fitted.status_ is status and fitted.status_.ok is (status is not FitStatus.NOT_CONVERGED)
    assert bool(fitted.error_[0] < (1.0 + 1e-5) * longer.error_[0]) is (status is FitStatus.DONE)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"states": 0}, "states = 0; it must be an integer of at least 1"),
        ({"degrees": [1]}, "a degree of 1"),
        ({"held_out": 1.0}, "held_out = 1.0"),
        ({"directions": 1}, "no term holds the direction s1"),
        ({"terms": ["x5"]}, "there are x1, x2, u"),
        ({"terms": [3]}, "the term 3 must be text"),
        ({"held_out": "a"}, "held_out must be real numbers"),
        ({"seed": None}, "seed = None; it must be an integer"),  # two fits would differ
        ({"states": 9, "degrees": [2, 3]}, "fitted readings for .* weights"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(arguments, message):
    with pytest.raises(ModelError, match=message):
        Pnlss(**arguments).fit(duffing(np.random.default_rng(0), 200))


@pytest.mark.parametrize(
    ("field", "wrong", "message"),
    [
        ("sample_time", "0.1", "sample_time must be real numbers; got text"),
        ("sample_time", None, "sample_time must be real numbers; got other objects"),
        ("sample_time", 0.0, "sample_time = 0.0; it must be positive and finite"),
        ("transition", [[0, 0.5j, 1]], "transition must be real numbers; got complex numbers"),
        ("output", [[0, 1, 0], [1]], "output must be an array of real numbers; its rows differ"),
        ("directions", "abc", "directions must be real numbers; got text"),
        ("free_output", [[True], [True, False]], "free_output must be truth values"),
        ("terms", None, "for each of the 1 terms"),
        ("input_names", 3, r"names and units of inputs must be texts; got \(3,\)"),
        ("theta_cov", 1j * np.eye(6), "theta_cov must be real numbers; got complex numbers"),
        ("noise_variance", ["a"], "noise_variance must be real numbers; got text"),
        ("input_scale", [np.inf], "1 inputs need as many .* finite scales above 0"),
        ("output_origin", [[[0.0]]], "1 outputs need as many"),
    ],
)
def test_a_model_of_wrong_fields_is_refused(field, wrong, message):
    right = {"terms": [], "transition": [[0, 0.5, 1]], "output": [[0, 1, 0]], "sample_time": 0.1}
    assert NonlinearStateSpace(**right).n_states == 1
    with pytest.raises(ModelError, match=message):
        NonlinearStateSpace(**{**right, field: wrong})


def test_runs_that_make_no_sense_are_refused():
    record = duffing(np.random.default_rng(0), 200)
    model = NonlinearStateSpace(terms=["x1^3"], transition=[[0, 0.5, 1, -0.1]], output=[[0, 1, 0, 0]], sample_time=0.1)
    for wrong, message in (
        ({"initial": "a"}, "initial must be real numbers; got text"),
        ({"initial": [1j]}, "initial must be real numbers; got complex numbers"),
        ({"warmup": 1.5}, "warmup = 1.5; it must be an integer from 1 to 199"),
        ({"warmup": 200}, "warmup = 200"),
    ):
        with pytest.raises(ModelError, match=message):
            model.simulate(record, **wrong)
    for steps in (0, 200, 1.5, "a"):
        with pytest.raises(ModelError, match=f"steps = {steps!r}; it must be an integer from 1 to 199"):
            model.predict(record, steps=steps)


def test_a_constant_signal_is_refused_by_name():
    with pytest.raises(ModelError, match='the input "command" is constant'):
        Pnlss().fit(Recording.from_arrays(np.ones(300), np.arange(300.0), 0.1))


def lagged(gain=0.2, pole=0.8, n=1000):
    """A lag of first order, read without noise."""
    u = np.random.default_rng(0).uniform(-1.0, 1.0, n)
    return Recording.from_arrays(u, lfilter([0.0, gain], [1.0, -pole], u), 0.01)


@pytest.mark.parametrize("states", [2, 3])
def test_too_many_states_keep_an_exact_linear_start(states):
    fitted = Pnlss(states=states, degrees=[2]).fit(lagged())
    assert fitted.linear_error_[0] < 1e-9 and fitted.error_[0] < 1e-7


def test_an_exact_fit_has_a_covariance():
    u = np.random.default_rng(0).uniform(-1.0, 1.0, 1000)
    fitted = Pnlss(states=1, degrees=[2], output_degrees=[2]).fit(Recording.from_arrays(u, u + u**2, 0.01))
    assert fitted.error_[0] < 1e-9 and np.isfinite(fitted.model_.theta_cov).all()


def test_both_errors_are_of_all_samples():
    # Without terms the model is the linear one; its fit to all samples cannot be worse than the start over them.
    record = duffing(np.random.default_rng(11), 300, noise=0.1)
    quiet = Recording.from_arrays(record.inputs[0], record.outputs[0] + np.r_[np.zeros(240), np.full(60, 9.0)], 0.1)
    fitted = Pnlss(states=2, degrees=[]).fit(quiet)
    assert fitted.linear_error_[0] > 3.0 and fitted.error_[0] <= fitted.linear_error_[0]


def test_an_interrupt_that_the_progress_raises_keeps_the_model():
    stop = StopAt(lambda doing: doing.startswith("step 2") or doing == "done")
    fitted = Pnlss(**DUFFING).fit(duffing(np.random.default_rng(10), 200, noise=0.1), progress=stop)
    assert fitted.status_ is FitStatus.INTERRUPTED and fitted.model_.simulate(np.ones(9)).status.ok


def test_an_interrupt_of_the_last_search_is_told(monkeypatch):
    basis = Basis(1, 1, 0, ())
    free = {"directions": (0, 3), "transition": (1, 3), "output": (1, 3)}
    system = System.of(
        basis, {name: np.zeros(s) for name, s in free.items()}, {n: np.ones(s, bool) for n, s in free.items()}
    )
    whole = [Record(inputs=np.ones((1, 9)), outputs=np.ones((1, 9)), fitted=9)]
    start = judged(system, np.zeros((1, 1)), whole)
    monkeypatch.setattr("deatwin.ident.nss.search.triangle", interrupted)
    assert _on_all(Found(point=start, steps=1, overfitted=True), start, whole, 9).interrupted


def test_a_run_that_diverges_at_once_holds_the_origin():
    model = NonlinearStateSpace(
        terms=["u^2"], transition=[[0, 0.5, 1, 0]], output=[[0, 1, 0, 1]], sample_time=1.0, output_origin=[3.0]
    )
    run = model.simulate([1e9, 0.0, 0.0])
    assert run.failed_at_s == 0.0 and run.outputs.tolist() == [[3.0, 3.0, 3.0]]


@pytest.mark.parametrize("power", ["0", "1024", "9" * 20, "9" * 5000])
def test_a_power_that_no_number_has_is_refused(power):
    with pytest.raises(ModelError, match="must be at least 1 and at most 1023"):
        NonlinearStateSpace(terms=[f"u^{power}"], transition=[[0, 0.5, 1, 0]], output=[[0, 1, 0, 1]], sample_time=1.0)


def test_each_output_adds_its_own_noise_to_the_covariance():
    # A linear system: whatever the coordinates of its state, pole, gains and levels are determined, and their
    # covariance is that of least squares with the outputs' own noise.
    rng = np.random.default_rng(6)
    u = rng.standard_normal(300)
    x = lfilter([0.0, 0.5], [1.0, -0.7], u)
    y = np.vstack([x + 0.01 * rng.standard_normal(300), 0.5 * x + 0.5 * rng.standard_normal(300)])
    fitted = Pnlss(states=1, degrees=(), feedthrough=False, held_out=0.0).fit(Recording.from_arrays(u, y, 1.0))
    model, n = fitted.model_, fitted.model_.theta.size

    def known(theta):
        system = model.system.with_theta(theta)
        (level, pole, rate), reading = system.transition[0], system.output
        return np.array([pole, *(reading[:, 1] * rate), *(reading[:, 0] + reading[:, 1] * level / (1.0 - pole))])

    steps = 1e-5 * np.eye(n)
    slopes = np.array([known(model.theta + step) - known(model.theta - step) for step in steps]).T / 2e-5
    scaled = (u[None] - model.input_origin[:, None]) / model.input_scale[:, None]
    rows = model.system.sensitivities(scaled, fitted.first_states_[0])[1].reshape(-1, n + 1)
    inverse = np.linalg.pinv(rows, rcond=1e-10)
    noise = np.tile(model.noise_variance / model.output_scale**2, 300)
    wanted = slopes @ (inverse * noise @ inverse.T)[:n, :n] @ slopes.T
    found = slopes @ model.theta_cov @ slopes.T
    size = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(found / np.outer(size, size), wanted / np.outer(size, size), atol=1e-6)


POLES = np.array([0.75 + 0.45j, 0.75 - 0.45j, 0.9])
A = np.array([[1.5, -0.765, 0.0], [1.0, 0.0, 0.0], [0.2, 0.0, 0.9]])
B = np.array([[1.0, 0.2], [0.0, -1.0], [0.3, 0.5]])
C = np.array([[1.0, 0.5, 0.2], [0.0, 1.0, -0.5]])
D = np.array([[0.1, 0.0], [0.3, -0.2]])


def sorted_poles(a):
    return np.sort_complex(np.linalg.eigvals(a))


@pytest.mark.parametrize("inputs", [1, 2])
def test_poles_are_exact_without_noise(inputs):
    rng = np.random.default_rng(inputs)
    b, d = B[:, :inputs], D[:, :inputs]
    angles = np.sort(rng.uniform(0.02, 3.1, 40))  # lines need not lie evenly
    response = np.array([C @ np.linalg.solve(np.exp(1j * w) * np.eye(3) - A, b) + d for w in angles])
    a, c = from_lines(response, angles, rng.uniform(0.5, 2.0, 40), 3, 6)
    np.testing.assert_allclose(sorted_poles(a), np.sort_complex(POLES), atol=1e-8)
    u = rng.normal(size=(400, inputs))
    y = dlsim((A, b, C, d, 1.0), u, x0=rng.normal(size=3))[1]  # from a state that is no rest
    a, c = from_samples([(u[:200].T, y[:200].T), (u[200:].T, y[200:].T)], 3, 6)
    np.testing.assert_allclose(sorted_poles(a), np.sort_complex(POLES), atol=1e-8)
    assert c.shape == (2, 3)


def test_noise_on_the_outputs_is_no_bias():
    # The past is the instrument: with twenty times the samples the error of the poles falls by about their root.
    errors = []
    for n in (1000, 20_000):
        rng = np.random.default_rng(7)
        u = rng.normal(size=(n, 1))
        y = dlsim((A, B[:, :1], C[:1], D[:1, :1], 1.0), u)[1]
        y += 0.3 * y.std() * rng.normal(size=y.shape)
        errors.append(np.abs(sorted_poles(from_samples([(u.T, y.T)], 3, 10)[0]) - np.sort_complex(POLES)).max())
    assert errors[1] < 0.02 and errors[1] < 0.5 * errors[0]


def test_unstable_poles_are_mirrored():
    a = stabilised(np.diag([0.5, 1.25]))
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(a)), [0.5, 0.8])
