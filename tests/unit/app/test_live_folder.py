"""What the live view makes of its folder: names, what is listed, uploads, and verdicts side by side."""

import html
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rig_files
from made_diagnoses import DIAGNOSIS

from deatwin.app.cli import main
from deatwin.app.live import desk
from deatwin.app.live.desk import Desk, free_name, inside, keep_upload, safe_name
from deatwin.app.live.glance import glance
from deatwin.app.live.verdicts import Verdict, compare
from deatwin.ident.look import look_at
from deatwin.plant import load_plant
from deatwin.plant.errors import DataError, DeatwinError
from deatwin.plant.files import read_recordings
from deatwin.plant.readoptions import NO_OPTIONS, ReadOptions

ROWS = [f"{0.02 * k:.2f},{2 + 0.1 * (k % 7):.1f},0.3\n" for k in range(40)]
TABLE = "time_s,command_V,displacement_mm\n" + "".join(ROWS)


def write_result(folder: Path, recordings: dict[str, str] | None = None, **changed: Any) -> None:
    folder.mkdir(parents=True)
    (folder / "diagnosis.json").write_text(json.dumps({**DIAGNOSIS, **changed}), encoding="utf-8")
    if recordings is not None:
        inputs = [{"file": file, "sha256": 64 * digit} for file, digit in recordings.items()]
        (folder / "run.json").write_text(json.dumps({"inputs": inputs, "seconds": 12.5}), encoding="utf-8")


@pytest.fixture
def root(root):
    """The same, with a recording that can be read."""
    (root / "noise.csv").write_text(TABLE, encoding="utf-8")
    return root


# Names


@pytest.mark.parametrize(
    "name", ["../secret.csv", "sub/../../secret.csv", "/etc/hostname", "..", "leads/out.csv", "up/secret.csv"]
)
def test_a_name_that_leads_out_of_the_folder_is_refused(name, root):
    (root / "leads").mkdir()
    (root / "leads" / "out.csv").symlink_to(root.parent / "secret.csv")
    (root / "up").symlink_to(root.parent)
    with pytest.raises(DataError, match="lies outside of"):
        inside(root, name)


def test_a_name_with_a_null_is_refused(root):
    with pytest.raises(DataError, match="this cannot be the name of a file"):
        inside(root, "noise\0.csv")


def test_a_name_inside_is_its_path_also_where_the_folder_itself_is_a_link(root):
    (root.parent / "shortcut").symlink_to(root)
    assert inside(root, "noise.csv") == inside(root.parent / "shortcut", "sub/../noise.csv") == root / "noise.csv"


@pytest.mark.parametrize(
    ("sent", "kept"),
    [
        ("noise.csv", "noise.csv"),
        ("../../etc/noise.csv", "noise.csv"),
        ("C:\\lab\\noise.csv", "noise.csv"),
        ("--out.csv", "out.csv"),
        (".hidden.csv", "hidden.csv"),
        ('a<b>:"|?*\n.csv', "a_b_______.csv"),
        ("Übung 1.csv", "Übung 1.csv"),
        ("U\u0308bung.csv", "Übung.csv"),
    ],
)
def test_a_name_that_is_sent_becomes_one_of_a_file_in_the_folder(sent, kept):
    assert safe_name(sent) == kept


@pytest.mark.parametrize("sent", ["", "...", "/", "a" * 101 + ".csv", "con.csv", "LPT1", "a\u202eb.csv"])
def test_a_name_of_which_nothing_can_be_made_is_refused(sent):
    with pytest.raises(DataError):
        safe_name(sent)


# What lies in the folder


