"""Verification: what must hold on held-out data, and what must not do as well as a named effect."""

from dataclasses import replace
from functools import cache
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
from made_fits import made_problem
from needs import COMPILED
from scipy.interpolate import CubicSpline

from deatwin.ident.greybox.fit import calibrate
from deatwin.ident.mismatch.naming.candidate import Candidate, judge
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.quality.quality import check_quality, split
from deatwin.ident.mismatch.verify import placebos
from deatwin.ident.mismatch.verify.constancy import Constancy
from deatwin.ident.mismatch.verify.placebos import (
    PlaceboKind,
    _Case,
    backwards,
    phase_randomised,
    placebo_effects,
)
from deatwin.ident.mismatch.verify.verify import _ablation, _constancies, _whole, shares_explained, verify
from deatwin.plant import Creep, Delay, Diaphragm, Experiment, PermittivityDrift, Plant, Recording
from deatwin.plant.effects.base import Effect
from deatwin.plant.effects.catalogue import catalogue, effect_named
from deatwin.plant.excitation import band_limited_noise, random_holds

MODULE = import_module("deatwin.ident.mismatch.verify.verify")  # by its path a function of that name is found
NOMINAL = Plant(rig=Diaphragm())
VALUES = {"shear_modulus": 29e3, "stretch_limit": 140.0, "permittivity": 4.3, "damping": 0.06}
NOISE = 2e-6
VISIBLE = 0.3  # of the noise: below it no effect is named


@cache
def bench_of(*effects, seed: int = 0) -> DiagnosisProblem:
    """40 s of noise and 30 s of holds by a plant with effects and known parameters."""
    rng = np.random.default_rng(seed)
    noise, holds = band_limited_noise(rng, 40.0, 0.02), random_holds(rng, 30.0, 0.02, 1.2, 3.1)
    first = Recording.from_arrays(noise, np.zeros_like(noise), 0.02)
    second = Recording.from_arrays(holds, np.zeros_like(holds), 0.02, start=40.0)
    truth = NOMINAL.with_values(VALUES).with_effects(*effects)
    return on_bench(truth.record(Experiment(recordings=(first, second)), rng), effects)


def on_bench(experiment: Experiment, effects: tuple[Effect, ...]) -> DiagnosisProblem:
    fitted, unseen, everything = split(check_quality(NOMINAL, (experiment,)))
    return made_problem(nominal=NOMINAL, effects=effects, fitted=fitted, unseen=unseen, everything=everything)


def late_readings(mean: float, growth: float, seed: int) -> DiagnosisProblem:
    """60 s of noise whose readings come late by a mean time that grows."""
    rng = np.random.default_rng(seed)
    command = band_limited_noise(rng, 60.0, 0.02)
    blank = Recording.from_arrays(command, np.zeros_like(command), 0.02)
    exact = NOMINAL.with_values(VALUES).simulate(Experiment(recordings=(blank,))).outputs[0][0]
    late = mean + growth * (blank.timepts / blank.timepts[-1] - 0.5)
    seen = np.maximum(blank.timepts - late, 0.0)  # before, the film was at rest
    readings = CubicSpline(blank.timepts, exact)(seen) + NOISE * rng.normal(size=exact.size)
    record = Recording.from_arrays(command, readings, 0.02)
    return on_bench(Experiment(recordings=(record,)), (Delay(),))


@cache
def fitted_with(problem: DiagnosisProblem, *effects) -> Candidate:
    """The plant with effects, fitted from the true parameters."""
    plant = NOMINAL.with_values(VALUES).with_effects(*effects)
    candidate = judge(problem, calibrate(plant, problem.fitted, starts=1), NOISE)
    assert candidate is not None
    return candidate


def placebos_of(effect, seed: int):
    """Shams of the effect that is there, and the structural residual after the refit without it over the noise."""
    problem = bench_of(effect, seed=seed)
    base = fitted_with(problem)
    gain = float(np.mean(base.unseen**2)) - NOISE**2
    structural = max(base.calibration.rms**2 - NOISE**2, 0.0) ** 0.5 / NOISE
    found = placebo_effects(
        base.calibration, effect, gain, problem.fitted, problem.everything, np.random.default_rng(seed + 100)
    )
    return structural, {sham.kind: sham for sham in found}


