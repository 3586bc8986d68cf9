"""The quarter of a car: a closed form, the integrator of others, and the page."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deatwin.app.stories import story
from deatwin.ident.mismatch import diagnose
from deatwin.plant import Experiment, Plant
from deatwin.plant.sources import load_plant
from deatwin.scenarios import your_own_rig
from deatwin.scenarios.your_own_rig.elsewhere import CAR, Car, drive
from deatwin.scenarios.your_own_rig.quarter_car import plant
from deatwin.scenarios.your_own_rig.roads import bumps, concealed, record, rough_road, unread
from deatwin.studies.folder import ResultFolder

STEP = plant().rig.sample_time
OTHERS = {"quadratic_damping", "coulomb_friction", "cubic_stiffness"}
"""The drag and some that could be taken for it; the story itself asks for the whole catalogue."""


def travel(car: Plant, road: np.ndarray) -> np.ndarray:
    return car.simulate(Experiment(recordings=(unread(road),))).require().outputs[0][0]


pytestmark = pytest.mark.usefixtures("uncompiled")


def test_a_slow_wave_has_the_response_of_two_masses():
    # Linear, 1 Hz: (k + c s) T = -m s² B for the body, tyre (road - W) = m s² B + w s² W for both, T = B - W.
    p = {name: q.value for name, q in plant().parameters.items()}
    s = 2j * np.pi
    strut = p["spring"] + p["damper"] * s
    body_of_wheel = strut / (strut + p["body"] * s**2)
    wheel = p["tyre"] / (p["tyre"] + (p["wheel"] + p["body"] * body_of_wheel) * s**2)
    timepts = STEP * np.arange(1, 1201)
    # A held sample is on average half a sample old: the mean of the road during it is what the tyre feels.
    road = 0.01 * np.sin(2 * np.pi * (timepts - STEP / 2))
    expected = 0.01 * np.imag((body_of_wheel - 1) * wheel * np.exp(s * timepts))
    last = slice(-100, None)
    assert np.abs(travel(plant(), road)[last] - expected[last]).max() < 2e-3 * np.abs(expected).max()


def test_both_integrators_move_the_same_car():
    road = bumps(STEP)[:300]  # the first bump
    elsewhere, speed, force = drive(CAR, road, STEP)
    assert np.abs(travel(concealed(), road) - elsewhere).max() < 0.01 * plant().rig.noise
    np.testing.assert_allclose(speed[1:-1], np.gradient(elsewhere, STEP)[1:-1], atol=0.1 * np.abs(speed).max())
    # Without the drag it is another motion, by far more than the noise.
    assert np.abs(drive(Car(orifice=0.0), road, STEP)[0] - elsewhere).max() > 10 * plant().rig.noise
    assert force[np.argmax(speed)] == pytest.approx(-CAR.orifice * speed.max() ** 2)


def test_the_user_s_file_is_a_plant_on_the_command_line_and_short(tmp_path, monkeypatch):
    source = Path(sys.modules[plant.__module__].__file__ or "").read_text(encoding="utf-8")
    assert len(source.splitlines()) <= 55
    (tmp_path / "a_car.py").write_text(source, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert load_plant("a_car:plant").plant.rig.kind == "quarter-car"


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    rng = np.random.default_rng(0)
    folder = ResultFolder(tmp_path_factory.mktemp("drives"))
    return record("elsewhere", folder, (rough_road(rng, STEP, 8.0), bumps(STEP)), rng)


@pytest.fixture(scope="module")
def diagnosis(driven):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEATWIN_COMPILER", "")
        some = [e for e in plant().rig.effects() if e.name in OTHERS]
        return diagnose(plant(), [Experiment(recordings=(driven.rough,))], effects=some, jobs=1, seed=0)


def test_the_drag_of_another_integrator_is_named(diagnosis):
    assert diagnosis.verdict.value == "named"
    assert [cause.effect for cause in diagnosis.causes] == ["quadratic_damping"]
    found = diagnosis.causes[0].parameters["coefficient"]
    assert found.unit == "N s2/m2" and found.low <= CAR.orifice <= found.high


def test_the_page_is_a_notebook_with_the_file(driven, diagnosis, setting, tmp_path, monkeypatch):
    monkeypatch.setattr(your_own_rig, "diagnosed", lambda *_: diagnosis)
    monkeypatch.setattr(your_own_rig, "DRIVERS", dict.fromkeys(("here", "elsewhere"), lambda *_: driven))
    result = story("your-own-rig").run(setting)
    assert [row["measure"] for row in result["measures"] if not row["passed"]] == []
    assert len(result["measures"]) == 9
    told = result["told"]["elsewhere"]
    assert told["amended_m"] < 1.1 * plant().rig.noise < 0.2 * told["base_m"]
    page = (tmp_path / "report.html").read_text(encoding="utf-8").replace("\xa0", " ")
    for words in ("Monday", "class QuarterCar(Rig):", "build.rate(body, up)", "figures/agreement.csv"):
        assert words in page
    written = (tmp_path / "quarter_car.py").read_text(encoding="utf-8")
    assert written == Path(sys.modules[plant.__module__].__file__ or "").read_text(encoding="utf-8")
    assert {file.stem for file in (tmp_path / "figures").glob("*.csv")} == {"agreement", "held_out", "residuals", "law"}


def test_a_page_that_finds_nothing_says_so(driven, setting, monkeypatch, diagnosis):
    blind = replace(diagnosis, causes=())
    monkeypatch.setattr(your_own_rig, "diagnosed", lambda *_: blind)
    monkeypatch.setattr(your_own_rig, "DRIVERS", dict.fromkeys(("here", "elsewhere"), lambda *_: driven))
    missed = [row["measure"] for row in story("your-own-rig").run(setting)["measures"] if not row["passed"]]
    assert len(missed) == 4 and all("documented" in measure or "drag" in measure for measure in missed)
