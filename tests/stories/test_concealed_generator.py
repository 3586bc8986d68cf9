"""The generator of concealed cases, against SUNDIALS, closed forms and its own specification."""

from __future__ import annotations

import ast
import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from deatwin.ident.discrepancy import VARIABLES
from deatwin.plant import Diaphragm, Experiment, Plant, Recording
from deatwin.plant.effects import catalogue
from deatwin.plant.errors import SimulationError
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.records import plain
from deatwin.plant.rigs.base import ReadingTime
from deatwin.scenarios.concealed_physics.cases import (
    DIRT,
    KEY,
    LADDER,
    OUTSIDE,
    TERM_NAMES,
    TIES,
    case_specs,
    pairable,
)
from deatwin.scenarios.concealed_physics.generator import mechanism, mechanisms
from deatwin.scenarios.concealed_physics.generator.mechanism import Drive, Reading, Setting
from deatwin.scenarios.concealed_physics.generator.mechanisms import (
    MECHANISMS,
    BristleFriction,
    HardClip,
    PowerLawCreep,
    StopOperators,
    TransportDelay,
)
from deatwin.scenarios.concealed_physics.generator.specimens import (
    FILM_ERROR,
    Apparatus,
    CaseSpec,
    Rigging,
    SensorNoise,
    drawn_rig,
    make,
)

STEP = 0.02
SILENT = SensorNoise(rms=0.0, coloured=0.0, pole=0.0, step=0.0)


def silent(commands, start=0.0):
    record = Recording.from_arrays(commands, np.zeros(commands.size), STEP, start=start)
    return Experiment(recordings=(record,))


def thesis_noise(seconds, seed=0):
    return band_limited_noise(np.random.default_rng(seed), seconds, STEP)


def apparatus(*concealed, before=(), rig=None):
    plant = Plant(rig=rig or Diaphragm(ball="bonded"))
    return Apparatus(plant=plant, mechanisms=concealed, before=before, noise=SILENT, seed=1)


def test_pull_in_is_an_error_that_says_when():
    with pytest.raises(SimulationError, match=r"lost at .* s"):
        apparatus().readings(silent(np.full(50, 12.0)))


class Workbench:
    """Takes one mechanism's equations, with numbers for its parameters and a velocity that the test prescribes."""

    def __init__(self, mechanism):
        self._values = {p.name: p.value for p in mechanism.parameters}
        self.velocity, self.states, self.rates = ca.SX.sym("velocity"), [], {}
        self.force = mechanism.rewrite(ca.SX(0), self)

    def own(self, name):
        return ca.SX(self._values[name])

    def signal(self, name):
        return {"velocity": self.velocity}[name]

    def state(self, name, *, scale, start=None):
        self.states.append(ca.SX.sym(name))
        return self.states[-1]

    def rate(self, state, value, *, mass=1.0):
        self.rates[state.name()] = value / mass

    def run(self, velocity, timepts):
        """Forces along a prescribed motion."""
        x = ca.vertcat(*self.states)
        rate = ca.Function("rate", [x, self.velocity], [ca.vertcat(*(self.rates[s.name()] for s in self.states))])
        force = ca.Function("force", [x, self.velocity], [self.force])
        found = solve_ivp(
            lambda t, x: np.asarray(rate(x, velocity(t))).ravel(),
            (timepts[0], timepts[-1]),
            np.zeros(x.numel()),
            method="LSODA",
            t_eval=timepts,
            rtol=1e-6,
            atol=1e-9,
            max_step=2e-3,
        )
        return np.array([float(force(x, velocity(t))) for x, t in zip(found.y.T, timepts, strict=True)])


@pytest.mark.parametrize("velocity", [-5e-3, 2e-4, 2e-3])
def test_bristles_that_slip_steadily_hold_as_the_stribeck_curve_says(velocity):
    bench = Workbench(BristleFriction(force=1e-3, bend=2e-6))
    last = bench.run(lambda t: velocity, np.linspace(0.0, 0.5, 20))[-1]
    curve = 1e-3 * (1 + 0.25 * np.exp(-((velocity / 1e-3) ** 2)))
    assert last == pytest.approx(-np.sign(velocity) * curve, rel=1e-3)