@COMPILED
@pytest.mark.parametrize(
    "effect", [Creep(modulus=50e3, time=20.0), effect_named("hysteresis")], ids=lambda effect: effect.name
)
def test_shams_of_a_right_name_are_rejected(effect):
    if effect.event:
        effect = replace(effect, **{effect.event: 22.0})
    structural, shams = placebos_of(effect, seed=0)
    assert structural > VISIBLE
    assert set(shams) == set(PlaceboKind)
    for sham in shams.values():
        assert sham.share is not None, sham.skipped
        assert sham.rejected, sham


@pytest.mark.study
@COMPILED
def test_at_least_95_percent_of_right_names_survive_all_shams():
    """All effects of the catalogue that this rig takes, each on four experiments, counted where it can be seen."""
    survived, judged = [], []
    for effect in catalogue():
        if not NOMINAL.accepts(effect):
            continue
        if effect.event:
            effect = replace(effect, **{effect.event: 22.0})
        for seed in range(20, 24):
            structural, shams = placebos_of(effect, seed)
            if structural > VISIBLE:
                survived.append(all(sham.rejected for sham in shams.values()))
                judged.append(sum(sham.share is not None for sham in shams.values()))
    assert len(survived) > 70
    assert np.mean(survived) >= 0.95
    assert np.mean(judged) > 2.0  # of three: few can be skipped, or nothing was tested


@COMPILED
def test_an_effect_without_memory_has_no_backward_sham():
    """On the force of a spring the future and the past are the same, but for what the film itself remembers."""
    _, shams = placebos_of(effect_named("sensor_saturation"), seed=0)
    assert shams[PlaceboKind.BACKWARDS].share is None
    assert "no memory" in shams[PlaceboKind.BACKWARDS].skipped
    assert shams[PlaceboKind.BACKWARDS].rejected  # a sham that says nothing speaks against nobody


def spoilt_hysteresis(sham_of):
    """Shams of a hysteresis where the readings hold half of it and all of a sham that is made of its change."""
    effect = effect_named("hysteresis")
    experiment = bench_of(seed=0).everything[0].experiment
    plant = NOMINAL.with_values(VALUES)

    def change(of):
        pairs = zip(plant.with_effects(effect).simulate(of).outputs, plant.simulate(of).outputs, strict=True)
        return [a[0] - b[0] for a, b in pairs]

    own = change(experiment)
    spoilt = Experiment(
        recordings=tuple(
            replace(record, outputs=record.outputs + 0.5 * half + sham)
            for record, half, sham in zip(experiment.recordings, own, sham_of(change, experiment), strict=True)
        )
    )
    fitted, _, everything = split(check_quality(NOMINAL, (spoilt,)))
    base = calibrate(plant, fitted, evaluations=4, starts=1)  # at its minimum the plant is hardly simulated any more
    return {s.kind: s for s in placebo_effects(base, effect, 1e-16, fitted, everything, np.random.default_rng(0))}


def turned(change, of):
    return [y[::-1] for y in reversed(change(backwards(of)))]


def drawn_first(change, of):
    rng = np.random.default_rng(0)
    return [phase_randomised(y, rng) for y in change(of)]


@COMPILED
@pytest.mark.parametrize(
    ("sham_of", "kind"), [(turned, PlaceboKind.BACKWARDS), (drawn_first, PlaceboKind.RANDOM_PHASES)]
)
def test_what_happened_backwards_or_is_only_as_large_and_as_smooth_is_not_the_effect(sham_of, kind):
    """The readings hold half of the effect and all of its own sham: the sham must win."""
    sham = spoilt_hysteresis(sham_of)[kind]
    assert sham.share > 1.0 and not sham.rejected


def test_random_phases_compete_with_the_refit_and_what_runs_backwards_with_the_first_order():
    """A refit that gains half as much again as first order says: signals that are only added have no such reserve."""
    rng = np.random.default_rng(0)
    jacobian = rng.normal(size=(400, 2))
    change, other = rng.normal(size=400), rng.normal(size=400)
    fitted = np.arange(400) < 250
    case = _Case(name="creep", gain=1.0, residual=change, change=change, jacobian=jacobian, fitted=fitted)
    named, other = case.named, case.left(other)
    mismatch = named + 0.9 * other
    own, gained = case.gained(named, mismatch), case.gained(other, mismatch)
    case = replace(case, gain=1.5 * own, residual=mismatch)
    assert case.best(PlaceboKind.BACKWARDS, [other]).share == pytest.approx(gained / own)
    assert case.random_phases([other]).share == pytest.approx(gained / (1.5 * own))
    less = replace(case, gain=0.5 * own)  # the refit fell short of what first order has
    assert less.random_phases([other]).share == pytest.approx(gained / own)
    nonlinear = replace(case, gain=2.5 * own)
    assert "do not change linearly" in nonlinear.random_phases([other]).skipped
    # a part of what the refit gained is the parameters' alone, before any of these competes
    biased = replace(case, gain=1.8 * own, residual=mismatch + jacobian @ [0.5, -0.3])
    by_parameters = np.mean(biased.residual[250:] ** 2) - np.mean(mismatch[250:] ** 2)
    assert own < 1.8 * own - by_parameters < 1.7 * own
    assert biased.random_phases([other]).share == pytest.approx(gained / (1.8 * own - by_parameters))
    assert biased.best(PlaceboKind.BACKWARDS, [other]).share == pytest.approx(gained / own)