def test_recordings_rigs_and_results_are_listed_and_nothing_else(root):
    write_result(root / "found")
    for name in ("model.json", "next_input.csv", "figures/residual.csv", "rivals/delay.json", "kept.csv"):
        (root / "found" / name).parent.mkdir(exist_ok=True)
        (root / "found" / name).write_text("", encoding="utf-8")
    for name in ("day 2/steps.TSV", ".cache/a.csv", "notes.md", "a/b/c/d/deep.csv", "a/b/c/near.nc"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("", encoding="utf-8")
    (root / "out.csv").symlink_to(root.parent / "secret.csv")
    (root / "up").symlink_to(root.parent)
    (root / "again.csv").symlink_to(root / "noise.csv")
    desk = Desk.look(root)
    assert desk.recordings == ("a/b/c/near.nc", "again.csv", "day 2/steps.TSV", "found/kept.csv", "noise.csv")
    assert desk.rigs == ("found/model.json", "rig.toml")
    assert desk.results == ("found",)
    assert desk.whole


def test_a_folder_of_results_is_itself_a_result(tmp_path):
    write_result(tmp_path / "found")
    assert Desk.look(tmp_path / "found").results == (".",)


def test_a_full_folder_is_listed_in_part_and_says_so(root, monkeypatch):
    monkeypatch.setattr(desk, "MOST_FILES", 1)
    part = Desk.look(root)
    assert (len(part.recordings) + len(part.rigs), part.whole) == (1, False)


def test_a_name_that_is_taken_is_not_offered(root):
    assert free_name(root) == "result-1"
    (root / "result-1").mkdir()
    (root / "result-2").symlink_to("nowhere")
    assert free_name(root) == "result-3"


# Uploads


def left_over(root: Path) -> set[str]:
    return {path.name for path in root.iterdir()} - {"rig.toml", "noise.csv"}


def test_a_sound_recording_is_kept_under_its_own_name(root):
    assert keep_upload(root, "..\\steps.csv", TABLE.encode(), most_bytes=10_000) == "steps.csv"
    assert (root / "steps.csv").read_text(encoding="utf-8") == TABLE
    assert left_over(root) == {"steps.csv"}


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("big.csv", TABLE * 20, r"big.csv: 0.0 MB; at most 0.01 MB are accepted \(--upload-limit\)"),
        ("page.html", TABLE, r'page.html: files ".html" are not accepted; drop one of .csv, .txt, .tsv, .dat'),
        ("noise.csv", TABLE, "noise.csv: the folder has a file of this name; rename yours"),
        ("key.toml", "[film]\nprestrech = 3", r'^key.toml: .+ line 2, \[film\]: unknown key "prestrech"; did you mean'),
    ],
)
def test_what_is_not_taken_leaves_nothing_behind(name, content, message, root):
    with pytest.raises(DeatwinError, match=message):
        keep_upload(root, name, content.encode(), most_bytes=10_000)
    assert left_over(root) == set()
    assert (root / "noise.csv").read_text(encoding="utf-8") == TABLE


@pytest.mark.parametrize("content", [TABLE.replace("0.12,", "0.12,nan"), "", "time_s\n", "\x00\x01"])
def test_a_bad_recording_is_refused_in_the_words_of_the_command_line(content, root, monkeypatch, capsys):
    with pytest.raises(DataError) as refused:
        keep_upload(root, "bad.csv", content.encode(), most_bytes=10_000)
    monkeypatch.chdir(root)
    (root / "bad.csv").write_text(content, encoding="utf-8", newline="")
    assert main(["identify", "bad.csv", "--out", "model.json"]) == 1
    assert capsys.readouterr().err == f"error: {refused.value}\n"


def test_other_columns_are_read_as_they_are_named(root):
    content = TABLE.replace("command_V", "U").encode()
    columns = ReadOptions(input_column="U", output_column="displacement_mm", time_column="#1")
    assert keep_upload(root, "other.csv", content, most_bytes=10_000, asked=columns) == "other.csv"


