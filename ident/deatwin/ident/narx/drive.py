"""The signals that drive a free run: a recording, or inputs with initial outputs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from deatwin.ident.arguments import read_only
from deatwin.plant.arrays import Array, real_numbers
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.recording import UNSTATED, Recording


@dataclass(frozen=True, kw_only=True, eq=False)
class Drive:
    """Inputs of a free run, and the outputs from which it starts."""

    inputs: Array  # shape (n_inputs, n): Inputs
    outputs: Array  # shape (n_outputs, n): Outputs; only the samples before ``first`` are used
    measured: Array  # shape (n_outputs, n): Known outputs; NaN elsewhere
    timepts: Array  # shape (n,): Times of the samples in s
    first: int  # First sample to be computed

    @classmethod
    def of(
        cls,
        given: Recording | ArrayLike,
        initial: ArrayLike | None,
        *,
        input_names: Sequence[str],
        n_outputs: int,
        sample_time: float,
        first: int,
        fewest: int,
    ) -> Drive:
        """Prepare a run driven by inputs `given` (n,) or (n_inputs, n), from `initial` outputs before sample `first`."""
        inputs = given.inputs if isinstance(given, Recording) else _inputs(given, input_names)
        n = inputs.shape[1]
        known = np.zeros((n_outputs, first)) if initial is None else _initial(initial, n_outputs, fewest)
        first = max(first, known.shape[1])
        if n <= first:
            raise ModelError(
                f"the inputs have {n} samples; the run starts after {first}, so that at least {first + 1} are needed"
            )
        measured = np.full((n_outputs, n), np.nan)
        measured[:, first - known.shape[1] : first] = known
        outputs = np.nan_to_num(measured)
        timepts = given.timepts if isinstance(given, Recording) else sample_time * np.arange(n, dtype=np.float64)
        return cls(
            inputs=inputs, outputs=outputs, measured=read_only(measured), timepts=read_only(timepts), first=first
        )

    @classmethod
    def recorded(cls, recording: Recording, first: int) -> Drive:
        """Prepare a run that starts at sample `first` from the outputs of a recording before it."""
        return cls(
            inputs=recording.inputs,
            outputs=recording.outputs,
            measured=recording.outputs,
            timepts=recording.timepts,
            first=first,
        )


class Signals(Protocol):
    """The signals of a model: sample time in s, names and units of inputs and outputs."""

    @property
    def sample_time(self) -> float: ...
    @property
    def input_names(self) -> Sequence[str]: ...
    @property
    def output_names(self) -> Sequence[str]: ...
    @property
    def input_units(self) -> Sequence[str]: ...
    @property
    def output_units(self) -> Sequence[str]: ...


def signals_like(owner: Signals) -> dict[str, Any]:
    """Return sample time, names and units of the signals of a recording or a model, as fields of a model."""
    names = [f"{side}_{what}" for what in ("names", "units") for side in ("input", "output")]
    return {name: getattr(owner, name) for name in ("sample_time", *names)}


def require_suits(recording: Recording, model: Signals, *, with_outputs: bool, fewest: int) -> None:
    """Raise ModelError unless a recording has the model's sample time, signals and units and `fewest` samples."""
    if not isinstance(recording, Recording):
        raise ModelError(
            f"a {type(recording).__name__} is not a recording: give one recording; Recording.from_arrays makes it of arrays"
        )
    if not math.isclose(recording.sample_time, model.sample_time, rel_tol=1e-6):
        raise ModelError(
            f"the recording has a sample time of {recording.sample_time:g} s, the model of {model.sample_time:g} s"
        )
    kinds = ("input", "output") if with_outputs else ("input",)
    wanted = [len(getattr(model, f"{kind}_names")) for kind in kinds]
    rows = (recording.inputs.shape[0], recording.outputs.shape[0])
    if wanted != list(rows[: len(kinds)]):
        held = f"the model {' and '.join(map(str, wanted))}"
        raise ModelError(f"the recording has {rows[0]} inputs and {rows[1]} outputs, {held}")
    if moved := order_apart(recording, model, kinds):
        raise ModelError(f"the recording's {moved}; give them in the model's order")
    for kind in kinds:
        names, units, known = (
            getattr(owner, f"{kind}_{what}")
            for owner, what in ((recording, "names"), (recording, "units"), (model, "units"))
        )
        stated = ["" if pair == UNSTATED[kind] else pair[1] for pair in zip(names, units, strict=True)]
        for text in units_apart(names, known, stated):
            raise ModelError(f"{text}: the first is the model's unit; give the recording in it")
    if recording.n_samples < fewest:
        raise ModelError(f"the recording has {recording.n_samples} samples; the model needs at least {fewest}")