def test_the_loop_of_stop_operators_has_the_area_of_prandtl_and_ishlinskii():
    r"""A stop of threshold r and yield force f loses 4 f (A - r) in a cycle of amplitude A > r, and none of A < r."""
    force, widest, amplitude, omega = 1e-3, 80e-6, 50e-6, 2 * np.pi
    timepts = np.linspace(0.0, 3.0, 3001)
    held = Workbench(StopOperators(force=force, widest=widest)).run(
        lambda t: amplitude * omega * np.cos(omega * t), timepts
    )
    cycle = timepts >= 2.0
    position = amplitude * np.sin(omega * timepts)
    work = -np.trapezoid(held[cycle], position[cycle])
    thresholds = widest * np.array(StopOperators.ratios)
    area = sum(4 * force / 5 * (amplitude - r) for r in thresholds if r < amplitude)
    # The last twentieth before slipping is rounded: the loop cannot be wrong by more.
    assert work == pytest.approx(area, rel=0.05)


def test_a_delay_of_whole_samples_is_the_exact_shift():
    wave = thesis_noise(4.0)
    shifted = np.concatenate([np.full(2, wave[0]), wave[:-2]])
    # Both hold their first command long before.
    late = apparatus(TransportDelay(time=2 * STEP)).readings(silent(wave))[0]
    exact = apparatus().readings(silent(shifted))[0]
    assert np.abs(late - exact)[50:].max() < 0.03e-6
    assert np.abs(apparatus().readings(silent(wave))[0] - exact)[50:].max() > 1e-6


def test_a_hard_clip_passes_what_is_below_it_and_stops_what_is_above():
    drive = Drive(times=np.arange(4.0), commands=np.array([1.0, 2.0, 3.0, -3.0]))
    clip = HardClip(depth=0.25, top=3.0, bottom=1.0)
    assert clip.commanded(drive, np.random.default_rng(0)).commands.tolist() == [1.0, 2.0, 2.5, -2.5]


@pytest.mark.parametrize("name", sorted(n for n, kind in MECHANISMS.items() if not hasattr(kind, "rewrite")))
def test_without_strength_nothing_happens_to_command_and_reading(name):
    timepts = STEP * np.arange(500)
    setting = Setting(seconds=10.0, commands=thesis_noise(10.0), displacement=1e-4 + 1e-4 * np.sin(timepts) ** 2)
    nothing = MECHANISMS[name].drawn(np.random.default_rng(3), setting).sized(0.0)
    drive = Drive(times=timepts, commands=setting.commands)
    reading = Reading(times=timepts, values=setting.displacement, commands=setting.commands)
    acted = nothing.commanded(drive, np.random.default_rng(0))
    # A delayed drive says once more what was there before.
    assert np.allclose(acted.commands[-500:], drive.commands, rtol=0, atol=1e-12)
    assert np.allclose(acted.times[-500:], drive.times, rtol=0, atol=1e-12)
    assert np.allclose(nothing.read(reading, np.random.default_rng(0)), reading.values, rtol=0, atol=1e-15)


def test_ordinary_imperfections_have_the_size_that_the_key_states():
    """Of a motion of 0.2 mm with a velocity of 2 mm/s rms; the wander is averaged over 200 recordings."""
    timepts = STEP * np.arange(3000)
    motion, speed = 2e-4 * np.sin(10 * np.sqrt(2) * timepts), 2e-3
    setting = Setting(seconds=60.0, commands=motion, displacement=motion)
    reading, rng = Reading(times=timepts, values=motion, commands=motion), np.random.default_rng(8)

    def rms(name):
        drawn = (MECHANISMS[name].drawn(rng, setting).read(reading, rng) - motion for _ in range(200))
        return np.sqrt(np.mean(np.concatenate(list(drawn)) ** 2))

    # 200 independent records of about one correlation time: 5 % standard error; four of them
    assert rms("thermal_wander") == pytest.approx(0.3e-6, rel=0.2)
    assert rms("unsteady_gain") == pytest.approx(0.01 * 2e-4 / np.sqrt(2), rel=0.2)
    # to first order in 2 ms; the second order adds (10 sqrt(2) 2 ms)^2 / 4 of it
    assert rms("timing_jitter") == pytest.approx(2e-3 * speed, rel=0.01)


