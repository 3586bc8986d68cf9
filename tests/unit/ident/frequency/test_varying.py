"""Frequency responses along time: frozen forms, closed forms with a moving equilibrium, and what cannot be."""

import numpy as np
import pytest

from deatwin.ident.frequency import frequency_grid, gfrf
from deatwin.ident.frequency.output_responses.estimate import nofrf_exact
from deatwin.ident.frequency.output_responses.result import NofrfWarning
from deatwin.ident.frequency.varying import following
from deatwin.ident.frequency.varying.along_time import tv_gfrf, tv_nofrf
from deatwin.ident.frequency.varying.following import hold_equilibrium
from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.document import OperatingRange
from deatwin.ident.narx.trajectory import ThetaTrajectory
from deatwin.plant.errors import ModelError

T = 0.1
GENERAL = {
    "y(k-1)": 1.1,
    "y(k-2)": -0.4,
    "u(k-1)": 0.3,
    "u(k-2)": 0.1,
    "u(k-1)^2": 0.1,
    "y(k-1)u(k-2)": 0.05,
    "y(k-1)^2": 0.05,
    "y(k-1)y(k-2)": -0.1,
    "u(k-1)^3": 0.02,
    "1": 0.1,
}
W = np.array([0.1, 1.0, 7.0, 20.0])
PERIOD = 0.3 * np.random.default_rng(0).normal(size=24)
PULSE = 0.1 * np.cos(2 * np.pi * np.outer([3, 4, 5, 6], np.arange(24)) / 24).sum(axis=0)  # in phase, as suits NOFRFs


def trajectory_of(terms, moving=None, n=None, *, theta_cov=None, **details):
    """A trajectory of a model; ``moving`` maps terms to their values along time."""
    n = n or np.size(next(iter((moving or {"": np.zeros(6)}).values())))
    model = NarxModel.from_terms(terms, sample_time=T, **details)
    theta = np.repeat(model.theta[:, None], n, axis=1)
    for name, values in (moving or {}).items():
        theta[[str(term) for term in model.terms].index(name)] = values
    cov = np.zeros((len(terms),) * 2) if theta_cov is None else theta_cov
    return ThetaTrajectory(
        model=model,
        timepts=T * np.arange(n),
        theta=theta,
        theta_cov=np.broadcast_to(cov, (n, *cov.shape)),
        drift_variance=np.zeros(len(terms)),
    )


def drifting(n=20, **details):
    """All parameters of the general model move, each in its own phase; every time has its own covariance."""
    plain = trajectory_of(GENERAL, n=n, **details)
    phase = np.linspace(0, 2, n) + np.arange(len(GENERAL))[:, None]
    roots = np.random.default_rng(1).normal(size=(n, len(GENERAL), len(GENERAL))) * 1e-3
    return ThetaTrajectory(
        model=plain.model,
        timepts=plain.timepts,
        theta=plain.theta * (1 + 0.1 * np.sin(phase)),
        theta_cov=roots @ roots.swapaxes(1, 2),
        drift_variance=plain.drift_variance,
    )


def around(centre, output):
    """An operating range about a centre."""
    limits = {"input_min": -1, "input_max": 1, "output_min": -2, "output_max": 2}
    return OperatingRange(**limits, input_centre=centre, output_centre=output)


QUANTITIES = {
    "H1": (lambda t, **k: tv_gfrf(t, 1, W, **k), lambda m, u: gfrf(m, 1, W, operating_input=u)),
    "H2": (
        lambda t, **k: tv_gfrf(t, 2, np.stack([W, -W / 2], -1), **k),
        lambda m, u: gfrf(m, 2, np.stack([W, -W / 2], -1), operating_input=u),
    ),
    "H3": (
        lambda t, **k: tv_gfrf(t, 3, np.stack([W, -W, W], -1), **k),
        lambda m, u: gfrf(m, 3, np.stack([W, -W, W], -1), operating_input=u),
    ),
    "G2": (lambda t, **k: tv_nofrf(t, PULSE, 2, **k), lambda m, u: nofrf_exact(m, PULSE, 2, operating_input=u)),
}


# ---- frozen forms


