"""The documents' tables of studies: made from the committed data, and from a folder of trials."""

import json
import shutil
from dataclasses import asdict
from pathlib import Path

import evidence
import pytest
from concealed_study import page_of
from markdown_tables import markdown_table
from measured import measured_blocks

from deatwin.app.stories import stories
from deatwin.plant.errors import DataError
from deatwin.scenarios.control_check.trials import Outcome, Trials
from deatwin.studies.public.black_boxes import LINEAR
from deatwin.studies.sweep.store import write_case

DOCS = Path(__file__).parents[3] / "docs"


def outcome(number: int, verdict: str, inside: float | None, sound: bool | None, concealed: str = "") -> Outcome:
    return Outcome(
        number=number,
        concealed=concealed,
        design="LQG",
        closed_loop_time=0.2,
        band_Hz=2.0,
        verdict=verdict,
        reason="a reason | with a bar",
        inside=inside,
        sound=sound,
        truth="overshoots by 2 µm",
    )


# Two passes of which one keeps its word, a broken limit that was caught, caution once of two, and no controller once.
TRIALS = [
    outcome(0, "pass", 1.0, True),
    outcome(1, "pass", 0.98, True, "creep"),
    outcome(2, "fail", None, False),
    outcome(3, "marginal", 1.0, True),
    outcome(4, "fail", None, None),
]


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """A folder as the scenario leaves it."""
    folder = tmp_path / "results"
    (folder / "trials").mkdir(parents=True)
    for one in reversed(TRIALS):
        put(folder, one)
    return folder


def put(folder: Path, one: Outcome, **changed: object) -> None:
    content = {"schema": "deatwin/control-trial/1", "seed": 9, "code": "c" * 64, **asdict(one), **changed}
    write_case(folder / "trials" / f"{one.number:03d}.nc", content)


@pytest.fixture
def docs(tmp_path: Path) -> Path:
    """A copy of the pages and their data."""
    shutil.copytree(DOCS / "data", tmp_path / "docs" / "data")
    for name in ("control-check.md", "validation.md", "concealed-physics.md", "concealed-physics-long.md"):
        shutil.copy(DOCS / name, tmp_path / "docs" / name)
    return tmp_path / "docs"


def test_the_committed_pages_are_what_their_data_give() -> None:
    for name, text in evidence.pages(DOCS).items():
        assert (DOCS / name).read_text(encoding="utf-8") == text, (
            f"docs/{name} is not what docs/data gives: python tests/tools/evidence.py docs"
        )


def test_every_block_that_is_made_is_shown_on_a_page() -> None:
    data = {name: json.loads((DOCS / "data" / f"{name}.json").read_text(encoding="utf-8")) for name in evidence.DATA}
    shown = {
        found[2]
        for name in ("control-check.md", "validation.md")
        for found in evidence.BLOCK.finditer((DOCS / name).read_text(encoding="utf-8"))
    }
    assert shown == set(evidence.blocks(data))


def test_a_folder_of_trials_becomes_data_and_pages(results: Path, docs: Path) -> None:
    evidence.main([str(docs), "--control-check", str(results), "--remark", "Run on a Sunday."])
    data = json.loads((docs / "data" / "control-check.json").read_text(encoding="utf-8"))
    assert (data["seed"], data["code"], data["remark"]) == (9, "c" * 64, "Run on a Sunday.")
    assert [Outcome(**row) for row in data["trials"]] == TRIALS
    page = (docs / "control-check.md").read_text(encoding="utf-8")
    assert "5 trials with seed 9 (hash of the sources: `cccccccccccc`). Run on a Sunday." in page
    assert "In 1 of the 5 trials, no controller could be designed" in page
    assert "at least 90 %) | 1 of 2, 50 % (95 % lower bound: 2 %) |" in page  # 1 - 0.95^(1/2) = 2.53 %, rounded down
    assert "the check rejected the design (goal: at least 90 %) | 1 of 1, 100 % (95 % lower bound: 5 %) |" in page
    assert "keep every limit on the true rig: the check rejected the design | 1 of 3, 33 % |" in page
    assert "| nothing | 4 | 1 | 1 of 1 | 1 of 1 | 1 of 2 |\n| creep | 1 | 1 | 0 of 1 | – | 0 of 1 |" in page
    summary = (docs / "validation.md").read_text(encoding="utf-8")
    assert "| [control check](control-check.md) | 5 | 1 of 2 |" in summary
    evidence.main([str(docs)])
    assert (docs / "control-check.md").read_text(encoding="utf-8") == page


