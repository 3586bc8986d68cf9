"""Functions of signals in terms: |u|, sign, saturation, dead zone, splines, radial bases and functions of one's own."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deatwin.ident.frequency import equilibrium, gfrf, linear_part
from deatwin.ident.narx import (
    Frols,
    Grow,
    NarxModel,
    Semp,
    SvbNarx,
    Term,
    generate_terms,
    register_function,
    shapes,
)
from deatwin.ident.narx.free_run import March
from deatwin.ident.nss import NonlinearStateSpace, Pnlss
from deatwin.plant import ModelError, Recording

N = 1200
TRUE = {
    "y(k-1)": 0.5,
    "y(k-2)": -0.2,
    "|u(k-1)|": 0.3,
    "sat(u(k-2),0.7)": 0.4,
    "sign(y(k-1)-y(k-2))": -0.05,
    "u(k-1)dead(y(k-1),0.2)": 0.2,
}
FUNCTIONS = ["|u(k-1)|", "|u(k-2)|", "sat(u(k-2),0.7)", "sign(y(k-1)-y(k-2))", "dead(y(k-1),0.2)", "rbf(u(k-1),1,0.5)"]
MODEL = NarxModel.from_terms(TRUE, sample_time=0.1)
U = np.random.default_rng(0).uniform(-2.0, 2.0, N)


def by_hand() -> np.ndarray:
    y, u = np.zeros(N), U
    for k in range(2, N):
        y[k] = 0.5 * y[k - 1] - 0.2 * y[k - 2] + 0.3 * abs(u[k - 1]) + 0.4 * np.clip(u[k - 2], -0.7, 0.7)
        y[k] -= 0.05 * np.sign(y[k - 1] - y[k - 2])
        y[k] += 0.2 * u[k - 1] * (y[k - 1] - np.clip(y[k - 1], -0.2, 0.2))
    return y


def recorded(noise: float = 0.0, unit: float = 1.0) -> Recording:
    """The recording by hand, its signals counted in units of another size."""
    y = by_hand() + noise * np.random.default_rng(1).normal(size=N)
    return Recording.from_arrays(U * unit, y * unit, 0.1)


@pytest.mark.parametrize(
    "text",
    ["|u(k-1)|", "y(k-1)sign(y(k-1)-y(k-3))^2", "sat(u2(k),0.5)", "rbf(u(k-1),-1,0.001)", "spline(y(k-1),0)u(k-2)^2"],
)
def test_terms_are_read_as_they_are_written(text: str) -> None:
    assert str(Term.parse(text)) == text and Term.parse(str(Term.parse(text))) == Term.parse(text)


def test_signals_in_functions_have_the_names_of_the_recording() -> None:
    term = Term.parse("|volts(k-1)| sat( heat(k-2) , 1e-3)", input_names=["volts", "heat"])
    assert str(term) == "|u1(k-1)|sat(u2(k-2),0.001)"
    assert term.written({("u", 0): "volts", ("u", 1): "heat"}) == "|volts(k-1)|sat(heat(k-2),0.001)"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("sign(e(k-1))", "cannot read"),
        ("|u(k-1)^2|", "cannot read"),
        ("sat(u(k-1))", r"written as sat\(u\(k-1\), limit\)"),
        ("sat(u(k-1),-1)", "positive limit"),
        ("stan(u(k-1),1)", "no function is called 'stan'.*known are abs, sign, sat"),
        ("sign(y(k-1)-u(k-2))", "difference of one signal"),
        ("sign(y(k-2)-y(k-1))", "an earlier sample"),
        ("|y(k)|", "lag must be at least 1"),
    ],
)
def test_what_is_no_function_is_refused(text: str, said: str) -> None:
    with pytest.raises(ModelError, match=said):
        Term.parse(text)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_free_run_is_that_by_hand(compiled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    if not compiled:
        monkeypatch.setattr(March, "_kernel", None)
    run = MODEL.simulate(recorded())
    np.testing.assert_allclose(run.outputs[0], by_hand(), atol=1e-12)
    assert MODEL.predict(recorded()).rms_error < 1e-12
    assert MODEL.predict(recorded(), steps=5).rms_error < 1e-12


@pytest.mark.parametrize("unit", [3e-5, 700.0])
@pytest.mark.parametrize("identifier", [Frols, Semp, SvbNarx, Grow])
def test_the_terms_are_found_in_any_unit(identifier: type, unit: float) -> None:
    def counted(text: str) -> str:
        return text.replace(",0.7", f",{0.7 * unit!r}").replace(",0.2", f",{0.2 * unit!r}")

    found = identifier(functions=list(map(counted, FUNCTIONS[:5]))).fit(recorded(0.01, unit))
    theta = dict(zip(map(str, found.model_.terms), found.model_.theta, strict=True))
    assert set(theta) >= {str(Term.parse(counted(text))) for text in TRUE}
    assert theta["|u(k-1)|"] == pytest.approx(0.3, abs=0.01)
    assert found.model_.simulate(recorded(0.0, unit)).rms_error < 0.005 * unit


def test_a_function_of_ones_own_by_name(tmp_path: Path) -> None:
    register_function("softly", np.tanh)
    y = np.append(0.0, 0.8 * np.tanh(U[:-1]))
    for k in range(1, N):
        y[k] += 0.3 * np.tanh(y[k - 1])
    record = Recording.from_arrays(U, y, 0.1)
    found = Frols(functions=["softly(u(k-1))", "softly(y(k-1))"]).fit(record).model_
    assert {str(term) for term in found.terms} >= {"softly(u(k-1))", "softly(y(k-1))"}
    assert found.simulate(record).rms_error < 1e-9
    found.save(tmp_path / "narx.json")
    assert NarxModel.load(tmp_path / "narx.json").terms == found.terms
    with pytest.raises(ModelError, match="cannot name a function"):
        register_function("sat", np.tanh)


@pytest.mark.parametrize(
    "made",
    [
        lambda: SvbNarx(functions=["own(u(k-1))"]),
        lambda: NarxModel.from_terms({"own(u(k-1))": 1.0}, sample_time=0.1),
        lambda: Pnlss(states=1, degrees=[], terms=["own(x1)"]),
        lambda: NonlinearStateSpace(
            terms=["own(x1)"], transition=[[0, 0.5, 1, 1]], output=[[0, 1, 0, 0]], sample_time=1.0
        ),
    ],
    ids=["SvbNarx", "NarxModel", "Pnlss", "NonlinearStateSpace"],
)
def test_another_process_gets_the_functions_that_are_mentioned(made, monkeypatch):
    register_function("own", np.arctan)
    sent = pickle.dumps(made())
    for known in (shapes._KINDS, shapes._OWN):
        monkeypatch.delitem(known, "own")
    pickle.loads(sent)
    x = np.linspace(-2.0, 2.0, 9)
    found = shapes.Shape.of("own", (), 0)
    np.testing.assert_array_equal(found.value(x), np.arctan(x))
    np.testing.assert_allclose(found.slope(x), 1.0 / (1.0 + x**2), rtol=1e-8)


def test_candidates_hold_a_function_once() -> None:
    (shaped,) = Term.parse("|u(k-1)|").expanded
    written = {str(term) for term in generate_terms(1, 1, 2, functions=[shaped])}
    assert "u(k-1)|u(k-1)|" in written and "|u(k-1)|^2" not in written


def test_offsets_keep_the_zero_that_a_function_is_about() -> None:
    u = U + 50.0
    y = np.append(0.0, 0.1 * np.maximum(u[:-1] - 50.3, 0.0))
    found = Frols(functions=["hinge(u(k-1),50.3)"], output_lags=1, input_lags=1).fit(Recording.from_arrays(u, y, 0.1))
    assert str(found.model_.terms[0]) == "hinge(u(k-1),50.3)" and found.model_.input_origin[0] == 0.0
    assert found.model_.theta[0] == pytest.approx(0.1)


def test_derivatives_where_they_exist_and_a_refusal_where_not() -> None:
    model = NarxModel.from_terms(
        {"y(k-1)": 0.5, "|u(k-1)|": 0.3, "sat(u(k-2),0.7)": 0.4, "u(k-1)dead(y(k-1),0.2)": 0.2}, sample_time=0.1
    )
    # At u = 1: y = 0.5 y + 0.3 + 0.28 - 0.04 + 0.2 y, and the slopes are read off.
    rest = equilibrium(model, 1.0).output
    part = linear_part(model, 1.0, rest)
    assert rest == pytest.approx(0.58 / 0.3 - 0.04 / 0.3) and not np.isnan(part.b).any()
    assert dict(zip(part.input_lags.tolist(), part.b, strict=True)) == pytest.approx(
        {1: 0.3 + 0.2 * (rest - 0.2), 2: 0.0}
    )
    assert part.a == pytest.approx([0.7])
    shifted = [replace(model, theta=model.theta + sign * 1e-6 * np.eye(4)[0]) for sign in (1, -1)]
    ends = [linear_part(one, 1.0, equilibrium(one, 1.0).output) for one in shifted]
    np.testing.assert_allclose(part.b_theta[:, 0], (ends[0].b - ends[1].b) / 2e-6, atol=1e-6)
    with pytest.raises(ModelError, match=r"sat\(u\(k-2\),0.7\) has no derivative at the equilibrium"):
        linear_part(model, 0.7, equilibrium(model, 1.0).output)
    with pytest.raises(ModelError, match="frequency analysis needs a polynomial model"):
        gfrf(model, 1, [1.0])
