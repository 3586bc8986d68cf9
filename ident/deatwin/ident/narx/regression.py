"""The regression of candidate terms on recordings: scaling, and conversion back to physical units."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from deatwin.ident.narx.bayes import Statistics
from deatwin.ident.narx.document import OperatingRange
from deatwin.ident.narx.drive import order_apart, signals_like, units_apart
from deatwin.ident.narx.levels import without_repeated_powers
from deatwin.ident.narx.model import NarxModel
from deatwin.ident.narx.terms import Lags, Rule, Term, TermTable, Variable, channel_lags, generate_terms, require_terms
from deatwin.plant.arrays import Array
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Experiment, Recording, label, way_to_record

Recordings = Recording | Experiment | Iterable[Recording | Experiment]

_BLOCK = 4096  # samples evaluated at once: 32 MB for a block of 1000 terms


def require_alike(recordings: Sequence[Recording]) -> None:
    """Raise ModelError unless recordings agree in inputs, outputs, their order, units and sample time."""
    first = recordings[0]
    for record in recordings[1:]:
        if differs := _difference(first, record):
            raise ModelError(
                f"{label(first)} and {label(record)}: {differs}; recordings that are used together need the same inputs, "
                "outputs, units and sample time"
            )


def _difference(first: Recording, record: Recording) -> str:
    """Return what keeps two recordings from being used together; empty if nothing does."""
    if not math.isclose(record.sample_time, first.sample_time, rel_tol=1e-6):
        return f"sample times of {first.sample_time:g} s and {record.sample_time:g} s"
    (n, m), (others_n, others_m) = ((len(one.inputs), len(one.outputs)) for one in (first, record))
    if (n, m) != (others_n, others_m):
        return f"{n} and {others_n} inputs, {m} and {others_m} outputs"
    names = (*first.input_names, *first.output_names)
    units, others = ((*one.input_units, *one.output_units) for one in (first, record))
    return order_apart(record, first) or ", ".join(units_apart(names, units, others))


@dataclass(frozen=True, eq=False)
class Regression:
    """Regression y = Phi theta + e of candidates, about origins and scaled to at most 1 by powers of two."""

    table: TermTable  # Candidate terms
    recordings: tuple[Recording, ...]  # Training data
    first: int  # First fitted sample of each recording, so that all its lags lie in the recording
    output: int = 0  # Row of the output whose equation this is
    input_origin: Array | None = None
    output_origin: Array | None = None

    @classmethod
    def of(
        cls,
        recordings: Recordings,
        *,
        output_lags: Lags,
        input_lags: Lags,
        degree: int,
        functions: Sequence[str] = (),
        rule: Rule | None = None,
        output: int = 0,
    ) -> Regression:
        """Set up all candidates of given lags and degree, without redundant powers of inputs with few levels."""
        chosen = flatten(recordings)
        n_inputs, n_outputs = len(chosen[0].inputs), len(chosen[0].outputs)
        if n_inputs == 0 and input_lags != 0:
            raise ModelError("the recordings have no inputs; take input_lags=0 for a model of the output alone")
        if n_outputs == 0:
            raise ModelError("the recordings have no outputs: there is nothing to identify")
        terms = generate_terms(
            channel_lags(output_lags, "y", n_outputs, chosen[0].output_names) or 0,
            channel_lags(input_lags, "u", n_inputs, chosen[0].input_names) or 0,
            degree,
            n_inputs=n_inputs,
            n_outputs=n_outputs,
            functions=_functions(functions, chosen[0]),
            rule=rule,
        )
        return cls.on(chosen, TermTable(without_repeated_powers(terms, chosen)), output=output)

    @classmethod
    def on(cls, recordings: Recordings, table: TermTable, *, output: int = 0) -> Regression:
        """Set up the regression on given terms."""
        chosen = flatten(recordings)
        require_alike(chosen)
        own = np.concatenate([record.outputs[output] for record in chosen])
        if np.ptp(own) == 0.0:
            raise ModelError(f"the output is constantly {own[0] or 'zero'}: there is nothing to identify")
        for number, record in enumerate(chosen, start=1):
            if record.n_samples <= table.max_lag:
                raise ModelError(
                    f"recording {number} has {record.n_samples} samples; "
                    f"lags up to {table.max_lag} need at least {table.max_lag + 1}"
                )
        return cls(table, chosen, table.max_lag, output)

    def require_samples_for(self, n_terms: int) -> None:
        """Raise ModelError unless there are more samples than terms that may be chosen."""
        most = min(n_terms, len(self.table.terms))
        if self.n_samples <= most:
            raise ModelError(
                f"{self.n_samples} usable samples are too few for up to {most} terms; at least {most + 1} are needed: "
                "allow fewer terms, or record longer"
            )

    def only(self, indices: Iterable[int]) -> Regression:
        """Return the regression on selected terms, over the same samples."""
        table = TermTable(tuple(self.table.terms[i] for i in indices))
        return replace(self, table=table)

    def about(self, model: NarxModel) -> Regression:
        """Return the regression of the signals relative to the origins of a model, which has them in the same order."""
        record = self.recordings[0]
        if moved := order_apart(record, model):
            raise ModelError(f"the recordings' {moved}; give them in the model's order")
        return replace(self, input_origin=model.input_origin, output_origin=model.output_origin)

    @property
    def n_samples(self) -> int:
        """Number of rows of the regression."""
        return sum(record.n_samples - self.first for record in self.recordings)

    @cached_property
    def input_scales(self) -> Array:
        """Divisors of the inputs, shape (n_inputs,), in their units."""
        return _scales([inputs for inputs, _ in map(self._about_origin, self.recordings)])

    @cached_property
    def output_scales(self) -> Array:
        """Divisors of the outputs, shape (n_outputs,), in their units."""
        return _scales([outputs for _, outputs in map(self._about_origin, self.recordings)])

    @property
    def output_scale(self) -> float:
        """Divisor of this equation's output, in its unit."""
        return float(self.output_scales[self.output])

    @cached_property
    def term_scales(self) -> Array:
        """Physical value of a scaled parameter of 1, for each term, shape (n_terms,)."""
        scales = {"y": self.output_scales, "e": self.output_scales, "u": self.input_scales}
        values = [scales[v.kind][v.index] ** (1 if v.shape is None else v.shape.degree) for v in self.table.variables]
        return self.output_scale / self.table.at(np.array(values))

    @cached_property
    def scaled_table(self) -> TermTable:
        """The table for scaled signals, term by term."""
        return self.for_scaled(self.table)

    def for_scaled(self, table: TermTable) -> TermTable:
        """Return a table for scaled signals, term by term."""
        return table.in_units({"y": self.output_scales, "u": self.input_scales})

    def scaled(self, record: Recording) -> tuple[Array, Array]:
        """Return inputs, (n_inputs, n), and outputs, (n_outputs, n), less their origins and divided by the scales."""
        inputs, outputs = self._about_origin(record)
        return inputs / self.input_scales[:, None], outputs / self.output_scales[:, None]

    def _about_origin(self, record: Recording) -> tuple[Array, Array]:
        inputs = record.inputs if self.input_origin is None else record.inputs - self.input_origin[:, None]
        outputs = record.outputs if self.output_origin is None else record.outputs - self.output_origin[:, None]
        return inputs, outputs

    def blocks(self) -> Iterator[tuple[Array, Array]]:
        """Yield scaled regressors (n_terms, n) and outputs (n,) block by block."""
        for record in self.recordings:
            inputs, outputs = self.scaled(record)
            for start in range(self.first, record.n_samples, _BLOCK):
                stop = min(start + _BLOCK, record.n_samples)
                yield self.scaled_table.rows(inputs, outputs, start, stop), outputs[self.output, start:stop]

    def matrix(self) -> tuple[Array, Array]:
        """Return scaled regressors, transposed to (n_terms, n_samples), and outputs, shape (n_samples,)."""
        rows = np.empty((len(self.table.terms), self.n_samples))
        target = np.empty(self.n_samples)
        filled = 0
        for block, outputs in self.blocks():
            stop = filled + outputs.size
            rows[:, filled:stop], target[filled:stop] = block, outputs
            filled = stop
        return rows, target

    def statistics(self) -> Statistics:
        """Return the sufficient statistics of the scaled signals, by blocks."""
        n = len(self.table.terms)
        gram, moment, power = np.zeros((n, n)), np.zeros(n), 0.0
        for rows, target in self.blocks():
            gram += rows @ rows.T
            moment += rows @ target
            power += float(target @ target)
        return Statistics(gram=gram, moment=moment, power=power, n_samples=self.n_samples)

    def model(
        self, theta: Array, theta_cov: Array, noise_variance: float, *, identifier: Any, theta_dof: float = math.inf
    ) -> NarxModel:
        """Return the model in physical units. Shapes: `theta` (n_terms,); `theta_cov` (n_terms, n_terms)."""
        scale = self.term_scales
        record = self.recordings[0]
        noise = np.zeros(len(record.output_names))
        noise[self.output] = noise_variance * self.output_scale**2
        return NarxModel(
            terms=self.table.terms,
            theta=theta * scale,
            theta_cov=theta_cov * np.outer(scale, scale),
            theta_dof=theta_dof,
            noise_variance=noise if noise.size > 1 else float(noise[0]),
            equations=(self.output,) * len(self.table.terms),
            **signals_like(record),
            input_origin=np.zeros(len(record.inputs)) if self.input_origin is None else self.input_origin,
            output_origin=np.zeros(len(record.outputs)) if self.output_origin is None else self.output_origin,
            operating=_operating_range(self.recordings),
            provenance=provenance_of(identifier, self.recordings, self.n_samples),
        )