def test_a_study_of_long_recordings_has_a_page_of_its_own(docs: Path, monkeypatch) -> None:
    usual = (docs / "data" / "concealed-physics.json").read_bytes()
    study = {**json.loads(usual), "size": "long", "seed": 5, "planned": 102, "done": 33}
    monkeypatch.setattr(evidence, "opened_study", lambda folder: (folder, None))
    monkeypatch.setattr(evidence, "score", lambda folder: [])
    monkeypatch.setattr(evidence, "page_data", lambda *_: study)
    monkeypatch.setattr(evidence, "summary", lambda folder: f"<svg>{folder}</svg>")
    evidence.main([str(docs), "--concealed-physics", "anywhere", "--remark", "Run on a Tuesday."])
    page = (docs / "concealed-physics-long.md").read_text(encoding="utf-8")
    assert page.startswith("# Concealed physics in long recordings: what the study reached\n")
    assert "interrupted after 33 of 102 cases" in page and "Run on a Tuesday." in page
    assert (docs / "concealed-physics-long.svg").read_text(encoding="utf-8") == "<svg>anywhere</svg>"
    assert (docs / "data" / "concealed-physics.json").read_bytes() == usual
    summary = (docs / "validation.md").read_text(encoding="utf-8")
    assert "| [concealed physics in long recordings](concealed-physics-long.md) | 33 of 102 |" in summary


STORY = {
    "measures": [
        {"measure": "tones", "demanded": "at least 5 times", "reached": "3.0 times", "passed": False},
        {"measure": "random rigs and designs that pass", "demanded": "90 %", "reached": "1 of 1", "passed": True},
    ],
    "tables": [
        {"title": f"about {name}", "columns": ["what", name], "rows": [[f"a {name}", "24"], ["other", "–"]]}
        for name in ("tracking", "fleet", "models", "concealed", "trials")
    ],
}


@pytest.fixture
def story(tmp_path: Path) -> Path:
    """A folder as the scenario leaves it, without its trials."""
    folder = tmp_path / "story"
    folder.mkdir()
    (folder / "control-check.json").write_text(json.dumps(STORY), encoding="utf-8")
    (folder / "run.json").write_text(json.dumps({"seed": 9, "versions": {"deatwin": "7.8"}}), encoding="utf-8")
    return folder


def test_a_story_becomes_data_and_its_tables_and_leaves_those_of_trials_alone(story: Path, docs: Path) -> None:
    trials = (docs / "data" / "control-check.json").read_bytes()
    evidence.main([str(docs), "--control-story", str(story), "--remark", "Run on a Monday."])
    assert (docs / "data" / "control-check.json").read_bytes() == trials
    page = (docs / "control-check.md").read_text(encoding="utf-8")
    assert page.count("story part, seed 9, deatwin 7.8). Run on a Monday. ") == 3
    assert "| tones | at least 5 times | 3.0 times | no |" in page
    assert "random rigs and designs that pass" not in page  # one of many trials, which have their own tables
    for name in ("tracking", "fleet", "models", "concealed"):
        assert f"| what | {name} |\n|---|---|\n| a {name} | 24 |\n| other | – |" in page
    assert "a trials" not in page
    evidence.main([str(docs)])
    assert (docs / "control-check.md").read_text(encoding="utf-8") == page


MISSED = {"measure": "smooth |H(f)|", "demanded": "below 1", "reached": "2", "passed": False}
SILVERBOX = {
    "verdict": "named",
    "causes": ["cubic_stiffness"],
    "measures": [{**MISSED, "passed": True}, MISSED],
    "held_out": {
        "The arrow-head": {
            "base": 0.25,
            "amended": 0.003,
            "black_boxes": {
                LINEAR: 0.0001,
                "NARX by FROLS, refitted to the free run": 0.002,
                "NARX built by Grow": None,
            },
        },
        "Another": {"base": 9.0, "amended": 9.0, "black_boxes": {}},
    },
}


@pytest.fixture
def scenarios(tmp_path: Path) -> Path:
    """A folder of folders as scenarios leave them, one of which is unknown and one of which has data of its own."""
    for name, result in (("silverbox", SILVERBOX), ("semp-fleet", {"measures": [MISSED]})):
        folder = tmp_path / "scenarios" / name
        folder.mkdir(parents=True)
        (folder / f"{name}.json").write_text(json.dumps(result), encoding="utf-8")
        (folder / "run.json").write_text(json.dumps({"seed": 9, "versions": {"deatwin": "7.8"}}), encoding="utf-8")
    for name in ("notes", "control-check"):
        (tmp_path / "scenarios" / name).mkdir()
    return tmp_path / "scenarios"


def kept(docs: Path, key: str) -> list[dict[str, object]]:
    """Rows of the data of scenarios."""
    return json.loads((docs / "data" / "scenarios.json").read_text(encoding="utf-8"))[key]