def test_creep_remembers_what_nobody_told_the_experimenter():
    wave, told = thesis_noise(2.0), PowerLawCreep(modulus=30e3, exponent=0.1, fastest=3.0)
    change = []
    for concealed in ((), (told,)):
        runs = [
            apparatus(*concealed, before=before).readings(silent(wave))[0]
            for before in ((), ((2.0, 30.0), (0.0, 20.0)))
        ]
        change.append(np.abs(runs[1] - runs[0]).max())
    # A branch of 0.6 s has forgotten after 20 s; elements of 3 to 96 s have not.
    assert change[0] < 0.03e-6 < 0.3e-6 < change[1]


def test_noise_has_the_size_the_colour_and_the_steps_that_it_says():
    noise = SensorNoise(rms=2e-6, coloured=0.4, pole=0.8, step=1.5e-6)
    n = 200_000
    motion = 1e-4 * np.sin(0.01 * np.arange(n))
    read = noise.added(motion, np.random.default_rng(5))
    added = read - motion
    # Standard errors: 1/sqrt(2n) times the correlation's stretch, about 2, so 0.3 %; four of them.
    assert added.std() == pytest.approx(2e-6, rel=0.013)
    random = 2e-6**2 - 1.5e-6**2 / 12
    for lag in (1, 3):
        wanted = random * 0.4 * 0.8**lag
        assert np.mean(added[lag:] * added[:-lag]) == pytest.approx(wanted, abs=4 * 2 * 4e-12 / np.sqrt(n))
    assert np.allclose(read / noise.step, np.round(read / noise.step), atol=1e-6)


def test_the_film_is_wrong_by_at_most_a_fifth_and_the_rig_as_described():
    for seed in range(20):
        rigging = drawn_rig(np.random.default_rng(seed))
        nominal, actual = rigging.nominal, rigging.actual
        for name in nominal.parameters.free:
            if name != "zero":
                assert abs(actual.parameters[name].value / nominal.parameters[name].value - 1) <= FILM_ERROR
        for name in ("mass", "gain", "thickness"):
            assert actual.parameters[name].value == nominal.parameters[name].value
        assert nominal.rig.resolution == "reduced" and actual.rig.resolution == "fine"
        assert actual.rig.ball == nominal.rig.ball or not nominal.rig.ball_is_known


def test_rigs_of_the_tiny_study_share_their_equations_and_else_are_what_was_drawn():
    for seed in range(5):
        drawn = drawn_rig(np.random.default_rng(seed))
        usual = drawn_rig(np.random.default_rng(seed), usual=True)
        for before, after in zip(_plants(drawn), _plants(usual), strict=True):
            assert dict(after.values) == dict(before.values) and after.rig.resolution == before.rig.resolution
            assert after.rig.mass == before.rig.mass and after.rig.thickness == before.rig.thickness
            assert after.rig.ball == "sliding" and after.rig.ball_is_known
            assert after.rig.reading is ReadingTime.END_OF_HOLD
    assert {spec.form for spec in case_specs("tiny", 1)} == {"usual"}
    assert {spec.form for spec in case_specs("standard", 1)} == {"drawn"}


def _plants(rigging: Rigging) -> tuple[Plant, ...]:
    return rigging.nominal, rigging.actual, rigging.reduced


KNOCK = CaseSpec(
    name="knock",
    kind="effect",
    effects=("knocked_sensor",),
    truth=("sensor_jump",),
    target_ratio=0.9,
    seed=77,
    excitation="noise",
    noise_share=0.03,
)


@pytest.fixture(scope="module")
def knocked():
    return make(KNOCK, seconds=24.0, check_seconds=6.0)


