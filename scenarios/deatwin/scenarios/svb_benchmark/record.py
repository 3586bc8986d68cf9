"""The cases on the disk: one file each, whole or absent, all of one seed, one plan and one version of the code."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from deatwin.plant.errors import DataError
from deatwin.scenarios.svb_benchmark.cases import Answer
from deatwin.studies.provenance import versions
from deatwin.studies.sweep.seal import SweepSeal, sources_digest
from deatwin.studies.sweep.store import CaseStore

CASES = "draws"
"""Folder of the cases."""
SCHEMA = "deatwin/hit-rate-case/1"
PACKAGES = ("deatwin.plant", "deatwin.ident")
"""Whose code decides an answer, besides that of the cases themselves."""
OWN = ("cases.py", "coverage.py", "gibbs.py", "methods.py", "oracle.py", "sampling.py", "trials.py")
VERSIONS = ("deatwin", "numpy", "scipy", "scikit-learn")


class Draws(CaseStore[SweepSeal]):
    """The cases of a study."""

    def __init__(self, folder: Path, seed: int, plan: Mapping[str, Any]) -> None:
        parts = {
            "seed": seed,
            "plan": dict(plan),
            "versions": versions(VERSIONS),
            "code": sources_digest(PACKAGES, [Path(__file__).parent / name for name in OWN]),
        }
        super().__init__(folder, SweepSeal(schema=SCHEMA, parts=parts), cases=CASES)

    def answer(self, name: str) -> Answer:
        """Read a case."""
        found = self.get(name)
        try:
            return Answer.from_dict(found)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise DataError(
                f"{self.path(name)}: it must hold a case ({error!r}); delete it, and it is run again"
            ) from None
