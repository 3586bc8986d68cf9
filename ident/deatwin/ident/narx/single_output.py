"""Treat one of several equations as a regression with a single output; the other outputs become inputs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.terms import Term, TermTable, Variable
from deatwin.plant.recording import Recording


def single_output(data: Regression) -> Regression:
    """Return the same regression, term by term, for a single output, which can be simulated alone."""
    if len(data.recordings[0].outputs) == 1:
        return data
    n_inputs, own = len(data.recordings[0].inputs), data.output

    def renamed(variable: Variable) -> Variable:
        if variable.kind == "u":
            return replace(variable, channel=variable.index + 1)
        if variable.index == own:
            return replace(variable, channel=0)
        return replace(variable, kind="u", channel=n_inputs + 1 + variable.index - (variable.index > own))

    terms = tuple(Term.product(map(renamed, term.expanded)) for term in data.table.terms)
    regression = replace(
        data, table=TermTable(terms), recordings=tuple(_apart(record, own) for record in data.recordings), output=0
    )
    if data.input_origin is None or data.output_origin is None:
        return regression
    others = np.delete(data.output_origin, own)
    return replace(
        regression,
        input_origin=np.concatenate([data.input_origin, others]),
        output_origin=data.output_origin[own : own + 1],
    )


def _apart(record: Recording, own: int) -> Recording:
    """Return a recording of one output, with the other outputs after its inputs."""
    return Recording.from_arrays(
        np.concatenate([record.inputs, np.delete(record.outputs, own, axis=0)]),
        record.outputs[own],
        record.sample_time,
        start=record.start,
        provenance=record.provenance,
    )