def test_a_specimen_reaches_its_ratio(knocked):
    """The ratio once more, by a refit of another kind: linear, with derivatives by finite differences."""
    clean = replace(knocked.apparatus, mechanisms=()).readings(knocked.whole)[0]
    change = knocked.apparatus.readings(knocked.whole)[0] - clean
    rig = replace(knocked.apparatus.plant.rig, resolution="reduced")
    base, experiment = knocked.apparatus.plant.with_rig(rig), knocked.experiments[0]
    columns = []
    for name in base.parameters.free:
        value = base.parameters[name].value
        step = 1e-3 * value if value else 1e-6
        moved = [base.with_values({name: value + side * step}).simulate(experiment).outputs[0][0] for side in (1, -1)]
        columns.append((moved[0] - moved[1]) / np.ptp(moved[0] - moved[1] + 1e-12 * np.arange(moved[0].size)))
    slopes = np.stack(columns, axis=1)
    left = change - slopes @ np.linalg.lstsq(slopes, change, rcond=1e-10)[0]
    ratio = float(np.sqrt(np.mean(left**2))) / knocked.noise
    assert ratio == pytest.approx(KNOCK.target_ratio, rel=0.25)
    assert knocked.ratio == pytest.approx(KNOCK.target_ratio, rel=0.25)
    assert knocked.ratio == pytest.approx(ratio, rel=0.1)


def test_a_specimen_is_what_the_diagnosis_may_see(knocked):
    (record,) = knocked.experiments[0].recordings
    (check,) = knocked.check.recordings
    assert record.n_samples == 1200 and check.start == pytest.approx(record.end)
    assert knocked.plant.effect_names == () and knocked.plant.rig.noise == knocked.noise
    assert knocked.noise == pytest.approx(0.03 * np.std(record.outputs), rel=0.1)
    added = record.outputs[0] - knocked.apparatus.readings(knocked.whole)[0]
    # White and coloured noise of 1200 samples: its rms scatters by some 4 %.
    assert added.std() == pytest.approx(knocked.noise, rel=0.15)
    assert [m.name for m in knocked.apparatus.mechanisms] == ["knocked_sensor"] and knocked.truth == ("sensor_jump",)


def test_the_same_case_is_the_same_bytes_and_another_run_has_other_noise(knocked):
    again = make(replace(KNOCK), seconds=24.0, check_seconds=6.0)
    for one, two in zip(again.whole.recordings, knocked.whole.recordings, strict=True):
        assert one.outputs.tobytes() == two.outputs.tobytes() and one.inputs.tobytes() == two.inputs.tobytes()
    advised = silent(thesis_noise(4.0, seed=9))
    first, second = (knocked.record(advised, seed).recordings[0].outputs[0] for seed in (0, 1))
    assert first.tobytes() == knocked.record(advised, 0).recordings[0].outputs[0].tobytes()
    # Two runs of one apparatus differ by their noise alone.
    assert (first - second).std() == pytest.approx(np.sqrt(2) * knocked.noise, rel=0.3)
    # An advised record has commands only, and neither readings nor names of them.
    unread = np.empty((0, advised.recordings[0].n_samples))
    bare = replace(advised.recordings[0], outputs=unread, output_names=(), output_units=())
    made = knocked.record(Experiment(recordings=(bare,)), 0).recordings[0]
    assert made.outputs[0].tobytes() == first.tobytes()
    assert (made.output_names, made.output_units) == (("displacement",), ("m",))


def test_the_key_has_every_effect_of_the_catalogue_once_and_nothing_twice():
    first = Counter(names[0] for names in KEY.values())
    assert first == Counter(e.name for e in catalogue()), "key.toml needs a form of each effect: see CONTRIBUTING.md"
    assert sorted([*KEY, *OUTSIDE, *DIRT]) == sorted(MECHANISMS)
    assert all(set(names) <= {e.name for e in catalogue()} for names in KEY.values())
    assert all(KEY[mechanism][0] in names for _, names, mechanism, _ in TIES)


