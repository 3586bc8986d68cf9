"""Odds of two effects over one whose law errs, on readings that are linear in the strengths of effects."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.special import logsumexp
from scipy.stats import cauchy, norm

from deatwin.ident.mismatch.likelihood.beforehand import AMPLITUDE, FAST, TIMING, pair_odds
from deatwin.ident.mismatch.likelihood.structured import law
from deatwin.ident.mismatch.naming.screen import LinearisedResponse
from deatwin.ident.mismatch.naming.weigh import OTHER, Scale
from deatwin.ident.mismatch.thresholds import STRONG
from deatwin.plant.effects.catalogue import effect_named

TIMES = 0.02 * np.arange(1500)
NOISE = 2e-6
MOTION = 2e-4 * np.sin(2.0 * np.pi * TIMES)
EFFECTS = tuple(effect_named(name) for name in ("creep", "sensor_drift", "delay"))
FIRST, SECOND = EFFECTS[:2]
CREPT = 2e-5 * np.exp(-((TIMES - 10.0) ** 2))  # what the first effect does at its typical strength
LATER = np.exp(-((TIMES - 15.0) ** 2))  # as slow, but nothing that another law of the first would do
LATER -= (laws := law(CREPT, TIMES, np.zeros(TIMES.size))) @ (laws.T @ LATER)
LATER /= np.sqrt(np.mean(LATER**2))
SIZE = np.sqrt(np.mean(CREPT**2))
FAST_TONE = np.sqrt(2.0) * np.sin(2.0 * np.pi * 9.0 * TIMES)  # faster than anything that the first one does


@pytest.fixture
def problem():
    part = SimpleNamespace(timepts=TIMES, size=TIMES.size, measured=MOTION, reading="", level=np.ones(TIMES.size))
    nominal = SimpleNamespace(
        rig=SimpleNamespace(sample_time=0.02, sizes=None), parameters={}, accepts=lambda effect: False
    )
    return SimpleNamespace(everywhere=EFFECTS, effects=EFFECTS, fitted=(part,), nominal=nominal, expected_error=5e-7)


@pytest.fixture
def scale(problem):
    return over_nothing(problem)


def over_nothing(problem):
    """The likelihood whose base plant is exact."""
    left = np.zeros(sum(part.size for part in problem.fitted))
    base = SimpleNamespace(calibration=SimpleNamespace(residuals=left, plant=problem.nominal))
    return Scale(problem=problem, base=base, noise=NOISE)


def strength(effect):
    return next(p for p in effect.parameters if p.name == f"{effect.name}.{effect.strength}")


def fitted(left, *effects):
    """The strengths of effects, each with what it does at its typical one, fitted to what they leave at that."""
    columns = np.column_stack([does / strength(effect).value for effect, does in effects])
    off = np.linalg.lstsq(columns, left, rcond=None)[0]
    names = [strength(effect).name for effect, _ in effects]
    values = {name: strength(e).value + float(o) for name, (e, _), o in zip(names, effects, off, strict=True)}
    parameters = {
        name: SimpleNamespace(name=name, scale=strength(e).scale, value=values[name])
        for name, (e, _) in zip(names, effects, strict=True)
    }
    own = tuple(effect.name for effect, _ in effects)
    plant = SimpleNamespace(
        parameters=parameters, event_times=(), effect_names=own, lacks=lambda effect: effect.name not in own
    )
    calibration = SimpleNamespace(
        plant=plant, names=tuple(names), residuals=left - columns @ off, jacobian=columns, at_bound=()
    )
    return SimpleNamespace(
        effects=own, calibration=calibration, contribution=columns @ np.array(list(values.values())), log_share=0.0
    )


def odds(scale, missed, rng):
    """Of the two over the first one, which is there and misses so much along the second, in its own rms."""
    left = NOISE * rng.standard_normal(TIMES.size)
    along = SIZE * LATER
    alone = fitted(left + missed * along, (FIRST, CREPT))
    return scale.of_two(fitted(left + missed * along, (FIRST, CREPT), (SECOND, along)), alone)


def test_an_error_of_the_law_is_seldom_a_second_effect(scale):
    """Where the first one errs as laws do, odds of 20 for two come once in twenty (Markov), times those beforehand."""
    rng = np.random.default_rng(3)
    found = [odds(scale, OTHER * rng.standard_normal(), rng) for _ in range(15)]
    assert sum(o > STRONG for o in found) == 0


def test_what_is_far_more_than_an_error_of_the_law_is_a_second_effect(scale):
    rng = np.random.default_rng(4)
    assert min(odds(scale, 20.0 * OTHER, rng) for _ in range(5)) > STRONG


@pytest.mark.parametrize(
    ("missed", "cost"), [(20.0 * OTHER, 0.0), (0.0, 1.0)], ids=["an error or an effect", "neither"]
)
def test_a_shape_that_is_fitted_costs_an_error_of_the_law_as_much_as_an_effect(scale, missed, cost):
    """An unknown time constant that the readings show to a fortieth of its prior deviation lowers the evidence by ln 40:
    both that of a second effect and that of an error of its shape, so the odds of the two stay. If neither is there, the
    law is exact, and the odds of a second effect fall by as much.
    """
    slower = 40.0 * NOISE / np.sqrt(TIMES.size) * np.sqrt(2.0) * np.cos(2.0 * np.pi * 11.0 * TIMES)
    noise = NOISE * np.random.default_rng(12).standard_normal(TIMES.size)
    left = noise - slower * (slower @ noise) / (slower @ slower) + missed * SIZE * LATER  # the fit gains nothing by it
    alone, pair = fitted(left, (FIRST, CREPT)), fitted(left, (FIRST, CREPT), (SECOND, SIZE * LATER))
    time = next(p for p in SECOND.parameters if p.name == "sensor_drift.time")
    fit, plant = pair.calibration, pair.calibration.plant
    shaped = SimpleNamespace(**{**vars(plant), "parameters": {**plant.parameters, time.name: time}})
    more = {"plant": shaped, "names": (*fit.names, time.name), "jacobian": np.column_stack([fit.jacobian, slower])}
    free = SimpleNamespace(**{**vars(pair), "calibration": SimpleNamespace(**{**vars(fit), **more})})
    known, found = scale.of_two(pair, alone), scale.of_two(free, alone)
    assert found == pytest.approx(known - cost * np.log(40.0), abs=1.0)


def test_no_error_of_a_slow_law_is_fast(scale):
    """An error as errors of laws are explains what is slow, as the first effect is, but nothing where that one does
    nothing: there, a tone of 0.3 of the noise makes a second effect e^(1500 * 0.3^2 / 2) times as likely.
    """
    strong, rng = 10.0 * CREPT, np.random.default_rng(8)
    size = OTHER * np.sqrt(np.mean(strong**2))
    assert size == pytest.approx(0.3 * NOISE, rel=0.05)
    found = []
    for shape in (LATER, FAST_TONE):
        left = NOISE * rng.standard_normal(TIMES.size) + size * shape
        pair = fitted(left, (FIRST, strong), (SECOND, size * shape))
        found.append(scale.of_two(pair, fitted(left, (FIRST, strong))))
    assert found[0] < STRONG
    assert found[1] > 0.5 * 1500 * 0.3**2 / 2  # noise and fast errors of unknown size explain some of it


def test_no_error_of_a_law_comes_before_its_effect(scale):
    """An error as errors of laws are explains what comes after an effect has begun. Before that, the odds are at least
    those over an exact law, and at most twice these, since an exact law has half of the prior probability.
    """
    rng, strong = np.random.default_rng(9), 10.0 * CREPT * (TIMES > 10.0)
    assert OTHER * np.sqrt(np.mean(strong**2)) == pytest.approx(0.2 * NOISE, rel=0.1)
    left = NOISE * rng.standard_normal(TIMES.size)
    found, over_exact = [], []
    for middle in (15.0, 5.0):
        bump = np.exp(-((TIMES - middle) ** 2))
        bump = 0.3 * NOISE * bump / np.sqrt(np.mean(bump**2))
        alone, pair = fitted(left + bump, (FIRST, strong)), fitted(left + bump, (FIRST, strong), (SECOND, bump))
        found.append(scale.of_two(pair, alone))
        over_exact.append(scale.weight(pair) - scale.weight(alone) + pair_odds(len(EFFECTS)))
    assert min(over_exact) > STRONG > found[0]
    assert 0.0 <= found[1] - over_exact[1] <= np.log(2.0)


def test_what_is_fast_in_another_reading_does_not_make_a_law_fast(problem):
    """A film that creeps changes a current as fast as the voltage, but its position slowly, whatever else is read."""
    (part,) = problem.fitted
    second = SimpleNamespace(**{**vars(part), "reading": "current", "weight": 1.0, "measured": 1e-4 * FAST_TONE})
    problem.nominal.rig.further = (SimpleNamespace(name="current", noise=NOISE, model_error=5e-7),)
    problem.nominal.rig.share_of_motion = 0.0
    problem.fitted = (part, second)
    scale, rng = over_nothing(problem), np.random.default_rng(8)
    strong = np.concatenate([10.0 * CREPT, 1e-4 * FAST_TONE])
    tone = 0.3 * NOISE * np.concatenate([FAST_TONE, np.zeros(TIMES.size)])
    left = NOISE * rng.standard_normal(2 * TIMES.size) + tone
    pair = fitted(left, (FIRST, strong), (SECOND, tone))
    assert scale.of_two(pair, fitted(left, (FIRST, strong))) > 0.5 * 1500 * 0.3**2 / 2


def test_pairs_are_compared_with_the_same_single_effect(scale):
    """The odds of two pairs over one effect are apart by what the recordings say of the pairs: odds multiply."""
    rng = np.random.default_rng(7)
    along, beside = SIZE * LATER, SIZE * np.roll(LATER, 75)
    left = NOISE * rng.standard_normal(TIMES.size) + 10.0 * OTHER * along
    alone = fitted(left, (FIRST, CREPT))
    right, wrong = (fitted(left, (FIRST, CREPT), (SECOND, does)) for does in (along, beside))
    odds = [scale.of_two(pair, alone, (right, wrong)) for pair in (right, wrong)]
    assert odds[0] - odds[1] == pytest.approx(scale.weight(right) - scale.weight(wrong), rel=1e-9)
    assert odds[1] < scale.of_two(wrong, alone)


def test_of_two_that_do_nothing_the_odds_are_at_most_those_beforehand(scale):
    rng = np.random.default_rng(5)
    assert np.mean([odds(scale, 0.0, rng) for _ in range(10)]) < pair_odds(3)


@pytest.mark.parametrize("alike", [True, False], ids=["motion of the base plant", "another motion"])
@pytest.mark.parametrize("late", [0.1, 1.0], ids=["a tenth of a sample", "a sample"])
def test_a_delay_is_a_second_effect_if_no_timing_error_is_as_long(scale, late, alike):
    """A fit without the delay is far off. The odds are those of a lateness by the delay's prior over one by the prior of
    a timing error; if both motions are alike, the base plant's timing error adds to either.
    """
    delay, rng = EFFECTS[2], np.random.default_rng(11)
    late, own, typical = 0.02 * late, TIMING * 0.02, AMPLITUDE * strength(delay).value
    slope = np.gradient(MOTION, TIMES) if alike else 3e-3 * FAST_TONE
    noise, missed = NOISE * rng.standard_normal(TIMES.size), 3.0 * NOISE * np.sin(2.0 * np.pi * 13.0 * TIMES)
    alone = fitted(noise + missed, (FIRST, CREPT))
    pair = fitted(
        noise + (strength(delay).value - late) * slope, (FIRST, CREPT), (delay, -strength(delay).value * slope)
    )
    delays = np.linspace(0.0, 0.1, 20001)
    law = 2.0 * cauchy(scale=typical).pdf(delays)
    pairs, timing = np.interp(late, delays, law), norm(0.0, own).pdf(late)
    if alike:
        pairs = trapezoid(law * norm(0.0, own).pdf(late - delays), delays)
        timing = norm(0.0, np.sqrt(2.0) * own).pdf(late)
    expected = np.log(pairs / timing) + np.log(2.0) + pair_odds(3)
    assert scale.of_two(pair, alone) == pytest.approx(expected, abs=0.7)
    assert (expected > STRONG) == (late > 0.01)
    assert scale.of_two(pair, alone) == scale.of_two(pair, alone, (pair,))
    beside = fitted(noise, (FIRST, CREPT), (SECOND, CREPT[::-1]))
    assert scale.of_two(beside, alone, (pair,)) < scale.of_two(beside, alone)


@pytest.mark.parametrize("shape", [LATER, FAST_TONE])
def test_first_order_promises_what_a_fit_then_shows(scale, shape):
    """The readings are linear: what is promised beside the first one is the evidence that the pair then has."""
    rng = np.random.default_rng(6)
    missed = 0.5e-6 * shape
    left = NOISE * rng.standard_normal(TIMES.size) + missed
    typical = strength(SECOND).value
    alone, pair = fitted(left, (FIRST, CREPT)), fitted(left, (FIRST, CREPT), (SECOND, missed))
    known = [LinearisedResponse(effect=SECOND, change=missed / typical)]
    promised = scale.promises(alone, known)["sensor_drift"]
    assert promised == pytest.approx(scale.of_two(pair, alone), rel=0.15)
    assert "creep" not in scale.promises(alone, [LinearisedResponse(effect=FIRST, change=CREPT)])


def test_what_is_promised_near_even_odds_is_on_average_what_a_fit_shows(scale):
    """Where an error of the law may be all, too: an exact law and an inexact one are equally likely there as here.

    A fit also learns how large noise and fast errors are, which costs it less than a nat.
    """
    typical, shape, over = strength(SECOND).value, 0.5e-6 * LATER, []
    for seed in range(12):
        left = NOISE * np.random.default_rng(seed).standard_normal(TIMES.size) + 0.6 * shape
        alone, pair = fitted(left, (FIRST, CREPT)), fitted(left, (FIRST, CREPT), (SECOND, shape))
        known = [LinearisedResponse(effect=SECOND, change=shape / typical)]
        over.append(scale.promises(alone, known)["sensor_drift"] - scale.of_two(pair, alone))
    assert abs(np.mean(over)) < 1.0


def test_the_error_is_that_of_the_base_plant_as_it_moves(scale):
    assert np.array_equal(scale.error.readings, MOTION)
    assert scale.error.of[0].ratio == pytest.approx(FAST * 5e-7 / NOISE)


def test_beyond_a_bound_nothing_is_likely(scale):
    """A share that the data want beyond 1: the evidence is that of the shares up to 1, summed on a fine grid."""
    rng, lag = np.random.default_rng(9), effect_named("electrode_rc")
    own = {p.name: p for p in lag.parameters}
    share, rate = own["electrode_rc.film_share"], own["electrode_rc.time"]
    fast, slow = (6e-6 * np.sin(2.0 * np.pi * f * TIMES) for f in (9.0, 4.0))
    left = NOISE * rng.standard_normal(TIMES.size) + 0.2 * fast  # of a share of 1.2, fitted with 1
    columns = np.column_stack([slow / rate.value, fast])
    near = over_nothing(SimpleNamespace(**{**vars(scale.problem), "everywhere": (lag,)}))

    def weight(name, value, names, at_bound=()):
        held = {rate.name: rate, share.name: replace(share, value=value)}
        plant = SimpleNamespace(parameters=held, event_times=(), effect_names=("electrode_rc",))
        residuals, jacobian = left - (value - 1.0) * fast, columns[:, : len(names)]
        fit = dict(plant=plant, names=names, residuals=residuals, jacobian=jacobian, at_bound=at_bound)
        return near.weight(SimpleNamespace(effects=(name,), calibration=SimpleNamespace(**fit), log_share=0.0))

    found = weight("fit", 1.0, (rate.name, share.name), (share.name,))
    values = np.linspace(0.98, 1.0, 21)  # at 0.98 the evidence is already e^-24 of that at 1
    each = [weight(f"share {value}", value, (rate.name,)) for value in values]
    prior = norm(0.5, 1.0 / np.sqrt(12.0))
    densities = prior.logpdf(values) - np.log(prior.cdf(1.0) - prior.cdf(0.0))
    exact = np.log(trapezoid(np.exp(each + densities - max(each)), values)) + max(each)
    assert found == pytest.approx(exact, abs=1.0)


@pytest.mark.parametrize("pause", [0.0, 3600.0])
def test_when_an_event_came_costs_what_a_sum_over_all_samples_says(problem, pause):
    """A jump of six times the noise is seen to a sample: its evidence is the mean of those at each sample, whatever time
    passes between two experiments.
    """
    (part,), halves = problem.fitted, (slice(0, 750), slice(750, 1500))
    problem.fitted = tuple(
        SimpleNamespace(
            **{**vars(part), "timepts": TIMES[h] + k * pause, "size": 750, "measured": MOTION[h], "level": np.ones(750)}
        )
        for k, h in enumerate(halves)
    )
    scale, rng, jump = (over_nothing(problem), np.random.default_rng(10), effect_named("sensor_jump"))
    strength, when = (next(p for p in jump.parameters if p.name == f"sensor_jump.{n}") for n in ("change", "at"))
    near = over_nothing(SimpleNamespace(**{**vars(scale.problem), "everywhere": (jump,)}))
    noise = NOISE * rng.standard_normal(TIMES.size)

    def weight(at, event):
        held = {strength.name: replace(strength, value=6.0 * NOISE), when.name: replace(when, value=TIMES[at])}
        events = (when.name,) if event else ()
        plant = SimpleNamespace(parameters=held, event_times=events, effect_names=("sensor_jump",))
        names = (strength.name, when.name) if event else (strength.name,)
        step = (np.arange(TIMES.size) >= at).astype(float)
        left = noise + 6.0 * NOISE * ((np.arange(TIMES.size) >= 700) - step)
        columns = np.column_stack([step, np.zeros(TIMES.size)])[:, : len(names)]
        fit = SimpleNamespace(plant=plant, names=names, residuals=left, jacobian=columns, at_bound=())
        return near.weight(SimpleNamespace(effects=(f"{at} {event}",), calibration=fit, log_share=0.0))

    each = np.array([weight(at, False) for at in range(690, 711)])  # elsewhere it is e^-100 of that
    best = 690 + int(np.argmax(each))
    assert weight(best, True) == pytest.approx(logsumexp(each) - np.log(TIMES.size), abs=1.0)
