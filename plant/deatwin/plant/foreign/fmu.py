"""Run FMUs of versions 2.0 and 3.0 as models, by FMPy."""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Any, Self

import numpy as np

from deatwin.plant.arrays import Array
from deatwin.plant.errors import RigError, nearest
from deatwin.plant.files.formats.optional import require
from deatwin.plant.files.units import UNITS, Unit, find_unit
from deatwin.plant.integrator.compiled import cache_folder
from deatwin.plant.rigs.base import ReadingTime, require_reading_time
from deatwin.plant.safe_read import reason

REAL = ("Real", "Float64", "Float32")
KINDS: Mapping[str, tuple[str, str]] = {
    "co-simulation": ("CoSimulation", "coSimulation"),
    "model exchange": ("ModelExchange", "modelExchange"),
}
"""Kinds of FMUs, each with FMPy's name for the type and for the part of the description."""
TOLERANCE = 1e-8
"""Relative tolerance of the solver. Derivatives are differences over steps of 1e-3, and a tolerance below the cube of
these steps would gain nothing."""
BEHIND = 1e-6
"""Time from a reading to the next command, as a share of a sample, so that a reading that follows its command at once
belongs to the sample that ends."""


@dataclass(frozen=True, kw_only=True)
class FmuModel:
    """FMU (functional mock-up unit) as the callable of a `ForeignRig`; make it with `FmuModel.of`.

    The call ``model(parameters, inputs, time)`` simulates a new instance of the FMU and returns the readings. The
    arguments are described in `ForeignRig`. Inputs and readings are in SI units; parameters are in the units that the
    FMU declares.

    Parameters
    ----------
    path : str
        File of the FMU.
    digest : str
        SHA-256 of the file. An FMU whose file has changed is not simulated.
    inputs : tuple of str
        Names of the input variables, the command first.
    output : str
        Name of the variable that is read.
    kind : str
        ``"co-simulation"`` or ``"model exchange"``.
    reading : ReadingTime
        Time within a sample at which the reading is taken.
    units : tuple of tuple of str
        Pairs of a variable's name and its unit in the FMU, for all inputs and the output.
    """

    path: str
    digest: str
    inputs: tuple[str, ...]
    output: str
    kind: str
    reading: ReadingTime = ReadingTime.END_OF_HOLD
    units: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(
        cls,
        path: str | os.PathLike[str],
        *,
        inputs: tuple[str, ...],
        output: str,
        kind: str | None = None,
        reading: ReadingTime = ReadingTime.END_OF_HOLD,
        units: Mapping[str, str] | None = None,
    ) -> Self:
        """Make the model from the file of an FMU.

        Parameters
        ----------
        path : str or PathLike
            File of the FMU.
        inputs : tuple of str
            Names of the input variables, the command first.
        output : str
            Name of the variable that is read.
        kind : str, optional
            ``"co-simulation"`` or ``"model exchange"``. By default co-simulation if the FMU offers it, otherwise model
            exchange.
        reading : ReadingTime
            Time within a sample at which the reading is taken.
        units : mapping of str to str, optional
            Units of inputs and output, by name. They replace the units that the FMU declares.

        Raises
        ------
        RigError
            If the file cannot be read as an FMU, a variable does not exist or is not real, the FMU does not offer
            `kind`, or `reading` is not a `ReadingTime`.
        """
        require_reading_time(reading, RigError)
        where, digest = os.path.abspath(path), _digest(path)
        described, _ = _unpacked(where, digest)
        offered = [name for name, (_, part) in KINDS.items() if getattr(described, part) is not None]
        chosen = kind or next(iter(offered), "")
        if chosen not in offered:
            raise RigError(f"{path}: it offers {' and '.join(offered) or 'no simulation'}, not {chosen or 'one'}")
        known = {**declared_units(where, digest), **(units or {})}
        for name in inputs:
            _variable(described, path, name, "input", ("input",))
        _variable(described, path, output, "output", ("output", "local", "calculatedParameter"))
        return cls(
            path=where,
            digest=digest,
            inputs=inputs,
            output=output,
            kind=chosen,
            reading=reading,
            units=tuple((name, known.get(name, "")) for name in (*inputs, output)),
        )

    def si_unit(self, name: str) -> str:
        """Return the SI unit of an input or of the output.

        Parameters
        ----------
        name : str
            Variable of the FMU.

        Returns
        -------
        str
            SI unit of the same quantity as the variable's unit in the FMU. A unit that deatwin does not know is
            returned unchanged; the unit of a variable without a unit is ``"1"``.
        """
        text = dict(self.units)[name]
        return self._unit(name).si or text or "1"

    def _unit(self, name: str) -> Unit:
        return UNITS[find_unit(dict(self.units)[name])]

    def __call__(self, parameters: Mapping[str, Any], inputs: Mapping[str, Array], time: Array) -> Array:
        """Return the readings, SI, (n,); inputs (n,) are held from row to row. RuntimeError if the FMU stops."""
        described, folder = _unpacked(self.path, self.digest)
        interval = float(time[1] - time[0]) if time.size > 1 else 1.0
        varying = {name: np.asarray(value) for name, value in parameters.items() if np.ndim(value)}
        held = {name: self._unit(name).from_si(inputs[name]) for name in self.inputs} | varying
        said: list[str] = []
        try:
            result = _fmpy().simulate_fmu(
                folder,
                validate=False,
                model_description=described,
                fmi_type=KINDS[self.kind][0],
                start_time=float(time[0]),
                stop_time=float(time[0]) + interval * time.size,
                output_interval=interval,
                relative_tolerance=TOLERANCE,
                record_events=False,
                start_values={n: float(v[0]) if np.ndim(v) else float(v) for n, v in parameters.items()},
                input=_signals(held, time, interval, jumps=self.kind == "model exchange"),
                output=[self.output],
                logger=lambda *arguments: said.append(_text(arguments[-1])),
            )
        except Exception as error:
            raise RuntimeError(f"{reason(error)}{f' ({said[-1]})' if said else ''}") from error
        rows = result[self.output]
        if len(rows) <= time.size:
            raise RuntimeError(f"the FMU stopped at {result['time'][-1]:.6g} s{f': {said[-1]}' if said else ''}")
        read = rows[: time.size] if self.reading is ReadingTime.START_OF_HOLD else rows[1 : time.size + 1]
        return self._unit(self.output).to_si(np.asarray(read, dtype=float))