def test_mechanisms_share_no_code_with_the_catalogue():
    trees = [ast.parse(Path(module.__file__).read_text(encoding="utf-8")) for module in (mechanism, mechanisms)]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    imported = [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
    ours = {module for module in imported if module.startswith("deatwin.")}
    allowed = {"deatwin.plant.effects.base", "deatwin.plant.parameters", "deatwin.plant.errors", mechanism.__name__}
    assert "deatwin.plant.effects.base" in ours and ours <= allowed


def test_what_commands_of_one_polarity_do_not_show_has_both_or_is_in_no_pair():
    for seed in (1, 2, 3):
        shifted = [spec for spec in case_specs("standard", seed) if "ground_shift" in spec.effects]
        assert {spec.excitation for spec in shifted} == {"both_polarities"}
        assert {spec.kind for spec in shifted} == {"effect", "pair"}
        long = [spec for spec in case_specs("long", seed) if "ground_shift" in spec.effects]
        assert {(spec.kind, spec.excitation) for spec in long} == {("effect", "noise+holds")}
    assert any("ground_shift" in pair for pair in pairable())


def test_each_of_a_pair_with_a_ground_shift_is_seen():
    spec = next(s for s in case_specs("standard", 1) if s.kind == "pair" and "ground_shift" in s.effects)
    ratios = make(spec, seconds=24.0, check_seconds=2.0).ratios.values()
    assert min(ratios) >= 0.7  # of the noise, after a refit, as for every pair


def test_the_standard_study_has_the_cases_that_were_asked_for():
    specs = case_specs("standard", 1)
    kinds = Counter(spec.kind for spec in specs)
    assert kinds == {"clean": 150, "dirt": 30, "effect": 9 * len(KEY), "outside": 40, "pair": 40, "tie": 24}
    assert len({spec.name for spec in specs}) == len({spec.seed for spec in specs}) == len(specs)
    for name in KEY:
        ladder = [s.target_ratio for s in specs if s.kind == "effect" and s.effects == (name,)]
        assert sorted(ladder) == sorted(LADDER)
    families = {e.name: e.family for e in catalogue()}
    for pair in (s for s in specs if s.kind == "pair"):
        assert pair.effects in pairable() and len({families[t] for t in pair.truth}) == 2
        assert pair.target_ratio >= 0.7
    assert all(set(s.truth) < set(s.rivals) and not s.rich for s in specs if s.kind == "tie")
    assert all(0.01 <= s.noise_share <= 0.05 for s in specs)
    assert len(case_specs("tiny", 1)) == 12 and len(case_specs("full", 1)) == 2 * len(specs)
    assert all(json.loads(json.dumps(plain(s))) == plain(s) for s in specs)


def test_each_record_has_the_waveform_that_its_place_in_the_excitation_says():
    spec = CaseSpec(
        name="a", kind="clean", effects=(), truth=(), target_ratio=0.0, seed=3, excitation="noise+holds", records=2
    )
    noise, holds = (r.inputs[0] for r in make(spec, seconds=40.0, check_seconds=10.0).experiments[0].recordings)
    assert noise.size == holds.size == 20 * 50
    assert np.mean(np.diff(noise) == 0) < 0.05 < 0.9 < np.mean(np.diff(holds) == 0)  # holds last 100 samples or more


def test_studies_of_different_seeds_share_no_case():
    seeds = [{spec.seed for spec in case_specs(size, seed)} for size in ("tiny", "full") for seed in (0, 1, 2)]
    assert case_specs("full", 1) == case_specs("full", 1)
    assert not seeds[3] & seeds[4] and not seeds[4] & seeds[5] and not seeds[0] & seeds[4]


@pytest.mark.study
@pytest.mark.parametrize("name", sorted(n for n, kind in MECHANISMS.items() if hasattr(kind, "rewrite")))
def test_without_strength_nothing_happens_in_the_equations(name):
    experiment = silent(thesis_noise(3.0))
    clean = apparatus().readings(experiment)[0]
    commands = experiment.recordings[0].inputs[0]
    setting = Setting(seconds=3.0, commands=commands, displacement=clean)
    drawn = MECHANISMS[name].drawn(np.random.default_rng(1), setting)
    gone = drawn.sized(1e-9 * drawn.largest)
    assert np.abs(apparatus(gone).readings(experiment)[0] - clean).max() < 0.1e-6
    assert np.abs(apparatus(drawn).readings(experiment)[0] - clean).max() > 0.1e-6


def test_every_term_of_the_sparse_dynamics_stands_for_some_effect_of_the_catalogue():
    from pysindy import PolynomialLibrary

    monomials = PolynomialLibrary(degree=2).fit(np.zeros((2, len(VARIABLES)))).get_feature_names(list(VARIABLES))
    assert set(TERM_NAMES) == set(monomials)
    assert frozenset().union(*TERM_NAMES.values()) <= {effect.name for effect in catalogue()}
