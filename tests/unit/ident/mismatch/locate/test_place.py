"""Places at which something was concealed in the reduced plant, and what the closure test says of noise."""

from dataclasses import replace

import numpy as np
import pytest
from made_fits import made_problem
from needs import COMPILED
from runs import blank

from deatwin.ident.greybox import Part, calibrate
from deatwin.ident.greybox.filter import Opening, linearise
from deatwin.ident.mismatch.locate.closure import closure_p_value, regressions
from deatwin.ident.mismatch.locate.place import OpenedPlace, Places, locate_place
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.plant import CoulombFriction, Creep, Diaphragm, Hysteresis, Plant, SensorDrift
from deatwin.plant.effects.amplifier_slew import AmplifierSlew
from deatwin.plant.effects.base import Effect
from deatwin.plant.excitation import band_limited_noise

pytestmark = COMPILED
NOISE = 2e-6


def placed(effect: Effect, seed: int) -> Places:
    """Places of the base plant, calibrated on a minute of noise by a plant with an effect."""
    command = band_limited_noise(np.random.default_rng(100 + seed), 60.0, 0.02)
    truth = Plant(rig=Diaphragm()).with_values({"shear_modulus": 27e3, "permittivity": 4.3}).with_effects(effect)
    part = Part.whole(truth.record(blank(command), np.random.default_rng(seed)))
    nominal = Plant(rig=Diaphragm())
    base = Candidate(effects=(), calibration=calibrate(nominal, [part], starts=1), unseen=np.empty(0), noise=NOISE)
    return locate_place(
        base, made_problem(nominal=nominal, fitted=(part,), everything=(part,)), np.random.default_rng(0)
    )


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


def test_the_figure_has_the_shares_of_the_summary_and_calls_the_moving_part_as_the_rig_does():
    """Of readings with much noise, a regression that predicts the whole mismatch predicts a part of the residual."""
    told = {"gain": 40.0, "p_value": 1e-6, "explained": 0.63, "score": 0.99, "among_best": True}
    found = Places(
        opened=(OpenedPlace(place="ball", signal="velocity", **told),), closure_p_value=0.01, body="moving part"
    )
    axes = found.plot()
    (bar,) = axes.patches
    assert bar.get_width() == found.summary[0].explained == 0.99
    assert [label.get_text() for label in axes.get_yticklabels()] == ["moving part: velocity"]


@pytest.mark.study
def test_how_often_the_place_is_among_the_best():
    effects = [*CONCEALED.items(), ("ball", weaker(CoulombFriction()))]
    hits = [place in placed(effect, seed).among_best for place, effect in effects for seed in range(4)]
    # one input and one output: film, ball and sensor are found, what is large and sits at the drive often is not
    assert np.mean(hits) >= 0.7


def test_noise_is_not_taken_for_a_function_of_the_signals():
    rng = np.random.default_rng(5)
    command = band_limited_noise(rng, 12.0, 0.02)
    plant = Plant(rig=Diaphragm())
    (linear,) = linearise(plant, [Part.whole(blank(command))], [Opening(place="sensor", signal="reading")])
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