def test_a_recording_with_other_columns_is_kept_for_the_page_to_ask_for_them(root):
    content = TABLE.replace("command_V", "Eingang").encode()
    assert keep_upload(root, "other.csv", content, most_bytes=10_000) == "other.csv"
    found = glance(root, "other.csv", NO_OPTIONS)
    assert found.refused.startswith('other.csv: no column "command_V"')
    assert found.further == ReadOptions(input_column="Eingang")
    assert [(column.header, column.role) for column in found.columns[:2]] == [("time_s", "time"), ("Eingang", "input")]


def test_a_recording_of_two_readings_is_kept_and_the_rig_says_which_column_is_the_second(root):
    rows = "".join(f"{0.02 * k:.2f},{2 + 0.1 * (k % 7):.1f},0.3,{k % 5}\n" for k in range(40))
    content = f"time_s,Eingang,stretch_mm,I_mon_nA\n{rows}".encode()
    assert keep_upload(root, "two.csv", content, most_bytes=10_000) == "two.csv"
    second = '\n[readings.current]\ncolumn = "I_mon_nA"\nunit = "nA"\nnoise = 20.0\n'
    rig = Path(rig_files.__file__).with_name("rig.toml").read_text(encoding="utf-8") + second
    (root / "both.toml").write_text(rig, encoding="utf-8")
    (root / "faulty.toml").write_text("[rig", encoding="utf-8")
    asked = ReadOptions(input_column="Eingang=V", output_column="stretch_mm")
    one, two, faulty = (glance(root, "two.csv", asked, rig) for rig in ("", "both.toml", "faulty.toml"))
    assert [column.role for column in one.columns] == ["time", "input", "output", ""]
    assert [column.role for column in faulty.columns] == ["time", "input", "output", ""]
    assert [(column.role, column.unit) for column in two.columns[2:]] == [("output", "mm"), ("reading", "nA")]
    assert not two.refused and "by the rig" in two.html()
    further = load_plant(root / "both.toml").plant.rig.further
    (record,) = read_recordings(root / "two.csv", readings=further, **asked.given)
    assert record.reading("current")[4] == pytest.approx(4e-9)


def test_a_glance_shows_what_look_says(root):
    n = np.arange(400)
    u, y = np.sin(0.3 * n) + np.sin(0.17 * n), np.sin(0.3 * n - 0.5) + np.sin(0.17 * n - 0.3)
    np.savetxt(
        root / "long.csv", np.c_[0.02 * n, u, y], delimiter=",", comments="", header="time_s,command_V,displacement_mm"
    )
    found = glance(root, "long.csv", NO_OPTIONS)
    assert not found.refused and found.lines == look_at(read_recordings(root / "long.csv")).lines
    page = html.unescape(found.html()).replace("\xa0", " ").replace("−", "-")
    assert all(line in page for line in found.lines)
    assert page.count("<svg ") == 1 and "var(--after)" in page


def test_a_file_without_times_asks_for_its_sample_time(root):
    (root / "bare.csv").write_text("command_V,displacement_mm\n" + "1.0,0.1\n2.0,0.2\n" * 20, encoding="utf-8")
    assert glance(root, "bare.csv", NO_OPTIONS).needs_sample_time
    assert not glance(root, "bare.csv", ReadOptions(dt=0.02)).needs_sample_time


# Verdicts side by side


def test_a_verdict_is_read_with_its_recordings(root):
    write_result(root / "found", {"rig.toml": "c", "noise.csv": "a"})
    verdict = Verdict.read(root, "found")
    assert (verdict.verdict, verdict.tone, verdict.unit, verdict.fault) == ("named", "good", "µm", "")
    assert (verdict.fitted, verdict.unseen, verdict.noise) == ((9.8, 2.05), (10.2, 2.1), 2.0)
    assert [(cause.effect, cause.parameters) for cause in verdict.causes] == [
        ("creep", (("time", "54 s", "50 to 59 s"),))
    ]
    assert verdict.recordings == {64 * "a"} and verdict.seconds == 12.5 and not verdict.report


