"""Origin of a result, shown at the end of its page."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath

from deatwin.studies.provenance import RunRecord

LEFT_OUT = {"--out": 1, "--report": 1, "--jobs": 1, "--json": 0, "--quiet": 0}
"""Options that change where results go and what is printed, but not the results, with the number of words that follow
each."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Origin of a result, without what may differ between equal runs."""

    inputs: Sequence[Mapping[str, str]]  # ``file`` and ``sha256`` of each input
    seed: int
    command: Sequence[str] = ()  # The command line; empty if there was none

    @classmethod
    def of(cls, record: RunRecord) -> Origin:
        """Return the origin stated in the record of a run."""
        return cls(inputs=record.inputs, seed=record.seed, command=record.command)

    @property
    def files(self) -> str:
        """Names of the input files, without folders."""
        return ", ".join(PurePath(given["file"]).name for given in self.inputs)

    @property
    def shown(self) -> str:
        """Return the command line to repeat the run, without options that do not affect the results."""
        words = list(self.command)
        kept = [PurePath(word).name for word in words[:1]]
        place = 1
        while place < len(words):
            name = words[place].split("=")[0]
            if name not in LEFT_OUT:
                kept.append(words[place])
            elif "=" not in words[place]:
                place += LEFT_OUT[name]
            place += 1
        return shlex.join(kept)