@pytest.mark.parametrize("name", QUANTITIES)
@pytest.mark.parametrize("operating", [None, around(0.3, 0.5)])
def test_each_time_has_the_response_of_its_own_model(name, operating):
    along, frozen = QUANTITIES[name]
    trajectory = drifting(operating=operating)
    times = trajectory.timepts[[3, 11, 12, 19]]
    inputs = np.array([0.4, 0.1, -0.2, 0.3])
    found = along(trajectory, timepts=times, operating_input=inputs)
    np.testing.assert_array_equal(found.operating_inputs, inputs)
    for k, (time, level) in enumerate(zip(times, inputs, strict=True)):
        wanted = frozen(trajectory.at(time), level)
        # That another root of the equation is polished from elsewhere may cost the last digits of the equilibrium.
        np.testing.assert_allclose(found.values[k], wanted.values, rtol=0, atol=1e-12 * wanted.gain.max())
        np.testing.assert_allclose(found.covariance[k], wanted.covariance, rtol=0, atol=1e-10 * wanted.covariance.max())
        assert found.equilibria[k] == pytest.approx(wanted.point.output, rel=1e-12)
        np.testing.assert_allclose(found.band().high[k], wanted.band().high, rtol=1e-10)
    assert (found.symbol, found.order, found.unit) == (wanted.symbol, wanted.order, wanted.unit)
    np.testing.assert_array_equal(found.omega, wanted.omega)


def test_by_default_at_the_centre_of_the_data_and_at_most_200_times():
    trajectory = drifting(n=501, operating=around(0.3, 0.5))
    found = tv_gfrf(trajectory, 1, W[:1])
    assert found.timepts.size == 200 and found.timepts[[0, -1]] == pytest.approx([0.0, 50.0])
    assert np.ptp(np.diff(found.timepts)) < 1.5 * T
    np.testing.assert_array_equal(found.operating_inputs, 0.3)
    shares = []
    few = tv_gfrf(drifting(n=7), 1, W[:1], progress=lambda share, _: shares.append(share))
    np.testing.assert_array_equal(few.timepts, T * np.arange(7))
    assert shares == pytest.approx(np.arange(1, 8) / 7)


def test_an_excitation_that_does_not_suit_is_said_once():
    with pytest.warns(NofrfWarning, match="use design_excitation") as said:
        tv_nofrf(drifting(), PERIOD, 2)
    assert len(said) == 1


# ---- the equilibrium


def test_an_equilibrium_that_moves_changes_every_order_as_in_closed_form():
    # y(k) = 0.5 y1 + u1 + 0.2 y1^2 + d(t): only the constant d moves. ybar solves 0.2 y^2 - 0.5 y + d = 0, and with
    # p = 0.5 + 0.4 ybar, z = e^(-jw): H1 = z/(1 - p z), and each higher order has 1 - p z of the sum of its tones.
    d = np.linspace(0.05, 0.2, 12)
    trajectory = trajectory_of({"y(k-1)": 0.5, "u(k-1)": 1.0, "y(k-1)^2": 0.2, "1": 0.0}, {"1": d})
    ybar = (0.5 - np.sqrt(0.25 - 0.8 * d)) / 0.4
    pole = (0.5 + 0.4 * ybar)[:, None]
    w = np.array([[1.0, 3.0, -0.5], [0.2, 0.3, 5.0]])

    def denominator(*tones):
        return 1 - pole * np.exp(-1j * T * sum(tones))

    def first(a):
        return np.exp(-1j * T * a) / denominator(a)

    def second(a, b):
        return 0.2 * first(a) * first(b) * np.exp(-1j * T * (a + b)) / denominator(a, b)

    def third(a, b, c):
        pairs = first(a) * second(b, c) + first(b) * second(a, c) + first(c) * second(a, b)
        return 0.4 / 3 * pairs * np.exp(-1j * T * (a + b + c)) / denominator(a, b, c)

    for order, response in ((1, first), (2, second), (3, third)):
        tones = w[:, :order].T
        wanted = response(*tones)
        found = tv_gfrf(trajectory, order, w[:, 0] if order == 1 else w[:, :order])
        np.testing.assert_allclose(found.equilibria, ybar, rtol=1e-12)
        np.testing.assert_allclose(found.values, wanted, rtol=1e-11)
        assert np.all(np.abs(wanted[-1] / wanted[0] - 1) > 0.1)  # it matters
        held = tv_gfrf(hold_equilibrium(trajectory, ybar[7]), order, w[:, 0] if order == 1 else w[:, :order])
        np.testing.assert_allclose(held.values, np.repeat(wanted[7:8], 12, axis=0), rtol=1e-11)


