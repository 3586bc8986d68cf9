"""Recordings in the forms of other libraries, for `Recording.to_pandas` and its neighbours."""

from typing import Any

from deatwin.plant.files.formats.description import KEY, describe, header_with_unit, plain_header, rows_of, signals_of
from deatwin.plant.files.formats.optional import require
from deatwin.plant.recording import Recording, label


def as_data_frame(recording: Recording) -> Any:
    """Return a recording as a data frame."""
    pandas = require("pandas", "a data frame")
    signals = signals_of(recording, header_with_unit, taken=["time_s"])
    frame = pandas.DataFrame(
        dict(zip((signal.header for signal in signals), rows_of(recording), strict=True)),
        index=pandas.Index(recording.timepts, name="time_s"),
    )
    frame.attrs[KEY] = describe(recording, signals)
    return frame


def as_dataset(recording: Recording) -> Any:
    """Return a recording as a dataset, which is also its form in NetCDF files."""
    xarray = require("xarray", "a dataset")
    signals = signals_of(recording, plain_header, taken=["time"])
    variables = {}
    for signal, row in zip(signals, rows_of(recording), strict=True):
        about = {"long_name": signal.name, "role": signal.role, "units": signal.unit}
        variables[signal.header] = ("time", row, {key: value for key, value in about.items() if value})
    return xarray.Dataset(
        variables,
        coords={"time": ("time", recording.timepts, {"units": "s", "long_name": "time on the running clock"})},
        attrs={KEY: describe(recording, signals), "sample_time": recording.sample_time},
    )


def as_input_output_data(recording: Recording) -> Any:
    """Return a recording as the package nonlinear_benchmarks has it."""
    benchmarks = require("nonlinear_benchmarks", "Input_output_data")
    u, y = (rows[0] if len(rows) == 1 else rows.T for rows in (recording.inputs, recording.outputs))
    return benchmarks.Input_output_data(u=u, y=y, sampling_time=recording.sample_time, name=label(recording))
