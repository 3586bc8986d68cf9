"""The tables in the documents that say what the last studies reached, made from the data files beside them.

``python tests/tools/evidence.py docs`` writes them anew. After a study its folder is given too::

    python tests/tools/evidence.py docs --control-check FOLDER --remark "Run at commit 0123abc."
    python tests/tools/evidence.py docs --control-story FOLDER --remark "Run at commit 0123abc."
    python tests/tools/evidence.py docs --concealed-physics FOLDER --remark "Run at commit 0123abc."
    python tests/tools/evidence.py docs --scenarios FOLDER --remark "commit 0123abc"

reads the folder into ``docs/data/``, and writes the pages. ``--control-check`` takes the trials of a control check,
``--control-story`` all else, from the same folder or from that of another run. ``--concealed-physics`` draws that study
for its page, too. ``--scenarios`` takes the measures of all others, each from the folder of its name; of those that
are not there what was kept stays.
"""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from concealed_study import DATA as CONCEALED
from concealed_study import TITLES, opened_study, page_data, page_of
from control_story import STORY, story_blocks, story_data
from markdown_tables import markdown_table
from measured import MEASURED, measured_blocks, measured_data
from records import RECORDS, record_blocks

from deatwin.plant.errors import DataError
from deatwin.scenarios.concealed_physics.page import summary
from deatwin.scenarios.concealed_physics.results import NO_CASE, score
from deatwin.scenarios.control_check.trials import Outcome, caught, inside, sound
from deatwin.studies.rates import Rate
from deatwin.studies.sweep.store import CASE_ENDING, read_case, read_object

TRIALS = "deatwin/control-trials/1"
STUDY, LONG_STUDY = "concealed-physics", "concealed-physics-long"
"""Of the usual length of recordings, and of a rig's own."""
FIGURE = """
## In one figure

![Confusion of families, share of effects named, stated probabilities, errors on held-out data]({name}.svg)
"""
DATA = {
    "control-check": TRIALS,
    "control-story": STORY,
    STUDY: CONCEALED,
    LONG_STUDY: CONCEALED,
    "scenarios": MEASURED,
} | {"records": RECORDS}
"""Files in ``docs/data/`` by their names without ending, with their schemas."""
BLOCK = re.compile(r"(<!-- made by evidence: ([\w-]+) -->\n).*?(<!-- end -->)", re.DOTALL)
Data = Mapping[str, Mapping[str, Any]]


def trials_data(folder: Path | str, remark: str = "") -> dict[str, Any]:
    """Read the trials of a control check."""
    found = sorted(Path(folder).glob(f"trials/**/*{CASE_ENDING}"))
    if not found:
        raise DataError(f"{folder}: it holds no trials (trials/000.nc and so on)")
    rows, sealed = [], set()
    for path in found:
        row = read_case(path)
        sealed.add((row.pop("schema"), row.pop("seed"), row.pop("code")))
        rows.append({**asdict(Outcome(**row)), "number": int(row["number"])})
    if len(sealed) > 1:
        raise DataError(f"{folder}: its trials are of {len(sealed)} seeds or codes; they must be of one")
    _, seed, code = sealed.pop()
    rows.sort(key=lambda row: row["number"])
    return {"schema": TRIALS, "seed": seed, "code": code, "remark": remark, "trials": rows}


def blocks(data: Data) -> dict[str, list[str]]:
    """The lines of every block that pages hold."""
    control, checked = _of_trials(data["control-check"])
    concealed = _of_concealed(STUDY, "concealed physics", data[STUDY])
    long = _of_concealed(LONG_STUDY, "concealed physics in long recordings", data[LONG_STUDY])
    story, measured = story_blocks(data["control-story"]), measured_blocks(data["scenarios"])
    records = record_blocks(data["records"], data["scenarios"])
    studies = markdown_table(["study", "cases run", "goals met", "run"], [concealed, long, checked])
    return {**control, "studies": studies, **story, **measured, **records}


