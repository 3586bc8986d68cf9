"""Recordings and experiments, the common form of all data in deatwin."""

import logging
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from os import PathLike
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.arrays import read_only, real_numbers, rows_of_signals, seconds, texts
from deatwin.plant.copies import Rebuilt
from deatwin.plant.errors import DataError, nearest
from deatwin.plant.files.formats.optional import require
from deatwin.plant.files.headers import split_unit
from deatwin.plant.files.units import UNITS
from deatwin.plant.files.usual import usual_unit
from deatwin.plant.words import spaced

UNSTATED = {"input": ("command", "V"), "output": ("displacement", "m")}
"""Name and unit of a single signal if none are given."""
# Two clocks that drift apart by less than this share of a sample over a record count as one.
_CLOCK_TOLERANCE = 0.1
_LONG = 1.5  # Step of an index from which rows are missing, in usual steps
_ROUNDED = 0.1  # Least share of unequal steps if the times of an index are rounded
_RATE = 10.0  # Least whole number of seconds that may rather be a sample rate in Hz
_CLOCK = ((1, 60), (60, 3600), (3600, 86400))  # Units of time, s, each with the next larger one

logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Recording(Rebuilt):
    """Evenly sampled inputs and outputs of a system, in SI units.

    Parameters
    ----------
    inputs : (n_inputs, n) array
        Inputs, in the units `input_units`; by default a command in V.
    outputs : (n_outputs, n) array
        Outputs, in the units `output_units`; by default a displacement in m. A recording of commands alone has no rows
        here.
    sample_time : float
        Time between two samples, s.
    start : float
        Time of the first sample on the clock of the experiment, s.
    input_names, output_names : tuple of str
        Name of each input and of each output.
    input_units, output_units : tuple of str
        SI unit of each input and of each output; empty if unknown.
    extras : mapping of str to (n,) array
        Further channels by name, in SI units, for example ``temperature`` in K; NaN marks a missing value.
    extra_units : mapping of str to str
        SI unit of each further channel, by name. By default, channels with a name that deatwin knows, such as
        ``temperature``, have the usual SI unit, and others have none.
    provenance : mapping of str to str
        Origin of the samples, for example ``{"file": "test.csv"}``.

    Raises
    ------
    DataError
        If an array has the wrong shape; if the number of names or of units differs from the number of rows; if a name
        or a unit is not text; if two inputs or two outputs have the same name; if an input or an output is not finite,
        or a further channel is infinite; or if the sample time is not positive.
    """

    inputs: NDArray[np.float64]
    outputs: NDArray[np.float64]
    sample_time: float
    start: float = 0.0
    input_names: tuple[str, ...] = ("command",)
    output_names: tuple[str, ...] = ("displacement",)
    input_units: tuple[str, ...] = ("V",)
    output_units: tuple[str, ...] = ("m",)
    extras: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    extra_units: Mapping[str, str] = field(default_factory=dict)
    provenance: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for what in ("sample_time", "start"):
            object.__setattr__(self, what, seconds(getattr(self, what), what))
        if not (np.isfinite(self.sample_time) and self.sample_time > 0.0):
            raise DataError(f"sample time {self.sample_time} s: it must be positive")
        if not np.isfinite(self.start):
            raise DataError(f"start of the recording {self.start} s: it must be finite")
        n = None
        for kind in ("input", "output"):
            values = read_only(real_numbers(getattr(self, f"{kind}s"), f"{kind}s"))
            names, units = (texts(getattr(self, f"{kind}_{what}")) for what in ("names", "units"))
            if values.ndim != 2 or values.shape[1] != (n := values.shape[1] if n is None else n):
                wanted = "samples" if n is None else f"{n} samples"
                raise DataError(f"{kind}s have the shape {values.shape}: it must be ({kind} count, {wanted})")
            _require_texts(f"the names and units of {kind}s", (*names, *units))
            if not len(names) == len(units) == len(values):
                raise DataError(f"{len(values)} {kind}s, {len(names)} names and {len(units)} units of them")
            if len(set(names)) < len(names):
                twice = next(name for name in names if names.count(name) > 1)
                raise DataError(f'two {kind}s of the recording are named "{twice}": give each a name of its own')
            for name, row in zip(names, values, strict=True):
                _require_finite(name, row)
            for what, checked in (("s", values), ("_names", names), ("_units", units)):
                object.__setattr__(self, f"{kind}{what}", checked)
        for what in ("extras", "extra_units", "provenance"):
            if not isinstance(given := getattr(self, what), Mapping):
                raise DataError(f"{what} must be a mapping of names to values; got a {type(given).__name__}")
        extras = {
            name: read_only(real_numbers(values, f'extra channel "{name}"')) for name, values in self.extras.items()
        }
        for name, values in extras.items():
            if values.shape != (n,):
                raise DataError(f'extra channel "{name}" has the shape {values.shape}: it must be ({n},)')
            if np.isinf(values).any():
                raise DataError(f'extra channel "{name}" is infinite at sample {int(np.argmax(np.isinf(values)))}')
        _require_texts("the names of extra channels", tuple(extras))
        extra_units = {name: self.extra_units.get(name, usual_unit(name)) for name in extras}
        _require_texts("the units of extra channels", tuple(extra_units.values()))
        for what, mapping in (("extras", extras), ("extra_units", extra_units), ("provenance", self.provenance)):
            object.__setattr__(self, what, dict(mapping))

    @classmethod
    def from_arrays(
        cls,
        inputs: ArrayLike,
        outputs: ArrayLike,
        sample_time: float,
        *,
        start: float = 0.0,
        input_names: Sequence[str] | None = None,
        output_names: Sequence[str] | None = None,
        input_units: Sequence[str] | None = None,
        output_units: Sequence[str] | None = None,
        extras: Mapping[str, ArrayLike] | None = None,
        extra_units: Mapping[str, str] | None = None,
        provenance: Mapping[str, str] | None = None,
    ) -> Self:
        """Make a recording from arrays, lists or columns of a data frame.

        Parameters
        ----------
        inputs, outputs : (n,) or (rows, n) array_like
            Samples in SI units, with one row for each signal; a one-dimensional array is one signal.
        sample_time : float
            Time between two samples, s.
        start : float
            Time of the first sample, s.
        input_names, output_names : sequence of str, optional
            Name of each row. By default, a single input is called ``command`` and a single output ``displacement``;
            several inputs are called ``input_1``, ``input_2`` and so on, and several outputs ``output_1`` and so on.
        input_units, output_units : sequence of str, optional
            SI unit of each row. By default, a single signal without a given name is in V (input) or m (output); all
            other units are unknown (``""``).
        extras : mapping of str to (n,) array_like, optional
            Further channels in SI units.
        extra_units : mapping of str to str, optional
            SI unit of each further channel.
        provenance : mapping of str to str, optional
            Origin of the samples.

        Raises
        ------
        DataError
            Same as for the class; if there are more rows than samples, which means that rows and columns are
            interchanged; if `inputs` and `outputs` are columns of data frames, or arrays of xarray, whose indexes
            differ, are uneven, or give times at another distance than `sample_time`; or if `extra_units` names a
            channel that is not in `extras`.

        Examples
        --------
        >>> Recording.from_arrays([1.0, 2.0, 3.0], [0.0, 1e-4, 2e-4], 0.02).outputs.shape
        (1, 3)
        """
        rows_in, rows_out = rows_of_signals(inputs, "inputs"), rows_of_signals(outputs, "outputs")
        sample_time = stated_seconds(sample_time, "sample_time")
        _require_even_index(inputs, outputs, sample_time)
        names_in, units_in = _labels("input", len(rows_in), input_names, input_units, UNSTATED["input"])
        names_out, units_out = _labels("output", len(rows_out), output_names, output_units, UNSTATED["output"])
        made = cls(
            inputs=rows_in,
            outputs=rows_out,
            sample_time=sample_time,
            start=start,
            input_names=names_in,
            output_names=names_out,
            input_units=units_in,
            output_units=units_out,
            extras={} if extras is None else extras,  # type: ignore[arg-type]  # the class makes arrays of them
            extra_units={} if extra_units is None else extra_units,
            provenance={} if provenance is None else provenance,
        )
        for name in extra_units or ():
            if name not in made.extras:
                raise DataError(
                    f'extra_units has a unit for "{name}", which is not among the extras{nearest(name, made.extras)}'
                )
        return made

    @property
    def n_samples(self) -> int:
        """Number of samples."""
        return int(self.inputs.shape[1])

    @property
    def timepts(self) -> NDArray[np.float64]:
        """Times of the samples on the clock of the experiment, shape (n,), s."""
        return self.start + self.sample_time * np.arange(self.n_samples, dtype=np.float64)

    @property
    def duration(self) -> float:
        """Duration of the recording, s: the number of samples times the sample time."""
        return self.n_samples * self.sample_time

    @property
    def end(self) -> float:
        """Time at which the last sample ends, s."""
        return self.start + self.duration

    def reading(self, name: str) -> NDArray[np.float64]:
        """Return the output or further channel called `name`, shape (n,), SI; all NaN if the recording lacks it.

        If `name` is empty, return the first output.
        """
        if not name:
            return np.asarray(self.outputs[0])
        if name in self.output_names:
            return np.asarray(self.outputs[self.output_names.index(name)])
        return self.extras.get(name, np.full(self.n_samples, np.nan))

    def section(self, first: int, last: int) -> Self:
        """Return the samples `first` to `last` - 1, on the same clock; DataError unless 0 <= first < last <= n."""
        whole = all(isinstance(end, int | np.integer) for end in (first, last))
        if not whole or not 0 <= first < last <= self.n_samples:
            raise DataError(
                f"section [{first}, {last}) of a record of {self.n_samples} samples; give two whole numbers from 0 to "
                f"{self.n_samples}, the larger one last"
            )
        return replace(
            self,
            inputs=self.inputs[:, first:last],
            outputs=self.outputs[:, first:last],
            start=self.start + first * self.sample_time,
            extras={name: values[first:last] for name, values in self.extras.items()},
        )

    def to_pandas(self) -> Any:
        """Return the recording as a `pandas.DataFrame` with the time in s as index."""
        from deatwin.plant.files.formats.description import KEY, describe, header_with_unit, rows_of, signals_of

        pandas = require("pandas", "a data frame")
        signals = signals_of(self, header_with_unit, taken=["time_s"])
        frame = pandas.DataFrame(
            dict(zip((signal.header for signal in signals), rows_of(self), strict=True)),
            index=pandas.Index(self.timepts, name="time_s"),
        )
        frame.attrs[KEY] = describe(self, signals)
        return frame

    def to_xarray(self) -> Any:
        """Return the recording as an `xarray.Dataset` over the time in s, as in a NetCDF file."""
        from deatwin.plant.files.formats.description import (
            KEY,
            describe,
            plain_header,
            rows_of,
            signals_of,
            unmistakable,
        )

        xarray = require("xarray", "a dataset")
        signals = signals_of(self, plain_header, taken=["time"])
        variables = {}
        for signal, row in zip(signals, rows_of(self), strict=True):
            about = {"long_name": signal.name, "role": signal.role, "units": unmistakable(signal.unit)}
            variables[signal.header] = ("time", row, {key: value for key, value in about.items() if value})
        return xarray.Dataset(
            variables,
            coords={"time": ("time", self.timepts, {"units": "s", "long_name": "time on the running clock"})},
            attrs={KEY: describe(self, signals), "sample_time": self.sample_time},
        )

    def to_input_output_data(self) -> Any:
        """Return the inputs and outputs as `nonlinear_benchmarks.Input_output_data`."""
        benchmarks = require("nonlinear_benchmarks", "Input_output_data")
        u, y = (rows[0] if len(rows) == 1 else rows.T for rows in (self.inputs, self.outputs))
        return benchmarks.Input_output_data(u=u, y=y, sampling_time=self.sample_time, name=label(self))

    def __repr__(self) -> str:
        signals = ", ".join(
            f"{name} [{unit or '?'}]"
            for name, unit in zip(
                self.input_names + self.output_names, self.input_units + self.output_units, strict=True
            )
        )
        return (
            f"<Recording: {self.n_samples} samples, every {self.sample_time:g} s\n"
            f"  clock {self.start:g} to {self.end:g} s\n"
            f"  {signals}>"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Experiment:
    """One or more recordings of one rig on a common clock, sorted by start time.

    Parameters
    ----------
    recordings : tuple of Recording
        One or more recordings, in any order.

    Raises
    ------
    DataError
        If there is no recording; if an entry is not a recording; if two recordings overlap in time; or if recordings
        differ in their sample times, in the names or units of their inputs or outputs, or in the unit of a further
        channel.
    """

    recordings: tuple[Recording, ...]

    def __post_init__(self) -> None:
        given = tuple(self.recordings) if isinstance(self.recordings, Iterable) else (self.recordings,)
        if not given:
            raise DataError("an experiment needs at least one recording")
        for one in given:
            if not isinstance(one, Recording):
                raise DataError(f"a {type(one).__name__} is not a recording: {way_to_record(one)}")
        ordered = tuple(sorted(given, key=lambda recording: recording.start))
        for before, after in pairwise(ordered):
            _require_one_clock(before, after)
        object.__setattr__(self, "recordings", ordered)

    @property
    def sample_time(self) -> float:
        """Time between two samples, s."""
        return self.recordings[0].sample_time

    @property
    def start(self) -> float:
        """Time of the first sample, s."""
        return self.recordings[0].start

    @property
    def end(self) -> float:
        """Time at which the last sample ends, s."""
        return self.recordings[-1].end

    @property
    def n_samples(self) -> int:
        """Total number of samples of all recordings."""
        return sum(recording.n_samples for recording in self.recordings)


def as_experiment(given: Experiment | Recording) -> Experiment:
    """Return an experiment; a single recording is an experiment of its own."""
    return given if isinstance(given, Experiment) else Experiment(recordings=(given,))


def stated_seconds(sample_time: object, what: str) -> float:
    """Return a sample time that a user states; warn if it may rather be a sample rate."""
    step = seconds(sample_time, what)
    if step >= _RATE and step.is_integer() and not _fits_the_clock(step):
        logger.warning("%s is %g s; if %g is the sample rate in Hz, give %.9g", what, step, step, 1.0 / step)
    return step


def _fits_the_clock(step: float) -> bool:
    """Return whether a number of seconds divides a minute, an hour or a day into whole units, as 15 s, 5 min or 2 h do."""
    return any(step % unit == 0 and larger % step == 0 for unit, larger in _CLOCK)


def way_to_record(given: object) -> str:
    """Return how to make a recording of what was given in place of one."""
    if isinstance(given, str | PathLike):
        return "read a Recording from a file with read_recording"
    return "make a Recording of arrays with Recording.from_arrays"


def label(recording: Recording) -> str:
    """Return the name of a recording in error texts: its file, or its times."""
    return recording.provenance.get("file") or f"recording of {recording.start:g} to {recording.end:g} s"


def _require_one_clock(before: Recording, after: Recording) -> None:
    """Raise DataError unless the second recording can follow the first in one experiment."""
    pair = f"{label(before)} and {label(after)}"
    drift = abs(after.sample_time - before.sample_time) * max(before.n_samples, after.n_samples)
    if drift > _CLOCK_TOLERANCE * before.sample_time:
        raise DataError(
            f"{pair}: sample times {before.sample_time:g} s and {after.sample_time:g} s; "
            "the recordings of one experiment must have the same sample time"
        )
    if after.start < before.end - _CLOCK_TOLERANCE * before.sample_time:
        raise DataError(
            f"{pair}: they overlap between {after.start:g} s and {min(before.end, after.end):g} s; "
            "recordings given together form one experiment and share its clock; "
            "to give separate experiments, put --experiment before the files of each"
        )
    for kind in ("input_names", "output_names", "input_units", "output_units"):
        if getattr(before, kind) != getattr(after, kind):
            raise DataError(
                f"{pair}: {spaced(kind)} differ: "
                f"{', '.join(getattr(before, kind))} and {', '.join(getattr(after, kind))}"
            )
    for name, unit in before.extra_units.items():
        other = after.extra_units.get(name, unit)
        if unit and other and unit != other:
            raise DataError(f'{pair}: units of "{name}" differ: {unit} and {other}')


def _labels(
    kind: str, count: int, names: Sequence[str] | None, units: Sequence[str] | None, single: tuple[str, str]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return names and units of the rows, with the defaults that `Recording.from_arrays` documents."""
    if names is None and count == 1:
        return (single[0],), texts(units) if units is not None else (single[1],)
    names = texts(names) if names is not None else tuple(f"{kind}_{row + 1}" for row in range(count))
    return names, texts(units) if units is not None else ("",) * count


def _require_even_index(inputs: Any, outputs: Any, sample_time: float) -> None:
    """Raise DataError if columns of a data frame or arrays of xarray, (n,), differ in their rows, or these are uneven."""
    indexes = [index for index in map(_index, (inputs, outputs)) if index is not None]
    if len(indexes) == 2 and not indexes[0].equals(indexes[1]):
        raise DataError(
            "the indexes of inputs and outputs differ, so their rows do not belong together; align the columns, or pass "
            ".to_numpy() of each where the order alone counts"
        )
    for index in indexes[:1]:
        steps, timed = _index_steps(index)
        if steps.size == 0:
            continue
        usual, mean = float(np.nanmedian(steps)), float(np.mean(steps))
        # Many unequal steps are those of times with few digits.
        unequal = float(np.mean(np.abs(steps - usual) > 1e-6 * usual)) if timed else 0.0
        long = (_LONG if unequal < _ROUNDED else _LONG + 1.0) * usual
        odd = np.flatnonzero(~((steps > 0.0) & (steps < long)))  # also where a time is missing
        if odd.size:
            raise DataError(
                f"the index goes from {index[odd[0]]} to {index[odd[0] + 1]} at sample {odd[0] + 1}, so the rows are not evenly "
                "spaced; sort them, and fill gaps, or pass .to_numpy() of each column where the order alone counts"
            )
        if timed and abs(mean / sample_time - 1.0) > _CLOCK_TOLERANCE:
            raise DataError(
                f"the index advances by {mean:g} s, but sample_time is {sample_time:g} s; give the sample time in s, or pass "
                ".to_numpy() of each column if the index is not the time"
            )


def _index_steps(index: Any) -> tuple[NDArray[np.float64], bool]:
    """Return the steps of an index, (n - 1,), and whether they are in s; no steps if the index is neither times nor numbers."""
    index = index.to_timestamp() if hasattr(index, "to_timestamp") else index  # periods
    index = index.tz_convert(None) if getattr(index, "tz", None) is not None else index
    values, unit = index.to_numpy(), UNITS[split_unit(str(index.name))[1]]
    if values.dtype.kind in "mM":
        return np.diff(values) / np.timedelta64(1, "s"), True
    if values.dtype.kind not in "iuf":
        return np.zeros(0), False
    timed = unit.si == "s"
    return np.diff(values.astype(np.float64)) * (unit.numerator / unit.denominator if timed else 1.0), timed


def _index(values: Any) -> Any:
    """Return the index of a column of a data frame or of an array of xarray, (n,); None if there is none."""
    if np.ndim(values) != 1:
        return None
    return values.index if hasattr(values, "iloc") else next(iter(getattr(values, "indexes", {}).values()), None)


def _require_texts(what: str, given: tuple[object, ...]) -> None:
    """Raise DataError unless all names and units are texts."""
    if not all(isinstance(text, str) for text in given):
        raise DataError(f"{what} must be texts; got {', '.join(map(repr, given))}")


def _require_finite(name: str, values: NDArray[np.float64]) -> None:
    """Raise DataError if a channel contains a value that is not finite."""
    finite = np.isfinite(values)
    if not finite.all():
        sample = int(np.argmin(finite))
        raise DataError(
            f'channel "{name}" is {values[sample]} at sample {sample}: every value must be finite; fill it in, or make a '
            "recording of the samples on each side of it"
        )