def test_what_scenarios_reached_becomes_data_and_tables_and_leaves_that_of_others(scenarios: Path, docs: Path) -> None:
    others = [row for row in kept(docs, "measures") if row["story"] not in ("silverbox", "semp-fleet")]
    assert others
    evidence.main([str(docs), "--scenarios", str(scenarios), "--remark", "commit 0123abc"])
    rows = kept(docs, "measures")
    assert [row for row in rows if row["story"] not in ("silverbox", "semp-fleet")] == others
    assert [row["passed"] for row in rows if row["story"] == "silverbox"] == [True, False]
    names = [row["story"] for row in kept(docs, "stories")]
    assert names == sorted(names, key=list(stories()).index) and len(set(names)) == len(names)
    page = (docs / "validation.md").read_text(encoding="utf-8")
    # The linear model is none of the black boxes, and the one whose run left counts for nothing.
    assert "| a cubic spring | cubic spring | cubic stiffness | open loop | 250 and 3.00 mV | 2.00 mV |" in page
    assert "| `silverbox` | 1 of 2 | seed 9, deatwin 7.8; commit 0123abc |" in page
    assert page.count("| `silverbox` | smooth ∣H(f)∣ | below 1 | 2 |") == 1  # among what was missed
    assert (
        page.count("| `semp-fleet` | smooth ∣H(f)∣ | below 1 | 2 | no |") == 1
    )  # among the NARX models, and only there
    assert page.count("| `semp-fleet` | smooth ∣H(f)∣ | below 1 | 2 |") == 1
    evidence.main([str(docs)])
    assert (docs / "validation.md").read_text(encoding="utf-8") == page


@pytest.mark.parametrize(
    ("amended", "verdict", "shown", "ahead"),
    [
        (0.001, "named", "cubic stiffness", 0),
        (0.001, "ambiguous", "ambiguous: cubic stiffness", 0),
        (0.003, "unknown", "unknown", 1),
    ],
)
def test_a_black_box_is_ahead_where_it_errs_less(amended: float, verdict: str, shown: str, ahead: int) -> None:
    errors = {**SILVERBOX["held_out"]["The arrow-head"], "recording": "The arrow-head", "amended": amended}
    row = {"story": "silverbox", "verdict": verdict, "causes": ["cubic_stiffness"], **errors}
    made = measured_blocks({"stories": [], "measures": [], "recordings": [row]})["recordings-of-others"]
    assert f"| {shown} | open loop | 250 and {1000 * amended:.2f} mV | 2.00 mV |" in made[2]
    assert (
        f"The best NARX model has a smaller error than the plant with the effect for {ahead} of the 1 data sets."
        in made[-1]
    )


def test_trials_of_two_runs_are_not_put_together(results: Path) -> None:
    put(results, outcome(5, "pass", 1.0, True), seed=10)
    with pytest.raises(DataError, match="its trials are of 2 seeds or codes"):
        evidence.trials_data(results)


def test_trials_are_read_as_the_scenario_writes_them(tmp_path: Path) -> None:
    stored = Trials(tmp_path, seed=9)
    for one in TRIALS:
        stored.put(f"{one.number:03d}", asdict(one))
    data = evidence.trials_data(tmp_path)
    assert [Outcome(**row) for row in data["trials"]] == TRIALS and data["seed"] == 9
    path = stored.path("002")
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(DataError, match=r"002\.nc: damaged or altered"):
        evidence.trials_data(tmp_path)


def test_a_table_writes_effects_in_words_and_the_page_of_a_study_tells_the_marks_apart_from_the_head(
    docs: Path,
) -> None:
    lines = markdown_table(
        ["effect", "code"], [["electrode_rc, sensor_drift_at_command_gain", "`electrode_rc` my_own"]]
    )
    assert lines[2] == "| electrode RC, drift of the amplifier's gain | `electrode_rc` my_own |"
    data = json.loads((docs / "data" / "concealed-physics.json").read_text(encoding="utf-8"))
    table = {
        "title": "Verdicts",
        "columns": ["cases", "named", "unknown"],
        "rows": [["one", "3", "0"], ["two", "0", "0"]],
    }
    legend = "result (✓ right, ½ in part, ✗ wrong, (✗) wrong beside others)"  # the last and ½ are not in the table
    marks = {"title": "Marks", "columns": ["case", legend], "rows": [["one", "0.3:✓ 1:✗"]]}
    page = page_of({**data, "tables": [table, marks]})
    assert "| cases | named |\n|---|---|\n| one | 3 |\n| two | 0 |\n" in page  # nothing is unknown
    assert "## Marks\n\nMarks in the column *result*: ✓ right, ✗ wrong.\n\n| case | result |\n" in page
    assert "| one | 0.3:\u2060✓ 1:\u2060✗ |" in page