def _of_trials(trials: Mapping[str, Any]) -> tuple[dict[str, list[str]], list[str]]:
    """The blocks of a control check, and its row among the studies."""
    outcomes = [Outcome(**row) for row in trials["trials"]]
    head = [
        "trials",
        "passed",
        "passed designs with true steps inside the band",
        "unsound designs that the check rejected",
        "sound designs that the check rejected",
    ]
    row = [
        "[control check](control-check.md)",
        str(len(outcomes)),
        f"{sum(_kept(outcomes))} of 2",
        f"seed {trials['seed']}, code `{trials['code'][:12]}`",
    ]
    return {
        "trials": _run(trials, outcomes),
        "promises": markdown_table(["statement", "true in"], _promises(outcomes)),
        "by-design": markdown_table(["design", *head], _grouped(outcomes, lambda o: o.design)),
        "by-concealed": markdown_table(
            ["effect that the plant lacks", *head], _grouped(outcomes, lambda o: o.concealed or "nothing")
        ),
    }, row


def _of_concealed(page: str, called: str, concealed: Mapping[str, Any]) -> list[str]:
    """The row of concealed physics among the studies, which leads to its page."""
    goals = concealed["goals"]
    tested = [goal for goal in goals if goal["reached"] != NO_CASE]
    return [
        f"[{called}]({page}.md)",
        f"{concealed['done']} of {concealed['planned']}",
        f"{sum(g['met'] == 'yes' for g in goals)} of {sum(g['met'] != 'reported' for g in tested)}",
        f"seed {concealed['seed']}, deatwin {concealed['version']}",
    ]


def with_blocks(text: str, made: Mapping[str, Sequence[str]]) -> str:
    """A page with its blocks written anew."""

    def anew(found: re.Match[str]) -> str:
        return "\n".join([found[1].rstrip("\n"), "", *made[found[2]], "", found[3]])

    return BLOCK.sub(anew, text)


def pages(docs: Path | str) -> dict[str, str]:
    """Every page that is made from data, as it should be."""
    folder = Path(docs)
    data = {name: _read(folder / "data" / f"{name}.json", schema) for name, schema in DATA.items()}
    made = blocks(data)
    whole = {f"{name}.md": page_of(data[name]) + FIGURE.format(name=name) for name in (STUDY, LONG_STUDY)}
    parts = {
        name: with_blocks((folder / name).read_text(encoding="utf-8"), made)
        for name in ("control-check.md", "validation.md")
    }
    return whole | parts