def test_a_held_equilibrium_stands_still_whatever_the_parameters():
    trajectory = drifting(operating=around(0.3, 0.5))
    without = {name: value for name, value in GENERAL.items() if name != "1"}
    for given in (trajectory, trajectory_of(without, theta_cov=1e-6 * np.eye(len(without)))):
        held = hold_equilibrium(given, 0.37, 0.2)
        found = tv_gfrf(held, 1, W, operating_input=0.2)
        np.testing.assert_allclose(found.equilibria, 0.37, rtol=1e-12)
        np.testing.assert_allclose(found.equilibrium_std, 0.0, atol=1e-9)
        np.testing.assert_array_equal(held.theta[: len(given.terms) - 1], given.theta[: len(given.terms) - 1])
        assert np.all(found.covariance[:, :, 0, 0] > 0)
    with pytest.raises(ModelError, match="finite number"):
        hold_equilibrium(trajectory, np.nan)


def test_the_equilibrium_has_the_uncertainty_of_the_parameters():
    # y = a y1 + u1 + d: ybar = (u + d)/(1 - a), dybar = (ybar da + dd)/(1 - a).
    cov = np.array([[4e-4, 0, 1e-4], [0, 1e-6, 0], [1e-4, 0, 9e-4]])
    trajectory = trajectory_of({"y(k-1)": 0.5, "u(k-1)": 1.0, "1": 0.1}, theta_cov=cov, n=5)
    found = tv_gfrf(trajectory, 1, W, operating_input=0.3)
    slope = np.array([0.8, 0.3, 1.0]) / 0.5
    np.testing.assert_allclose(found.equilibria, 0.8, rtol=1e-13)
    np.testing.assert_allclose(found.equilibrium_std, np.sqrt(slope @ cov @ slope), rtol=1e-12)


def test_the_branch_is_followed_even_where_another_equilibrium_is_nearer():
    # y(k) = y1 + 0.1 ((y1 - s) - (y1 - s)^3) + u: equilibria at s - 1, s (unstable), s + 1. While s goes from 0 to 5
    # the one that starts at 1 goes to 6; of the last three (4, 5, 6) the one at 4 is nearest to where it was.
    s = np.linspace(0, 5, 200)
    moving = {"y(k-1)": 1 + 0.1 * (1 - 3 * s**2), "y(k-1)^2": 0.3 * s, "1": 0.1 * (s**3 - s), "y(k-1)^3": -0.1 + 0 * s}
    terms = {name: float(values[0]) for name, values in moving.items()} | {"u(k-1)": 1.0}
    for start, end in ((1.0, 6.0), (-1.0, 4.0)):
        trajectory = trajectory_of(terms, moving, operating=around(0.0, start))
        found = tv_gfrf(trajectory, 1, W, timepts=[0.0, T * 199])
        np.testing.assert_allclose(found.equilibria, [start, end], rtol=1e-9)
        assert all(status.ok for status in found.statuses)
        few = following.followed(trajectory, trajectory.timepts[::8], np.zeros(25))
        outputs = [model.operating.output_centre[0] for model in few]
        np.testing.assert_allclose(outputs, s[::8] + start, rtol=1e-9)


def vanishing():
    """y = 0.5 y1 + u1 + 0.2 y1^2 + d: no equilibrium where d > 0.3125; unstable beyond p = 0.5 + 0.4 ybar < -1."""
    d = np.concatenate([np.linspace(0.1, 0.5, 15), np.linspace(0.5, -8.0, 20)])
    terms = {"y(k-1)": 0.5, "u(k-1)": 1.0, "y(k-1)^2": 0.2, "1": 0.1}
    return trajectory_of(terms, {"1": d}, input_units=("V",), output_units=("mm",), theta_cov=1e-4 * np.eye(4)), d


