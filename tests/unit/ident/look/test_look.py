"""A look at recordings whose contents are known from how they were made."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import chirp, lfilter, sawtooth, square

from deatwin.ident.look import look_at
from deatwin.ident.look.inputs import InputShape, pattern_of
from deatwin.ident.look.link import LinkStatus, links_of
from deatwin.ident.narx.excited import excitation
from deatwin.ident.narx.preprocess import FindingKind, choose_sampling
from deatwin.plant import DataError, ModelError, Recording

STEP = 0.01
TIMES = STEP * np.arange(2000)


def coloured(rng: np.random.Generator, n: int, pole: float = 0.9) -> np.ndarray:
    return np.asarray(lfilter([1.0 - pole], [1.0, -pole], rng.normal(size=n + 200))[200:])


RNG = np.random.default_rng(0)
TWO = np.where(RNG.random(200) > 0.5, 1.0, -1.0).repeat(10)
HOLDS = RNG.uniform(0.0, 3.0, 40).repeat(50)
SIGNALS = {
    "constant": (np.ones(100), InputShape.CONSTANT, 0),
    "two levels": (TWO, InputShape.TWO_LEVEL, 0),
    "two levels, measured": (TWO + 0.01 * RNG.normal(size=2000), InputShape.TWO_LEVEL, 0),
    "square wave": (square(2 * np.pi * 0.5 * TIMES), InputShape.TWO_LEVEL, 10),
    "repeated two-level noise": (np.tile(TWO[:630], 3), InputShape.TWO_LEVEL, 3),
    "holds": (HOLDS, InputShape.STEPS, 0),
    "holds, measured": (HOLDS + 0.005 * RNG.normal(size=2000), InputShape.STEPS, 0),
    "staircase": (np.tile(np.repeat([0.0, 1, 2, 3, 2, 1], 50), 6), InputShape.STEPS, 6),
    "triangle": (sawtooth(2 * np.pi * 0.25 * TIMES, 0.5), InputShape.RAMPS, 5),
    "triangle, measured": (sawtooth(2 * np.pi * 0.25 * TIMES, 0.5) + 1e-3 * RNG.normal(size=2000), InputShape.RAMPS, 5),
    "tone": (np.sin(2 * np.pi * 1.3 * TIMES), InputShape.TONES, 26),
    "tone that grows": (TIMES * np.sin(2 * np.pi * TIMES), InputShape.TONES, 0),
    "white noise": (RNG.normal(size=2000), InputShape.NOISE, 0),
    "coloured noise": (coloured(RNG, 2000, 0.99), InputShape.NOISE, 0),
    "repeated noise": (np.tile(coloured(RNG, 400), 5), InputShape.NOISE, 5),
    "random walk": (np.cumsum(RNG.normal(size=2000)), InputShape.NOISE, 0),
    "chirp": (chirp(TIMES, 0.1, 20.0, 10.0), InputShape.NOISE, 0),
    "four samples": (np.array([0.0, 1.0, 0.0, 1.0]), InputShape.SHORT, 0),
}


@pytest.mark.parametrize("name", SIGNALS)
def test_shape_and_periods_of_an_input(name: str) -> None:
    values, shape, periods = SIGNALS[name]
    found = pattern_of("u", values, STEP)
    assert (found.shape, found.periods) == (shape, periods)
    if periods:
        assert found.period_s == pytest.approx(STEP * values.size / periods, rel=2e-3)


def test_levels_and_holds() -> None:
    found = pattern_of("u", HOLDS, STEP)
    assert found.levels == 40
    assert found.hold_s == pytest.approx(0.5)
    assert str(found) == "steps between levels that are held, 40 levels, each held for 0.5 s (median)"


def late(rng: np.random.Generator, n: int = 1500, delay: int = 7, noise: float = 0.02) -> Recording:
    """First order behind seven samples, white noise of known size, readings in mm."""
    u = coloured(rng, n, 0.7)
    y = np.concatenate([np.zeros(delay), lfilter([0.2], [1.0, -0.8], u)[:-delay]]) + noise * rng.normal(size=n)
    return Recording.from_arrays(u, 1e-3 * y, STEP)


def test_link_dead_time_and_noise() -> None:
    found = look_at(late(np.random.default_rng(1)))
    (link,) = found.links
    assert link.status is LinkStatus.LINKED
    assert link.dead_time is not None and link.dead_time.interval is not None
    assert link.dead_time.interval[0] <= 7 <= link.dead_time.interval[1]
    assert link.in_band is not None and link.in_band > 0.5
    reading = next(channel for channel in found.channels if channel.role == "output")
    # "At most": of 2e-5 m; the motion that reaches the top of the spectrum, where the plant lets a ninth through, adds.
    assert reading.noise is not None and 2e-5 < reading.noise < 4e-5


def test_pieces_with_different_clocks_are_refused() -> None:
    one = late(np.random.default_rng(1))
    for pieces in ([one, replace(one, sample_time=2 * STEP)], [one, replace(one, output_units=("V",))]):
        for used in (look_at, choose_sampling):
            with pytest.raises(ModelError, match="need the same inputs, outputs, units and sample time"):
                used(pieces)


def test_an_even_plant_is_linked_by_the_square() -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        u = coloured(rng, 1000, 0.5)
        y = lfilter([0.2], [1.0, -0.8], u**2) + 0.01 * rng.normal(size=1000)
        assert look_at(Recording.from_arrays(u, y, STEP)).links[0].status is LinkStatus.EVEN


@pytest.mark.parametrize("period", [6.37, 100.0])
def test_a_tone_is_linked_to_what_follows_it_and_to_nothing_else(period: float) -> None:
    rng, u = np.random.default_rng(12), np.sin(2 * np.pi * np.arange(4000) / period)
    noise = rng.normal(size=u.size)
    wanted = {
        LinkStatus.LINKED: lfilter([0.2], [1.0, -0.8], u) + 0.01 * noise,
        LinkStatus.EVEN: u**2 + 0.01 * noise,
        LinkStatus.UNSEEN: noise,
    }
    for status, y in wanted.items():
        record = Recording.from_arrays(u, y, STEP)
        assert links_of([record], [excitation(record)])[0].status is status
    walk = Recording.from_arrays(u, np.cumsum(noise), STEP)
    assert links_of([walk], [excitation(walk)])[0].status is LinkStatus.UNSEEN


def test_a_tone_of_fewer_cycles_than_tell_it_from_a_drift_is_called_slow() -> None:
    u = np.sin(2 * np.pi * np.arange(4000) / 3000)
    record = Recording.from_arrays(u, np.random.default_rng(13).normal(size=4000), STEP)
    assert links_of([record], [excitation(record)])[0].status is LinkStatus.SLOW


def test_nothing_is_linked_by_chance() -> None:
    """Of 1600 pairs of independent signals, white to a pole of 0.99, coherence called one linked; here none of 12."""
    for seed in range(12):
        rng = np.random.default_rng(seed)
        record = Recording.from_arrays(coloured(rng, 1000), coloured(rng, 1000), STEP)
        (link,) = links_of([record], [excitation(record)])
        assert link.in_band is not None and link.in_band < link.chance


def test_faults_are_found_where_they_were_put() -> None:
    record = late(np.random.default_rng(3))
    y = record.outputs[0].copy()
    y[500] += 1e-3
    y[1000:1100] = y[1000]
    high = np.quantile(y, 0.98)
    found = look_at(Recording.from_arrays(record.inputs[0], np.minimum(y, high), STEP))
    at = {finding.kind: finding for finding in found.findings}
    assert at[FindingKind.CLIPPING].size == pytest.approx(high)
    assert (at[FindingKind.CONSTANT].from_s, at[FindingKind.CONSTANT].to_s) == pytest.approx((10.0, 10.99))


def test_steps_of_readings_are_told_and_bound_the_noise() -> None:
    record = late(np.random.default_rng(4), noise=0.0)
    found = look_at(Recording.from_arrays(record.inputs[0], np.round(record.outputs[0] / 1e-4) * 1e-4, STEP))
    reading = found.channels[1]
    assert reading.step == pytest.approx(1e-4)
    assert reading.noise is not None and reading.noise >= 1e-4 / np.sqrt(12.0) * (1.0 - 1e-9)


def test_pieces_between_gaps_are_one_look() -> None:
    record = late(np.random.default_rng(5))
    found = look_at([record.section(0, 500), record.section(1000, 1500)])
    assert found.n_samples == 1000
    assert found.gaps == (pytest.approx((5.0, 10.0)),)
    assert "1 gap, the longest 5 s" in found.clock


@pytest.mark.parametrize("n", [1, 2, 5, 17, 63, 130])
@pytest.mark.parametrize("kind", ["noise", "constant input", "constant output", "ramp"])
def test_any_length_is_looked_at(n: int, kind: str) -> None:
    rng = np.random.default_rng(n)
    u = np.zeros(n) if kind == "constant input" else np.arange(n) * 1.0 if kind == "ramp" else rng.normal(size=n)
    y = np.zeros(n) if kind == "constant output" else rng.normal(size=n)
    found = look_at(Recording.from_arrays(u, y, STEP))
    json.dumps(found.to_dict(), allow_nan=False)
    assert str(found)
    if "constant" in kind:
        assert found.links[0].status is LinkStatus.STILL


def test_several_inputs_and_outputs() -> None:
    rng = np.random.default_rng(6)
    u = np.stack([coloured(rng, 1000), coloured(rng, 1000)])
    y = np.stack([lfilter([0.2], [1.0, -0.8], u[0]), lfilter([0.2], [1.0, -0.8], u[1])])
    record = Recording.from_arrays(u, y + 0.001 * rng.normal(size=y.shape), STEP)
    told = {(link.input_name, link.output_name): link.status for link in look_at(record).links}
    assert told == {
        ("input_1", "output_1"): LinkStatus.LINKED,
        ("input_1", "output_2"): LinkStatus.UNSEEN,
        ("input_2", "output_1"): LinkStatus.UNSEEN,
        ("input_2", "output_2"): LinkStatus.LINKED,
    }


def test_a_look_draws_itself() -> None:
    from matplotlib.figure import Figure

    panels = look_at(late(np.random.default_rng(7))).plot(list(Figure().subplots(3, 1)))
    assert [panel.get_ylabel() for panel in panels] == ["command (V)", "displacement (µm)", "coherence of the output"]


def test_without_an_output_there_is_nothing_to_look_at() -> None:
    with pytest.raises(DataError, match="an input and an output"):
        look_at(Recording.from_arrays(np.ones(5), np.zeros((0, 5)), STEP))


def test_a_look_names_further_readings_of_which_values_are_missing() -> None:
    rng = np.random.default_rng(3)
    command, motion, current = rng.standard_normal((3, 400))
    current[10:30] = np.nan
    one = Recording.from_arrays(command, motion, 0.02, extras={"current": current})
    channel = look_at([one]).channels[2]
    assert (channel.name, channel.role, channel.unit) == ("current", "extra", "A")
    assert channel.high == np.nanmax(current)


@pytest.mark.parametrize("mark", [-9.999, 32.767])
def test_equal_readings_far_outside_all_others_are_asked_for(mark: float) -> None:
    rng = np.random.default_rng(4)
    command, displacement = coloured(rng, 500), 1e-3 * coloured(rng, 500)
    marked = np.where(np.isin(np.arange(500), [50, 51, 300]), mark, displacement)
    for readings, times in ((marked, 1), (displacement, 0), (np.round(displacement, 4), 0)):
        lines = look_at(Recording.from_arrays(command, readings, STEP)).lines
        assert sum(f"3 readings are {mark} m, far outside all others" in line for line in lines) == times
        assert times or not any("far outside" in line for line in lines)