def main(arguments: Sequence[str] | None = None) -> None:
    """Read studies into data files where they are given, and write the pages."""
    from deatwin.plant.files import write_text_atomic

    parser = argparse.ArgumentParser(
        prog="python tests/tools/evidence.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("docs", type=Path, help="folder of the documents")
    parser.add_argument("--control-check", type=Path, metavar="FOLDER", help="the trials of that scenario")
    parser.add_argument("--control-story", type=Path, metavar="FOLDER", help="results of control-check but its trials")
    parser.add_argument("--concealed-physics", type=Path, metavar="FOLDER", help="results of that scenario")
    parser.add_argument("--scenarios", type=Path, metavar="FOLDER", help="of folders with the results of others")
    parser.add_argument("--remark", default="", help="a sentence on the run, such as its commit")
    given = parser.parse_args(arguments)
    if given.control_check is not None:
        _write(given.docs, "control-check", trials_data(given.control_check, given.remark))
    if given.control_story is not None:
        _write(given.docs, "control-story", story_data(given.control_story, given.remark))
    if given.concealed_physics is not None:
        study, seal = opened_study(given.concealed_physics)
        data, figure = page_data(study, score(study), seal), summary(study)
        name = f"{STUDY}-{data['size']}" if data["size"] in TITLES else STUDY
        _write(given.docs, name, {**data, "remark": given.remark})
        write_text_atomic(given.docs / f"{name}.svg", figure)
    if given.scenarios is not None:
        kept = _read(given.docs / "data" / "scenarios.json", MEASURED)
        _write(given.docs, "scenarios", measured_data(given.scenarios, given.remark, kept))
    for name, text in pages(given.docs).items():
        write_text_atomic(given.docs / name, text)


def _read(path: Path, schema: str) -> Mapping[str, Any]:
    found = read_object(path, f"the data of a page, {schema}")
    if found.get("schema") != schema:
        raise DataError(f"{path}: it must be a {schema} file")
    return found


def _write(docs: Path, name: str, data: Mapping[str, Any]) -> None:
    """A data file, a row of its lists a line: so that a change of one shows as one."""
    from deatwin.plant.files import write_text_atomic

    def one(value: object) -> str:
        return json.dumps(value, ensure_ascii=False, allow_nan=False)

    fields = []
    for key, value in data.items():
        rows = ",\n  ".join(map(one, value)) if isinstance(value, list) else ""
        fields.append(f" {one(key)}: " + (f"[\n  {rows}\n ]" if rows else one(value)))
    (docs / "data").mkdir(exist_ok=True)
    write_text_atomic(docs / "data" / f"{name}.json", "{\n" + ",\n".join(fields) + "\n}\n")


def _run(trials: Mapping[str, Any], outcomes: Sequence[Outcome]) -> list[str]:
    designs = sum(o.sound is not None for o in outcomes)
    passed, broken = inside(outcomes).count, caught(outcomes)
    words = [
        f"The study ran {len(outcomes)} trials with seed {trials['seed']} (hash of the sources: "
        f"`{trials['code'][:12]}`).",
        trials["remark"],
        f"In {len(outcomes) - designs} of the {len(outcomes)} trials, no controller could be designed that met the "
        f"specification on the model. Of the {designs} designs in the other trials, {passed} passed the check. "
        f"{broken.count} designs broke a limit on the true rig; {broken.count - broken.hits} of these had passed. In the "
        "tables, a design that did not pass counts as rejected. The bounds are one-sided 95 % confidence bounds "
        "(Clopper and Pearson).",
    ]
    return [" ".join(word for word in words if word)]


def _promises(outcomes: Sequence[Outcome]) -> list[list[str]]:
    return [
        [
            "designs that passed: the true steps lie inside the predicted 95 % band (goal: at least 90 %)",
            _cell(inside(outcomes)),
        ],
        [
            "designs that break a limit on the true rig: the check rejected the design (goal: at least 90 %)",
            _cell(caught(outcomes)),
        ],
        ["designs that passed: they keep every limit on the true rig", _cell(sound(outcomes))],
        [
            "designs that keep every limit on the true rig: the check rejected the design",
            _cell(_cautious(outcomes), bound=False),
        ],
        [
            "designs that break a limit on the true rig: the true steps lie inside the predicted band all the same",
            _cell(Rate.of(o.inside == 1.0 for o in outcomes if o.sound is False), bound=False),
        ],
    ]


def _kept(outcomes: Sequence[Outcome]) -> list[bool]:
    """Whether the two rates of which 90 % is demanded reach it."""
    return [rate.count > 0 and rate.share >= 0.9 for rate in (inside(outcomes), caught(outcomes))]


def _cautious(outcomes: Sequence[Outcome]) -> Rate:
    return Rate.of(o.verdict != "pass" for o in outcomes if o.sound)


def _grouped(outcomes: Sequence[Outcome], key: Callable[[Outcome], str]) -> list[list[str]]:
    names = sorted({key(o) for o in outcomes}, key=lambda name: (name != "nothing", name))
    rows = []
    for name in names:
        of = [o for o in outcomes if key(o) == name]
        passed = sum(o.verdict == "pass" for o in of)
        rates = (inside(of), caught(of), _cautious(of))
        rows.append([name, str(len(of)), str(passed), *(_counts(rate) for rate in rates)])
    return rows


def _cell(rate: Rate, *, bound: bool = True) -> str:
    if not rate.count:
        return "no trial"
    least_of = f" (95 % lower bound: {rate.least_percent} %)" if bound else ""
    return f"{_counts(rate)}, {100 * rate.share:.0f} %{least_of}"


def _counts(rate: Rate) -> str:
    return f"{rate.hits} of {rate.count}" if rate.count else "–"


if __name__ == "__main__":
    main()