@COMPILED
def test_the_wrong_sign_is_noticed():
    effect = effect_named("sensor_drift")
    problem = bench_of(effect, seed=0)
    without = fitted_with(problem)
    base, gain = without.calibration, float(np.mean(without.unseen**2)) - NOISE**2
    wrong = replace(effect, change=-effect.change)
    for named, rejected in ((effect, True), (wrong, False)):
        found = placebo_effects(base, named, gain, problem.fitted, problem.everything, np.random.default_rng(0))
        assert {s.kind: s for s in found}[PlaceboKind.OPPOSITE].rejected is rejected


@COMPILED
@pytest.mark.parametrize(
    ("gain", "simulates", "reason"),
    [
        (0.0, True, "the effect does not lower the error"),
        (1e-12, False, "cannot be simulated without the effect, or with the placebo"),
    ],
)
def test_shams_that_nothing_can_be_learned_of_say_so(monkeypatch, gain, simulates, reason):
    problem = bench_of(seed=0)
    base = fitted_with(problem).calibration
    if not simulates:
        monkeypatch.setattr(placebos, "_change", lambda plant, effect, experiments: None)
    found = placebo_effects(
        base, effect_named("hysteresis"), gain, problem.fitted, problem.everything, np.random.default_rng(0)
    )
    assert [sham.kind for sham in found] == list(PlaceboKind)
    assert all(sham.share is None and reason in sham.skipped and sham.rejected for sham in found)


def test_the_linear_refit_is_least_squares_of_all_regressors_together():
    """Frisch & Waugh: projecting off the Jacobian first gives the amplitude of the joint fit."""
    rng = np.random.default_rng(0)
    jacobian, change, residual = rng.normal(size=(300, 4)), rng.normal(size=300), rng.normal(size=300)
    residual += 2.0 * change
    fitted = np.arange(300) < 200
    case = _Case(name="creep", gain=1.0, residual=residual, change=change, jacobian=jacobian, fitted=fitted)
    gained = case.gained(case.named, case.mismatch)
    alone = np.linalg.lstsq(jacobian[fitted], residual[fitted])[0]
    together = np.linalg.lstsq(np.c_[jacobian, change][fitted], residual[fitted])[0]
    before = residual[~fitted] - jacobian[~fitted] @ alone
    after = residual[~fitted] - np.c_[jacobian, change][~fitted] @ together
    assert gained == pytest.approx(np.mean(before**2) - np.mean(after**2), rel=1e-9)
    assert case.gained(-case.named, case.mismatch) == 0.0


def test_backwards_twice_is_forwards():
    rng = np.random.default_rng(0)
    first = Recording.from_arrays(rng.normal(size=50), np.zeros(50), 0.02, start=1.0, extras={"force": np.arange(50.0)})
    second = Recording.from_arrays(rng.normal(size=30), np.zeros(30), 0.02, start=2.5, extras={"force": np.ones(30)})
    experiment = Experiment(recordings=(first, second))
    turned = backwards(experiment)
    assert (turned.start, turned.end) == pytest.approx((experiment.start, experiment.end))
    np.testing.assert_array_equal(turned.recordings[0].inputs, second.inputs[:, ::-1])
    for once, again in zip(experiment.recordings, backwards(turned).recordings, strict=True):
        assert once.start == pytest.approx(again.start)
        np.testing.assert_array_equal(once.inputs, again.inputs)
        np.testing.assert_array_equal(once.extras["force"], again.extras["force"])


@pytest.mark.parametrize("size", [200, 201])
def test_random_phases_keep_mean_and_spectrum_and_nothing_else(size):
    rng = np.random.default_rng(0)
    signal = -3.0 + np.cumsum(rng.normal(size=size))
    drawn = phase_randomised(signal, rng)
    np.testing.assert_allclose(np.abs(np.fft.rfft(drawn))[:-1], np.abs(np.fft.rfft(signal))[:-1], rtol=1e-9)
    assert drawn.mean() == pytest.approx(signal.mean())
    assert abs(np.corrcoef(drawn, signal)[0, 1]) < 0.9


