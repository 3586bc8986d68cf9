"""``deatwin material``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from deatwin.app.options import Json, OutFolder, Quiet
from deatwin.app.working import results
from deatwin.studies.voice import Voice

TestsFile = Annotated[
    Path, typer.Argument(metavar="TESTS.toml", help="TOML file that lists the tests: their files, kinds and columns.")
]


def material(
    context: typer.Context, tests: TestsFile, out: OutFolder, as_json: Json = False, quiet: Quiet = False
) -> None:
    """Calibrate a film's material on coupon tests: pulls, cycles, relaxations, dynamic moduli.

    Writes into DIR: material.toml, which a rig file can name as its material; material.json; report.html; figures with
    their data; and run.json.

    Example: deatwin material tests.toml --out film
    """
    from deatwin.app.material_report import write_material
    from deatwin.ident.materials import calibrate_material, read_material_tests
    from deatwin.studies.provenance import RunRecord, hashes

    voice = Voice(as_json=as_json, quiet=quiet)
    given = read_material_tests(tests)
    record = RunRecord(command=context.obj or [], inputs=hashes([tests, *given.files]), seed=0, jobs=1)
    with results(out, voice, "calibrating") as (folder, _):
        found = calibrate_material(given.tests, given.about)
        write_material(found, folder, record)
    voice.say(found.sentence)
    for line in found.lines:
        voice.say(f"  {line}")
    voice.say(folder.summary)
    voice.result({"out": str(out), **found.to_dict()})
