"""`deatwin plan` from files to files."""

import json
from pathlib import Path

from deatwin.app.cli import main


def test_a_plan_for_given_commands(on_bench, capsys):
    assert (
        main(["plan", "strip_of_mine:strip", "pulls.csv", "--out", "planned", "--jobs", "1", "--quiet", "--json"]) == 0
    )
    written = json.loads((on_bench / "planned/plan.json").read_text(encoding="utf-8"))
    said = json.loads(capsys.readouterr().out)
    assert written["schema"] == "deatwin/plan/1" and {**written, "out": "planned"} == said
    rows = {row["effect"]: row for row in written["effects"]}
    assert rows["creep"]["visible"] and rows["creep"]["smallest"] < rows["creep"]["typical"]
    page = (on_bench / "planned/report.html").read_text(encoding="utf-8").replace("\xa0", " ")
    assert written["sentence"][1:] in page and "of 0 measures" not in page
    files = {str(path.relative_to("planned")) for path in Path("planned").rglob("*") if path.is_file()}
    assert files == set(json.loads(Path("planned/run.json").read_text(encoding="utf-8"))["outputs"])
    assert "next_input.csv" not in files