@COMPILED
def test_two_causes_are_each_needed():
    effects = Creep(modulus=50e3, time=20.0), PermittivityDrift(relative_change=-0.08, time=60.0)
    problem = bench_of(*effects, seed=2)
    base, answer = fitted_with(problem), fitted_with(problem, *effects)
    one = fitted_with(problem, effects[1])
    found = verify(base, answer, np.random.default_rng(0), problem, (base, one))
    assert found.holds, found.failures
    assert [a.effect for a in found.ablations] == ["creep", "permittivity_drift"]
    # Without creep it is the candidate that was given; without the drift it was fitted here, a special case of both.
    assert found.ablations[0].unseen == pytest.approx(np.sqrt(np.mean(one.unseen**2)))
    assert answer.calibration.rms < found.ablations[1].fitted < base.calibration.rms
    assert found.ablations[1].unseen > found.unseen_after + found.ablations[1].gain_low > found.unseen_after
    assert {(s.effect, s.kind) for s in found.shams} == {(e.name, kind) for e in effects for kind in PlaceboKind}
    assert [t.part for t in found.transfers][2:] == ["lowest amplitudes", "middle amplitudes", "highest amplitudes"]
    assert len(found.transfers) == 5
    assert [c.effect for c in found.constancies] == ["creep", "permittivity_drift"]
    assert not any(t.worse for t in found.transfers)
    # The bounds hold the gain, and what the parts leave is what the whole leaves.
    for t in found.transfers:
        assert t.gain_low <= t.before - t.after <= t.gain_high
    thirds = [t.after**2 for t in found.transfers[2:]]
    assert np.mean(thirds) == pytest.approx(found.unseen_after**2, rel=0.05)


@COMPILED
@pytest.mark.parametrize(("growth", "refuted"), [(0.0, False), (0.02, True)])
def test_a_delay_that_grows_is_none_though_it_grows_by_less_than_itself(growth, refuted):
    """By 20 ms beside a mean of 40 ms: most of what a constant one leaves."""
    problem = late_readings(0.04, growth, seed=5)
    base, answer = fitted_with(problem), fitted_with(problem, Delay(time=0.04))
    found = verify(base, answer, np.random.default_rng(0), problem)
    assert answer.adequate is not refuted
    (constancy,) = found.constancies
    assert constancy.mends is refuted
    assert any("delay" in failure and "most of the remaining error" in failure for failure in found.failures) is refuted
    assert (found.whole is not None) is refuted  # the fit that constancy was told from is at hand
    if refuted:
        assert found.whole.residuals.size == sum(part.size for part in problem.everything)
        # relative to the fitted delay, to which the film's own parameters add or take some
        fitted = answer.calibration.plant.parameters["delay.time"].value
        assert constancy.change * fitted == pytest.approx(growth, rel=0.25)
        assert abs(constancy.change) < 1.0


@COMPILED
def test_an_effect_that_is_not_there_does_not_hold():
    problem = bench_of(seed=3)
    base, answer = fitted_with(problem), fitted_with(problem, Creep(modulus=5e3, time=20.0))
    found = verify(base, answer, np.random.default_rng(0), problem)
    assert not found.holds
    assert "it is not certain that the explanation lowers the error on held-out data" in found.failures


def bursts(size: float, blocks: int, bad: int) -> np.ndarray:
    """Residuals of 2 µm, in blocks of fifty samples, the first of which are larger."""
    scale = np.where(np.arange(blocks) < bad, size, 2e-6)
    return np.repeat(scale, 50) * np.tile([1.0, -1.0], 25 * blocks)


def with_bursts(size: float, fitted: int, unseen: int) -> Candidate:
    """An explanation that is bad in some of 90 blocks of the fitted part, and of 36 of the unseen one."""
    plant = SimpleNamespace(rig=SimpleNamespace(model_error=1.2e-6, output_unit="m"))
    calibration = SimpleNamespace(plant=plant, residuals=bursts(size, 90, fitted), rms=2e-6, names=("a",))
    return Candidate(effects=(), calibration=calibration, unseen=bursts(size, 36, unseen), noise=2e-6)


