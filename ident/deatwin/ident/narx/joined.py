"""Recordings one after another, so that a model of one output runs over all of them at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from deatwin.ident.narx.drive import require_suits
from deatwin.ident.narx.free_run import March
from deatwin.ident.narx.model import NarxModel, require_model
from deatwin.ident.narx.terms import TermTable
from deatwin.plant.arrays import Array, Integers
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


@dataclass(frozen=True, eq=False)
class Joined:
    """Recordings one after another."""

    recordings: tuple[Recording, ...]

    @classmethod
    def of(cls, model: NarxModel, recordings: Sequence[Recording]) -> Joined:
        """Join recordings; ModelError unless they suit the model, which must have one output."""
        require_model(model).require_one_output("a refinement")
        for recording in recordings:
            require_suits(recording, model, with_outputs=True, fewest=model.table.max_lag + 1)
        return cls(tuple(recordings))

    @cached_property
    def inputs(self) -> Array:
        """Inputs, shape (n_inputs, n)."""
        return np.concatenate([record.inputs for record in self.recordings], axis=1)

    @cached_property
    def outputs(self) -> Array:
        """Outputs, shape (1, n)."""
        return np.concatenate([record.outputs for record in self.recordings], axis=1)

    @cached_property
    def lengths(self) -> Integers:
        """Number of samples of each recording."""
        return np.array([record.n_samples for record in self.recordings])

    @cached_property
    def ends(self) -> Integers:
        """Sample after each recording."""
        return np.cumsum(self.lengths)

    @cached_property
    def ages(self) -> Integers:
        """Number of earlier samples in the recording of each sample."""
        return np.arange(self.ends[-1]) - np.repeat(self.ends - self.lengths, self.lengths)

    def samples(self, first: int) -> Integers:
        """Return the samples from `first` on of each recording."""
        return np.flatnonzero(self.ages >= first)

    def apart(self, values: Array, first: int) -> list[Array]:
        """Cut values of the samples from `first` on by recordings."""
        return np.split(values, self.ends[:-1] - first * np.arange(1, self.ends.size))

    def rows(self, model: NarxModel, table: TermTable, first: int, outputs: Array) -> Array:
        """Evaluate terms of the signals about the model's origins from sample `first` of each recording on, with given
        `outputs` (1, n); returns (n_terms, n_computed)."""
        rows = table.rows(*model.about_origin(self.inputs, outputs), first, self.outputs.shape[1])
        return rows if self.ends.size == 1 else rows[:, self.samples(first) - first]

    def run(self, model: NarxModel) -> tuple[Array, int | None]:
        """Return the free run, (1, n), and the sample at which it first diverges."""
        terms = [i for i, term in enumerate(model.terms) if all(v.kind != "e" for v, _ in term.factors)]
        inputs, outputs = model.about_origin(self.inputs, self.outputs)
        march = March.of(
            [model.terms[i] for i in terms],
            {"u": inputs},
            "y",
            outputs,
            first=model.table.max_lag,
            ends=self.ends,
        )
        limits = np.array([model.divergence_limit(record.outputs) for record in self.recordings])
        run, failed = march.run(model.theta[terms], limit=limits)
        if failed is not None:  # far from anything measured, wherever it diverged
            run[:, failed:] = limits.max()
        return run + model.output_origin[:, None], failed

    def sound_run(self, model: NarxModel) -> Array:
        """Return the free run, (1, n); ModelError if it diverges."""
        run, failed = self.run(model)
        if failed is not None:
            number = int(np.searchsorted(self.ends, failed, side="right"))
            recording = self.recordings[number]
            when = float(recording.timepts[self.ages[failed]])
            raise ModelError(
                f"the free run diverges at {when:g} s, so that it has no useful sensitivities; "
                "start from a model whose free run is stable on these recordings"
            )
        return run