@pytest.mark.parametrize("text", ["", "{}", '{"schema": "deatwin/narx/1"}', "[" * 100_000])
def test_a_damaged_result_is_a_fault_and_no_traceback(text, root):
    (root / "broken").mkdir()
    (root / "broken" / "diagnosis.json").write_text(text, encoding="utf-8")
    verdict = Verdict.read(root, "broken")
    assert verdict.fault.startswith("broken/diagnosis.json: ") and str(root) not in verdict.fault
    assert "broken/diagnosis.json: " in compare([verdict]).html()


@pytest.mark.parametrize("text", ["", "[]", '{"inputs": 1}', '{"inputs": [], "seconds": {}}', "[" * 100_000])
def test_a_verdict_is_read_beside_a_damaged_record(text, root):
    write_result(root / "found", {})
    (root / "found" / "run.json").write_text(text, encoding="utf-8")
    verdict = Verdict.read(root, "found")
    assert (verdict.verdict, verdict.fault, verdict.seconds) == ("named", "", None)


def test_a_result_that_lies_outside_is_not_read(root):
    write_result(root.parent / "elsewhere")
    assert "lies outside of" in Verdict.read(root, "../elsewhere").fault
    (root / "linked").mkdir()
    (root / "linked" / "diagnosis.json").symlink_to(root.parent / "elsewhere" / "diagnosis.json")
    assert "lies outside of" in Verdict.read(root, "linked").fault


def test_errors_of_one_unit_are_drawn_to_one_scale(root):
    fit = {"fitted": {"before": 40.0, "after": None}, "unseen": {"before": 30.0, "after": None, "gain_low": None}}
    write_result(root / "one")
    write_result(root / "two", fit=fit, causes=[], verdict="unknown")
    write_result(root / "force", output={"name": "force", "unit": "N"})
    comparison = compare([Verdict.read(root, name) for name in ("one", "two", "force", "gone")])
    assert comparison.limits == (40.0, 40.0, 10.2, 0.0)


@pytest.mark.parametrize(
    ("first", "second", "same"),
    [
        ({"noise.csv": "a", "rig.toml": "b"}, {"other name.csv": "a", "rig.toml": "c"}, True),
        ({"noise.csv": "a"}, {"noise.csv": "b"}, False),
        ({"noise.csv": "a"}, None, None),
    ],
)
def test_it_is_said_whether_the_recordings_are_the_same(first, second, same, root):
    write_result(root / "one", first)
    write_result(root / "two", second)
    verdicts = [Verdict.read(root, name) for name in ("one", "two")]
    assert compare(verdicts).same_recordings is same
    assert compare(verdicts[:1]).same_recordings is None


def test_the_table_says_all_and_nothing_in_it_is_markup(root):
    possible = [{"effects": [*also, "creep"], "probability": 0.4} for also in ((), ("electrode_rc",))]
    write_result(root / "<b>one", {"noise.csv": "a"}, explanations=possible)
    write_result(root / "two", {"<i>.csv": "b"}, explanations=[{"effects": ["creep"], "probability": 0.91}])
    (root / "two" / "report.html").write_text("", encoding="utf-8")
    table = compare([Verdict.read(root, name) for name in ("<b>one", "two")]).html().replace("\xa0", " ")
    for text in (
        "The film &lt;keeps&gt; creeping.",
        "54 s",
        "50 to 59 s",
        "<td>creep alone; electrode RC and creep</td><td>–</td>",
        "10.2 → 2.10 µm",
        "9.80 → 2.05 µm",
        "2.00 µm",
        64 * "a",
        "These results are for different recordings",
        "<strong>How sure:</strong> creep is 91 % likely, other explanations from the catalogue 4 %, and causes that were not tried",
        'href="results/two/report.html"',
        "&lt;b&gt;one",
        "&lt;i&gt;.csv",
        "took 12.5 s",
    ):
        assert text in table, text
    assert "<b>" not in table and "<i>" not in table
    assert table.count("<svg") == 2 and "results/%3Cb%3Eone" not in table