def flatten(recordings: Recordings) -> tuple[Recording, ...]:
    """Return all recordings in whatever form they were given."""
    if isinstance(recordings, Recording):
        return (recordings,)
    if isinstance(recordings, Experiment):
        return tuple(recordings.recordings)
    one = isinstance(recordings, str | bytes | Mapping) or hasattr(recordings, "shape")
    if one or not isinstance(recordings, Iterable):
        raise ModelError(
            f"recordings and experiments are needed, not a {type(recordings).__name__}: {way_to_record(recordings)}"
        )
    chosen = tuple(record for item in recordings for record in flatten(item))
    if not chosen:
        raise ModelError("no recording was given; at least one is needed")
    return chosen


def provenance_of(identifier: object, recordings: Sequence[Recording], samples: int) -> dict[str, str]:
    """Return who fitted a model to what, for its provenance."""
    files = [record.provenance["file"] for record in recordings if "file" in record.provenance]
    return {
        "identifier": repr(identifier),
        "samples": str(samples),
        "recordings": ", ".join(files) or str(len(recordings)),
    }


def require_no_target(y: object) -> None:
    """Raise ModelError if outputs were given beside the recordings that hold them."""
    if y is not None:
        raise ModelError(
            "fit takes recordings and no y, because recordings hold the outputs: "
            "Recording.from_arrays(inputs, outputs, sample_time) makes a recording of arrays"
        )


