"""``deatwin diagnose`` or ``deatwin plan`` in a process of its own, which prints its progress.

JSON lines on stdout: ``{"share": 0.3, "step": "..."}``; at the end ``{"share": 1.0, "verdict": ..., "sentence": ...}``.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import Any

from deatwin.app.working import exit_status
from deatwin.studies.interrupts import forward_signals


def main(arguments: Sequence[str]) -> int:
    """Diagnose or plan, by the first argument."""
    run = {"diagnose": _diagnose, "plan": _plan}[arguments[0]]

    def work() -> None:
        with forward_signals():
            run(arguments)

    return exit_status(work)


def _diagnose(arguments: Sequence[str]) -> None:
    from deatwin.app.given import GivenPlant
    from deatwin.plant.readoptions import ReadOptions
    from deatwin.studies.diagnosing import DiagnosisTask
    from deatwin.studies.folder import ResultFolder

    asked = _parse(arguments)
    files = [str(path) for path in asked["recordings"]]
    plant = GivenPlant.load(asked["rig"], ReadOptions.of(asked))
    task = DiagnosisTask(
        plant=plant.model.plant,
        experiments=[plant.experiment(files)],
        files=[asked["rig"], *files],
        command=["deatwin", *arguments],
        jobs=asked["jobs"],
        seed=asked["seed"],
    )
    diagnosis = task.run(ResultFolder(asked["out"]), _progress)
    _tell(share=1.0, verdict=diagnosis.verdict.value, sentence=diagnosis.sentence)


def _plan(arguments: Sequence[str]) -> None:
    from deatwin.app.plan_report import plan_into
    from deatwin.studies.folder import ResultFolder

    asked = _parse(arguments)
    with ResultFolder(asked["out"]) as folder:
        found = plan_into(folder, ["deatwin", *arguments], asked, _progress)
    _tell(share=1.0, verdict="plan", sentence=found.sentence)


def _progress(share: float, step: str) -> None:
    from deatwin.plant.interrupts import obey

    obey()
    _tell(share=share, step=step)


def _parse(arguments: Sequence[str]) -> dict[str, Any]:
    """Parse the arguments as the command line does."""
    from typer.main import get_command

    from deatwin.app.cli import app

    group: Any = get_command(app)
    parameters: dict[str, Any] = group.commands[arguments[0]].make_context(arguments[0], list(arguments[1:])).params
    return parameters


def _tell(**facts: Any) -> None:
    print(json.dumps(facts), flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