def order_apart(recording: Recording, other: Signals, kinds: Sequence[str] = ("input", "output")) -> str:
    """Return a text if a name is in both at different places, else ""; signals of other names are taken by position."""
    for kind in kinds:
        names, others = getattr(recording, f"{kind}_names"), getattr(other, f"{kind}_names")
        if any(name != known and name in others for name, known in zip(names, others, strict=False)):
            return f"{kind}s are {', '.join(names)}, in another order than {', '.join(others)}"
    return ""


def units_apart(names: Sequence[str], units: Sequence[str], others: Sequence[str]) -> list[str]:
    """Return a text for each signal whose two units differ; a unit that was not stated contradicts none."""
    triples = zip(names, units, others, strict=True)
    return [f"{name} in {a} and in {b}" for name, a, b in triples if a != b and not {a, b} & {"", "1"}]


def _numbers(values: ArrayLike, what: str) -> Array:
    try:
        return real_numbers(values, what)
    except DataError as error:
        raise ModelError(str(error)) from None


def _inputs(given: ArrayLike, names: Sequence[str]) -> Array:
    """Return inputs as rows."""
    inputs = _numbers(given, "inputs")
    count = len(names)
    rows = inputs[None] if inputs.ndim == 1 and count == 1 else inputs
    if rows.ndim != 2 or rows.shape[0] != count:
        wanted = "(n,) or (1, n)" if count == 1 else f"({count}, n)"
        turned = "; transpose them" if inputs.ndim == 2 and inputs.shape[1] == count else ""
        raise ModelError(
            f"inputs have the shape {inputs.shape}; the model takes {wanted}, "
            f"a row for each of {', '.join(names) or 'no inputs'}{turned}"
        )
    if not np.all(np.isfinite(rows)):
        row, sample = np.argwhere(~np.isfinite(rows))[0]
        raise ModelError(f"the input {names[row]} is {rows[row, sample]} at sample {sample}; a run needs all inputs")
    return np.ascontiguousarray(rows)


def _initial(initial: ArrayLike, n_outputs: int, fewest: int) -> Array:
    """Return the outputs before a run, shape (n_outputs, m), up to the first unknown one."""
    values = _numbers(initial, "initial")
    rows = values[None] if values.ndim == 1 and n_outputs == 1 else values
    if rows.ndim != 2 or rows.shape[0] != n_outputs:
        wanted = "(m,) or (1, m)" if n_outputs == 1 else f"({n_outputs}, m)"
        raise ModelError(f"initial has the shape {values.shape}; the model takes {wanted}, a row for each output")
    if np.any(np.isinf(rows)):
        raise ModelError("initial has an infinite value; give NaN for outputs that are not known")
    finite = ~np.any(np.isnan(rows), axis=0)
    count = int(finite.size if finite.all() else np.argmin(finite))
    if np.any(finite[count:]):
        raise ModelError(f"initial has no number at sample {count} but numbers after it; take away what comes before")
    if count < fewest:
        raise ModelError(
            f"initial holds {count} values of each output; the model needs at least {fewest}, the newest last"
        )
    return rows[:, :count]