def _functions(written: Sequence[str], record: Recording) -> tuple[Variable, ...]:
    """Return the functions of lagged signals that are additional candidates."""
    require_terms(written, "functions", '["|u(k-1)|", "sat(y(k-1),0.5)"]')
    names = {"input_names": record.input_names, "output_names": record.output_names}
    terms = [Term.parse(text, **names) for text in written]
    for text, term in zip(written, terms, strict=True):
        if term.degree != 1 or term.expanded[0].shape is None:
            raise ModelError(f'functions: {text!r} is not a function of a lagged signal, such as "|u(k-1)|"')
    table = TermTable(tuple(terms))
    if table.channels("u") > len(record.inputs) or table.channels("y") > len(record.outputs):
        raise ModelError(f"functions {', '.join(written)}: the recordings have no such signal")
    return table.variables


def _scales(signals: list[Array]) -> Array:
    largest = np.max([np.abs(signal).max(axis=1) for signal in signals], axis=0)
    return np.where(largest > 0, np.ldexp(1.0, np.frexp(largest)[1]), 1.0)


def _operating_range(recordings: tuple[Recording, ...]) -> OperatingRange:
    inputs = np.concatenate([record.inputs for record in recordings], axis=1)
    outputs = np.concatenate([record.outputs for record in recordings], axis=1)
    return OperatingRange(
        input_min=inputs.min(axis=1),
        input_max=inputs.max(axis=1),
        input_centre=inputs.mean(axis=1),
        output_min=outputs.min(axis=1),
        output_max=outputs.max(axis=1),
        output_centre=outputs.mean(axis=1),
    )


def about_data(data: Regression) -> Regression:
    """Return a regression about origins chosen from the data: the mean of a signal if it exceeds its swing, else zero.

    About a distant zero, as with kelvin, regressors would be nearly constant; about a near one, powers lose a bit or two
    per factor. A signal with a function of it keeps its zero, to which the function refers.
    """
    kept = {kind: [v.index for v in data.table.functions if v.kind == kind] for kind in ("u", "y")}
    return replace(
        data,
        input_origin=_origins([record.inputs for record in data.recordings], kept["u"]),
        output_origin=_origins([record.outputs for record in data.recordings], kept["y"]),
    )


def about_rest(data: list[Regression], model: NarxModel) -> list[Regression]:
    """Return the regressors of all outputs about the model's equilibrium with its inputs at their origins."""
    moved = (model.output_origin.any() or model.input_origin.any()) and not model.table.functions
    if len(data) != model.n_outputs or not moved or not any(term.degree == 0 for term in model.terms):
        return data
    swings = np.ptp(np.concatenate([record.outputs for record in data[0].recordings], axis=1), axis=1)
    quiet = [m for m, term in enumerate(model.terms) if all(v.kind == "y" for v, _ in term.factors)]
    equations = [model.equations[m] for m in quiet]
    rest = _rest(TermTable(tuple(model.terms[m] for m in quiet)), model.theta[quiet], equations, swings)
    return data if rest is None else [replace(one, output_origin=model.output_origin + rest) for one in data]


def _rest(table: TermTable, theta: Array, equations: list[int], swings: Array) -> Array | None:
    """Return outputs with y = f(y) near zero, shape (n_outputs,); None if there are none."""
    from scipy.optimize import root

    def imbalance(y: Array) -> Array:
        values = np.array([(y * swings)[variable.index] for variable in table.variables])
        return np.bincount(equations, weights=theta * table.at(values), minlength=y.size) / swings - y

    found = root(imbalance, np.zeros(swings.size))
    return found.x * swings if found.success and np.all(np.abs(found.x) <= 1.0) else None


def _origins(signals: list[Array], kept: list[int]) -> Array:
    joined = np.concatenate(signals, axis=1)
    swing = np.ptp(joined, axis=1)
    mean = np.where(swing > 0, joined.mean(axis=1), joined[:, 0])  # a constant is its own mean, to the last bit
    mean[kept] = 0.0
    return np.where(np.abs(mean) <= swing, 0.0, mean)
