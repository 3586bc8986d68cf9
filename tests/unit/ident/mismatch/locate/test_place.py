"""Places at which something was concealed in the reduced plant, and what the closure test says of noise."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.greybox import Part, calibrate
from deatwin.ident.greybox.filter import Opening, linearise
from deatwin.ident.mismatch.locate.closure import closure_p_value, regressions
from deatwin.ident.mismatch.locate.place import OpenedPlace, Places, locate_place
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.plant import CoulombFriction, Creep, Diaphragm, Experiment, Hysteresis, Plant, Recording, SensorDrift
from deatwin.plant.effects.amplifier_slew import AmplifierSlew
from deatwin.plant.effects.base import Effect
from deatwin.plant.excitation import band_limited_noise
from deatwin.plant.integrator.compiled import compiler

pytestmark = pytest.mark.skipif(
    compiler() is None, reason="many fits: without a C compiler they take ten times as long"
)
NOISE = 2e-6


def placed(effect: Effect, seed: int) -> Places:
    """Places of the base plant, calibrated on a minute of noise by a plant with an effect."""
    command = band_limited_noise(np.random.default_rng(100 + seed), 60.0, 0.02)
    blank = Experiment(recordings=(Recording.from_arrays(command, np.zeros_like(command), 0.02),))
    truth = Plant(rig=Diaphragm()).with_values({"shear_modulus": 27e3, "permittivity": 4.3}).with_effects(effect)
    part = Part.whole(truth.record(blank, np.random.default_rng(seed)))
    nominal = Plant(rig=Diaphragm())
    base = Candidate(effects=(), calibration=calibrate(nominal, [part], starts=1), unseen=np.empty(0), noise=NOISE)
    problem = DiagnosisProblem(
        nominal=nominal,
        effects=(),
        fitted=(part,),
        unseen=(),
        everything=(part,),
        jobs=1,
        stated_error=1e-6,
        expected_error=1e-6,
    )
    return locate_place(base, problem, np.random.default_rng(0))


def weaker(effect: Effect) -> Effect:
    return replace(effect, **{effect.strength: 0.4 * getattr(effect, effect.strength)})


CONCEALED = {
    "film": weaker(Creep()),
    "sensor": weaker(SensorDrift()),
    "ball": weaker(Hysteresis()),
    "drive": AmplifierSlew(),
}


@pytest.mark.parametrize("place", ["film", "sensor", "ball"])
def test_the_place_is_among_the_best(place):
    found = placed(CONCEALED[place], 0)
    assert found.repeatable
    assert place in found.among_best
    table = found.summary
    assert [row.place for row in table] == list(dict.fromkeys(o.place for o in found.opened))
    assert all(0.0 <= row.score <= 1.0 for row in table)
    assert found.plot().get_xlabel()


def test_a_prediction_is_the_same_share_of_the_mismatch_in_the_summary_and_in_the_figure():
    """Of readings with much noise, a regression that predicts the whole mismatch predicts a part of the residual."""
    opened = OpenedPlace(
        place="film", signal="stress", gain=40.0, p_value=1e-6, explained=0.63, score=0.99, among_best=True
    )
    found = Places(opened=(opened,), closure_p_value=0.01)
    (bar,) = found.plot().patches
    assert bar.get_width() == found.summary[0].explained == 0.99


def test_the_figure_calls_the_moving_part_as_the_rig_does():
    opened = OpenedPlace(
        place="ball", signal="velocity", gain=4.0, p_value=0.01, explained=0.6, score=0.7, among_best=True
    )
    ax = Places(opened=(opened,), closure_p_value=0.01, body="moving part").plot()
    assert [label.get_text() for label in ax.get_yticklabels()] == ["moving part: velocity"]


@pytest.mark.study
def test_how_often_the_place_is_among_the_best():
    effects = [*CONCEALED.items(), ("ball", weaker(CoulombFriction()))]
    hits = [place in placed(effect, seed).among_best for place, effect in effects for seed in range(4)]
    # one input and one output: film, ball and sensor are found, what is large and sits at the drive often is not
    assert np.mean(hits) >= 0.7


def test_noise_is_not_taken_for_a_function_of_the_signals():
    rng = np.random.default_rng(5)
    command = band_limited_noise(rng, 20.0, 0.02)
    plant = Plant(rig=Diaphragm())
    blank = Experiment(recordings=(Recording.from_arrays(command, np.zeros_like(command), 0.02),))
    (linear,) = linearise(plant, [Part.whole(blank)], [Opening(place="sensor", signal="reading")])
    (problem,) = regressions([linear])
    count = 0
    for draw in range(40):
        white = rng.standard_normal(problem.residual.size)
        # every second residual is correlated over ten samples
        slow = np.convolve(white, np.exp(-np.arange(50) / 10), mode="same")
        residual = NOISE * (slow if draw % 2 else white)
        count += closure_p_value([replace(problem, residual=residual)], rng) <= 0.05
    # two of 40 expected; seven or more has a chance of 0.5 %
    assert count <= 6
