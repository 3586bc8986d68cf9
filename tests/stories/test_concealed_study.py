"""The study of concealed effects as it runs: an interruption, and a tiny study."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from concealed_study import opened_study
from runs import blank

from deatwin.app.cli import main
from deatwin.ident.greybox import Part, calibrate
from deatwin.plant import Delay, Diaphragm, Plant
from deatwin.plant.excitation import band_limited_noise
from deatwin.scenarios.concealed_physics import study as running

TINY_SEED = 1001


# --- running --------------------------------------------------------------------------------------------------------


def test_an_interrupted_study_keeps_what_is_done_and_repeats_nothing(tmp_path, monkeypatch):
    calls: list[str] = []
    told: list[tuple[float, str]] = []

    def fake(each: Any, *lengths: float) -> dict[str, Any]:
        if len(calls) == 5:
            calls.append("interrupt")
            raise KeyboardInterrupt
        calls.append(each.name)
        if each.kind == "pair":
            raise ValueError("a pair\nthat fails")
        return {"status": "done", "odd": float("nan")}

    monkeypatch.setattr(running, "examine", fake)
    with pytest.raises(KeyboardInterrupt):
        running.carry_out(tmp_path, "tiny", 2, 1, lambda *_: None)
    assert len(list((tmp_path / "cases").glob("*.nc"))) == 5
    store = running.carry_out(tmp_path, "tiny", 2, 1, lambda share, text: told.append((share, text)))
    names = [each.name for each in running.case_specs("tiny", 2)]
    assert sorted(c for c in calls if c != "interrupt") == sorted(names)
    assert store.missing(names) == []
    pair = store.get(next(name for name in names if name.startswith("pair")))
    assert (pair["status"], pair["message"]) == ("error", "ValueError: a pair that fails")
    assert store.get(next(name for name in names if name.startswith("clean")))["odd"] is None
    shares = [share for share, _ in told[1:]]
    assert shares == sorted(shares) and shares[0] > 0.1 and shares[-1] == pytest.approx(1.0)
    assert told[-1][1] == "case 12 of 12" and "left" in told[-2][1]


def test_an_interrupt_that_became_an_error_is_no_result(mistaken, monkeypatch):
    monkeypatch.setattr(running, "examine", mistaken)
    clean = next(each for each in running.case_specs("tiny", 2) if each.kind == "clean")
    with pytest.raises(KeyboardInterrupt):
        running.run_case("tiny", clean)


def test_a_case_is_diagnosed_and_compared_with_what_was_concealed(monkeypatch):
    """Two of the tiny study: what is concealed at 2.8 times the noise is named, and nothing where there is nothing."""
    specs = {each.name: each for each in running.case_specs("tiny", TINY_SEED)}
    for name, seconds, verdict, causes in (  # whole cases are for the study below
        ("quadratic-damping-01", 24.0, "named", ["quadratic_damping"]),
        ("clean-001", 12.0, "parameters", []),
    ):
        short = replace(running.SIZES["tiny"], seconds=seconds, check_seconds=6.0)
        monkeypatch.setattr(running, "SIZES", {"tiny": short})
        result = running.run_case("tiny", replace(specs[name], library=("creep", "quadratic_damping")))
        found = result["diagnosis"]
        assert (result["status"], found["verdict"]) == ("done", verdict)
        assert [cause["effect"] for cause in found["causes"]] == causes


@pytest.mark.study
def test_a_tiny_study_holds(tmp_path):
    command = ["scenario", "concealed-physics", "--size", "tiny", "--seed", str(TINY_SEED), "--jobs", "2", "--quiet"]
    assert main([*command, "--out", str(tmp_path)]) == 0
    result = json.loads((tmp_path / "concealed-physics.json").read_text(encoding="utf-8"))
    assert result["cases"] == 12
    assert result["failures"] == {}
    assert result["seal"] == json.loads((tmp_path / "seal.json").read_text(encoding="utf-8"))["hash"]
    assert result["seal"] in (tmp_path / "report.html").read_text(encoding="utf-8")
    alarms = next(g for g in result["goals"] if "false alarm" in g["measure"])
    assert (alarms["value"], alarms["count"]) == (0.0, 3)
    opened, _ = opened_study(tmp_path)
    assert not any(case.confidently_wrong for case in opened.cases)
    # What was concealed is found: cases of one effect have 2.8 times the noise. Of four at least two must hold it.
    assert sum(case.inside for case in opened.of("effect", ratio=0.5)) >= 2


def test_the_oracle_of_a_delay_begins_without_the_dead_time_of_the_base_plant():
    """A diagnosis may give its base plant a dead time; an effect can be in a plant only once."""
    rng = np.random.default_rng(12)
    nominal = Plant(rig=Diaphragm())
    command = band_limited_noise(rng, 20.0, 0.02)
    parts = [Part.whole(nominal.with_effects(Delay(time=0.06)).record(blank(command), rng))]
    base = calibrate(nominal.with_effects(Delay(time=0.003)), parts, starts=1)
    found = running._consulted(nominal, base, parts, ("delay",))
    assert found is not None and found.plant.effect_names == ("delay",)
    assert found.plant.parameters["delay.time"].value == pytest.approx(0.06, abs=0.002)  # a tenth of a sample