def declared_units(path: str, digest: str) -> dict[str, str]:
    """Return the units that an FMU declares, by variable."""
    variables = _unpacked(path, digest)[0].modelVariables
    return {v.name: v.unit or getattr(v.declaredType, "unit", None) or "" for v in variables}


def parameter_of(model: FmuModel, name: str) -> Any:
    """Return the description of a real parameter or initial state, with `start`, `min`, `max` and `variability`."""
    described, _ = _unpacked(model.path, model.digest)
    found = _variable(described, model.path, name, "parameter", ("parameter", "local", "output"))
    if found.causality != "parameter" and found.initial != "exact":
        raise RigError(f"{model.path}: {name} is computed by the FMU; only parameters and initial values can be set")
    return found


def _variable(described: Any, path: Any, name: str, role: str, causalities: tuple[str, ...]) -> Any:
    real = {v.name: v for v in described.modelVariables if v.type in REAL and v.causality in causalities}
    if name not in real:
        known = [n for n, v in real.items() if v.causality == role]
        listed = f" (it has {', '.join(known[:12])}{', ...' if len(known) > 12 else ''})" if known else ""
        raise RigError(f"{path}: the FMU has no real {role} {name!r}{nearest(name, known)}{listed}")
    return real[name]


def _signals(held: Mapping[str, Array], time: Array, interval: float, *, jumps: bool) -> Array:
    """Return inputs in FMPy's format; each change becomes a jump just after the row's time."""
    stamps = np.append(time, time[-1] + interval)
    rows = np.append(np.arange(time.size), time.size - 1)
    if jumps:
        changed = 1 + np.flatnonzero(np.any([np.diff(values) != 0 for values in held.values()], axis=0))
        at = np.repeat(time[changed] + BEHIND * interval, 2)
        stamps = np.concatenate([time[:1], at, stamps[-1:]])
        rows = np.concatenate([[0], np.ravel([changed - 1, changed], order="F"), [time.size - 1]])
    table = np.zeros(stamps.size, dtype=[("time", float), *((name, float) for name in held)])
    table["time"] = stamps
    for name, values in held.items():
        table[name] = values[rows]
    return table


def _text(message: Any) -> str:
    return message.decode("utf-8", "replace").strip() if isinstance(message, bytes) else str(message)


def _fmpy() -> Any:
    return require("fmpy", "an FMU")


def _digest(path: str | os.PathLike[str]) -> str:
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError as error:
        raise RigError(f"{path}: the FMU cannot be read: {error.strerror}") from None


@lru_cache(maxsize=16)
def _unpacked(path: str, digest: str) -> tuple[Any, str]:
    """Return description and folder of an unpacked FMU, shared by all processes of this user."""
    fmpy = _fmpy()
    if (found := _digest(path)) != digest:
        raise RigError(f"{path}: the FMU has changed since this plant was saved ({found[:8]}, not {digest[:8]})")
    folder = cache_folder() / "fmu" / digest[:32]
    try:
        if not folder.is_dir():
            folder.parent.mkdir(mode=0o700, exist_ok=True)
            beside = mkdtemp(dir=folder.parent)
            fmpy.extract(path, unzipdir=beside)
            try:
                os.rename(beside, folder)
            except OSError:  # another process was faster
                shutil.rmtree(beside)
        described = fmpy.read_model_description(str(folder), validate=False)
    except Exception as error:
        raise RigError(f"{path}: it cannot be read as an FMU: {reason(error)}") from None
    if not str(described.fmiVersion).startswith(("2.", "3.")):
        raise RigError(f"{path}: it is an FMU of version {described.fmiVersion}; 2.0 and 3.0 can be run")
    return described, str(folder)