# One block of 36: 10² - 2² = 96 over 36 are 2.7 in mean square, more than 1.2² = 1.44; 6² - 2² = 32 are 0.9.
@pytest.mark.parametrize(("size", "fitted", "returns"), [(10e-6, 12, True), (6e-6, 12, False), (10e-6, 0, False)])
def test_what_acts_in_bursts_returns_if_both_parts_are_certain_of_it(size, fitted, returns):
    without, amended = with_bursts(size, fitted, 1), with_bursts(2e-6, 0, 0)
    found = _ablation("amplifier_slew", without, amended, without, np.random.default_rng(0))
    assert found.gain_low == 0.0  # some draws have none of the one block
    assert found.returns is returns
    whole = verify(without, amended, np.random.default_rng(0))  # what is said of an effect is said of the whole
    assert whole.gain_low == 0.0
    assert whole.holds is whole.counts is returns
    # of a large mismatch that it shares with what it is compared with it takes little: 2.7 of 25 in mean square
    alike = [replace(c, unseen=c.unseen + 5e-6 * np.tile([1.0, 1.0, -1.0, -1.0], 450)) for c in (without, amended)]
    assert not verify(*alike, np.random.default_rng(0)).counts


@pytest.mark.parametrize(
    ("adequate", "everywhere", "fits", "refuted"),
    [
        (False, {"mends": True, "change": 0.3}, True, True),
        (False, {"mends": True, "change": 0.3}, False, False),  # there is no fit to everything
        (False, {"mends": False, "change": 3.0}, True, False),  # what was fitted says enough of that
        (False, {"mends": True, "change": 0.05}, True, False),
        (True, {"mends": True, "change": 0.3}, True, False),
    ],
)
def test_what_would_have_to_change_is_asked_of_all_recordings_where_too_much_is_left(
    monkeypatch, adequate, everywhere, fits, refuted
):
    fit, whole = SimpleNamespace(), SimpleNamespace(rms=3.0)
    steady = Constancy(effect="delay", own=0.5, change=0.1, deviation=0.01)
    moving = Constancy(effect="delay", own=0.5, deviation=0.01, **everywhere)
    asked = []

    def found(of, parts, effects, too_much=None):
        asked.append(too_much)
        return (steady,) if of is fit else (moving,)

    monkeypatch.setattr(MODULE, "constancies", found)
    monkeypatch.setattr(MODULE, "refit", lambda *_: whole if fits else fit)
    amended = SimpleNamespace(calibration=fit, effects=("delay",), adequate=adequate, noise=1.0)
    problem = SimpleNamespace(fitted=(), everything=())
    (constancy,) = _constancies(amended, problem, _whole(amended, problem))
    assert constancy is (moving if refuted else steady)
    assert constancy.holds is not refuted
    assert asked[1:] == ([pytest.approx(np.sqrt(8.0))] if fits and not adequate else [])  # 3² less the noise's 1²


def test_less_than_noise_is_nothing_that_a_change_could_mend(monkeypatch):
    steady, asked = (Constancy(effect="delay", own=0.01),), []
    monkeypatch.setattr(MODULE, "constancies", lambda *_, too_much=None: asked.append(too_much) or steady)
    monkeypatch.setattr(MODULE, "refit", lambda *_: SimpleNamespace(rms=1.0))
    amended = SimpleNamespace(calibration=None, effects=("delay",), adequate=False, noise=1.1)
    problem = SimpleNamespace(fitted=(), everything=())
    assert _constancies(amended, problem, _whole(amended, problem)) == steady
    assert asked == [None, pytest.approx(np.sqrt(0.1) * 1.1)]  # a tenth of the noise's power is known of no sensor


def test_the_share_of_an_effect_is_what_returns_without_it():
    def candidate(*effects: str, mean_square: float) -> Candidate:
        residual = np.sqrt(mean_square) * np.tile([1.0, -1.0], 400)
        fit = replace(fit_of_nothing(), residuals=residual, names=("a",))
        return Candidate(effects=effects, calibration=fit, unseen=residual, noise=2.0)

    def fit_of_nothing():
        return calibrate(NOMINAL, bench_of(seed=3).fitted, names=("damping",), evaluations=1, starts=1)

    base, one = candidate(mean_square=104.0), candidate("creep", mean_square=24.0)
    both = candidate("creep", "delay", mean_square=4.0)
    # 100 is missing above the noise's 4; without delay 20 of it return, and without creep, never tried, all 100.
    shares = shares_explained(base, both, (base, one), 2.0)
    assert shares == {"creep": pytest.approx(1.0), "delay": pytest.approx(0.2)}
