"""Recordings from files and into files.

A recording has the columns ``time_s,command_V,displacement_mm``; further channels may be ``film_voltage_V``,
``current_uA``, ``temperature_C`` and ``force_N``; other columns are passed over. The last part of a name is its unit
and may be another one of the same kind. Inside, everything is in SI units. The end of the file's name says its
format: CSV (``.csv``, ``.txt``, ``.tsv``), MATLAB (``.mat``), TDMS (``.tdms``), NetCDF (``.nc``).

What `write_recording` writes reads back as the same recording to the last bit.
"""

from deatwin.plant.files.recordings import (
    read_commands,
    read_experiment,
    read_recording,
    read_recordings,
    write_csv,
    write_recording,
    write_text_atomic,
)

__all__ = [
    "read_commands",
    "read_experiment",
    "read_recording",
    "read_recordings",
    "write_csv",
    "write_recording",
    "write_text_atomic",
]