def test_where_the_equilibrium_vanishes_there_is_no_response_and_no_crash():
    trajectory, d = vanishing()
    found = tv_gfrf(trajectory, 2, np.stack([W, W], -1))
    exists = d <= 0.3125
    ybar = (0.5 - np.sqrt(np.where(exists, 0.25 - 0.8 * d, np.nan))) / 0.4
    pole = 0.5 + 0.4 * ybar
    statuses = np.array([status.name for status in found.statuses])
    np.testing.assert_array_equal(statuses == "NONE", ~exists)
    np.testing.assert_array_equal(statuses == "UNSTABLE", exists & (pole < -1))
    np.testing.assert_array_equal(np.isnan(found.values), np.repeat(~exists[:, None], 4, axis=1))
    np.testing.assert_array_equal(np.isnan(found.covariance).any(axis=(1, 2, 3)), ~exists)
    np.testing.assert_allclose(found.equilibria, ybar, rtol=1e-9)
    stable = statuses == "OK"
    known = np.isfinite(found.frozen_error).all(axis=1)
    assert not np.any(known & ~stable)
    assert np.all(known[1:-1][stable[1:-1] & stable[2:] & stable[:-2]])
    band = found.band()
    assert not band.linear_law[~exists].any() and np.isnan(band.low[~exists]).all()
    with pytest.raises(ModelError, match="has an equilibrium at its operating input"):
        tv_gfrf(trajectory, 1, W, timepts=trajectory.timepts[12:16])


# ---- the error of frozen responses


@pytest.mark.parametrize("places", [[260, 1010, 2010], np.arange(100, 2400, 300), [1000]], ids=["few", "even", "one"])
def test_the_error_of_times_far_apart_is_that_of_the_system_between_them(places):
    # y(k) = a(k) y(k-1) + u(k-1) under e^(jwk) is h(k) e^(jwk) with h(k) = (a(k) h(k-1) + 1) e^(-jw), a recursion. The
    # frozen response is z/(1 - a z). A second order of the rate is left: a few per cent of the correction.
    k = np.arange(2400)
    a = 0.5 + 0.2 * np.sin(2 * np.pi * k / 2000)
    trajectory, z = trajectory_of({"y(k-1)": 0.5, "u(k-1)": 1.0}, {"y(k-1)": a}), np.exp(-1j * T * W)
    h = np.zeros((k.size, W.size), dtype=complex)
    h[0] = z / (1 - a[0] * z)
    for i in k[1:]:
        h[i] = (a[i] * h[i - 1] + 1) * z
    found = tv_gfrf(trajectory, 1, W, timepts=T * np.asarray(places))
    wanted = h[places] - found.values
    np.testing.assert_allclose(found.frozen_correction, wanted, atol=0.05 * np.abs(wanted).max())


def test_the_error_of_a_tone_is_the_same_in_all_forms():
    # u = A cos: Y_2 at twice its frequency is A^2/4 H_2(w, w), and U_2 is A^2/4.
    trajectory = drifting()
    w, amplitude = 2 * np.pi * 3 / (24 * T), 0.3
    tone = amplitude * np.cos(w * T * np.arange(24))
    h = tv_gfrf(trajectory, 2, [[w, w]], operating_input=0.4).frozen_correction[:, 0]
    g = tv_nofrf(trajectory, tone, 2, operating_input=0.4)
    line = int(np.argmin(np.abs(g.omega - 2 * w)))
    assert g.omega[line] == pytest.approx(2 * w)
    np.testing.assert_allclose(g.frozen_correction[:, line], h, rtol=1e-9)


def test_blocks_of_times_change_nothing(monkeypatch):
    trajectory, _ = vanishing()
    whole = tv_gfrf(trajectory, 2, np.stack([W, W], -1)).frozen_correction
    monkeypatch.setattr(following, "_BLOCK", 12)
    np.testing.assert_array_equal(tv_gfrf(trajectory, 2, np.stack([W, W], -1)).frozen_correction, whole)
    linear = tv_gfrf(trajectory_of({"y(k-1)": 0.5, "u(k-1)": 1.0}), 2, np.stack([W, W], -1))
    np.testing.assert_array_equal(linear.frozen_correction, 0.0)  # a response that is zero throughout


def test_one_time_has_a_response_but_no_rate():
    found = tv_gfrf(drifting(n=1), 1, W)
    assert found.values.shape == (1, 4) and np.isfinite(found.values).all()
    assert np.isnan(found.frozen_error).all()
    assert len(tv_gfrf(drifting(), 1, W, timepts=1.0).values) == 1
    assert found.plot().get_xlabel() == "time (s)"


# ---- what is drawn, kept and refused


def test_plots_and_dataset():
    trajectory, _ = vanishing()
    w = np.geomspace(0.1, 30, 40)
    first, line = tv_gfrf(trajectory, 1, w), tv_gfrf(trajectory, 2, np.stack([w, np.full_like(w, np.pi)], -1))
    ax = first.plot()
    assert (ax.get_xlabel(), ax.get_ylabel(), ax.get_yscale()) == ("time (s)", "frequency (Hz)", "log")
    assert ax.figure.axes[1].get_ylabel() == "$|H_1|$ (mm/V)"
    shown = ax.collections[0].get_array().reshape(40, 35).T
    np.testing.assert_array_equal(np.ma.getmaskarray(shown), np.isnan(first.gain))
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["unstable"]
    assert line.plot().get_ylabel() == "$f_1$ (Hz)"
    assert tv_gfrf(trajectory, 2, np.stack([np.full_like(w, 1.0), w], -1)).plot().get_ylabel() == "$f_2$ (Hz)"
    with pytest.raises(ModelError, match="one line of frequencies"):
        tv_gfrf(trajectory, 2, frequency_grid(w[:3], w[:3])).plot()
    two = np.cos(2 * np.pi * np.outer([5, 6], np.arange(40)) / 40).sum(axis=0)  # of 0.25 Hz; squared 0, 1, 10, 11, 12
    mesh = tv_nofrf(trajectory, two, 2).plot().collections[0]
    empty = np.ma.getmaskarray(mesh.get_array().reshape(-1, 35)).all(axis=1)
    assert empty.tolist() == [False, False, True, False, False, False]
    borders = mesh.get_coordinates()[:, 0, 1] / 0.25
    np.testing.assert_allclose(borders, [-0.5, 0.5, 1.5, 9.5, 10.5, 11.5, 12.5], atol=1e-12)
    data = first.to_xarray()
    assert data["real"].dims == ("time", "point") and data["real"].units == "mm/V"
    np.testing.assert_array_equal(data["frozen_error"], first.frozen_error)
    assert set(data["status"].values) == {"OK", "UNSTABLE", "NONE"}


def test_what_cannot_be():
    trajectory = drifting()
    for times, match in (
        ([-1.0, 1.0], "known from 0 s to 1.9 s"),
        ([1.0, 9.0], "known from"),
        ([1.5, 1.0], "increase"),
        ([np.nan], "finite"),
        ([], "finite times"),
        ([[1.0, 2.0]], "shape"),
    ):
        with pytest.raises(ModelError, match=match):
            tv_gfrf(trajectory, 1, W, timepts=times)
    with pytest.raises(ModelError, match="one for each of the 2 times"):
        tv_gfrf(trajectory, 1, W, timepts=[1.0, 1.8], operating_input=[0.0, 1.0, 2.0])
    with pytest.raises(ModelError, match="real numbers"):
        tv_gfrf(trajectory, 1, W, operating_input="2 V")
    with pytest.raises(ModelError, match="order"):
        tv_gfrf(trajectory, 0, W)
    with pytest.raises(ModelError, match="zero"):
        tv_nofrf(trajectory, np.zeros(20), 1)
    with pytest.raises(ModelError, match="2 inputs"):
        tv_gfrf(trajectory_of({"u1(k-1)": 1.0, "u2(k-1)": 1.0}), 1, W)
    one = NarxModel.from_terms({"y1": {"y1(k-1)": 0.5, "u(k-1)": 1.0}, "y2": {"y2(k-1)": 0.4}}, sample_time=T)
    joined = ThetaTrajectory(
        model=one,
        timepts=np.arange(3) * T,
        theta=np.repeat(one.theta[:, None], 3, axis=1),
        theta_cov=np.zeros((3, 3, 3)),
        drift_variance=np.zeros(3),
    )
    for level in (None, 0.5):
        with pytest.raises(ModelError, match="one output; this one has 2"):
            tv_gfrf(joined, 1, W, operating_input=level)


def test_a_model_is_no_trajectory():
    model = NarxModel.from_terms({"y(k-1)": 0.5, "u(k-1)": 1.0}, sample_time=1.0)
    for use in (
        lambda: tv_gfrf(model, 1, [0.1]),
        lambda: tv_nofrf(model, [1.0, -1.0], 1),
        lambda: hold_equilibrium(model, 0.0),
    ):
        with pytest.raises(ModelError, match="a NarxModel is not a ThetaTrajectory: give the trajectory_"):
            use()
