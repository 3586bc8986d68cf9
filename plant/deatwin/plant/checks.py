"""Check a recording before it is used; each failure raises one clear error."""

from collections.abc import Sequence

import numpy as np

from deatwin.plant.amplitudes import amount
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.files.units import UNITS, find_unit
from deatwin.plant.recording import UNSTATED, Experiment, Recording, as_experiment, label
from deatwin.plant.rigs.base import Rig
from deatwin.plant.rigs.rigfile import DriveSpec
from deatwin.plant.rigs.rigkeys import HIGHEST_FILM_VOLTAGE

# Tolerated excess over the stated command range, as a share of its width.
_RANGE_MARGIN = 0.5
# Least and largest stretch of a strip in a test machine, where the rig file states none: a shorter strip hangs slack.
_PULLED = (0.9, 20.0)
_LEAST_FILM_VOLTAGE = 20.0  # V, below which no film moves
# Least share of the highest command that a column of film volts uses, once divided by the gain: it drives a film.
_LEAST_USE = 0.01
# Percentiles that bound the motion: 90 % of the samples lie between them, so that spikes do not count.
_MOST_SAMPLES = (5.0, 95.0)


def require_excitation(recordings: Sequence[Recording]) -> None:
    """Raise an error if every input is constant in all recordings; one constant record among others is a rest."""
    if any(np.ptp(recording.inputs, axis=1).any() for recording in recordings if recording.n_samples):
        return
    files = ", ".join(label(recording) for recording in recordings) or "no recordings"
    raise DataError(f"{files}: the input is constant throughout; it must vary in at least one recording")


def require_samples(recordings: Sequence[Recording], needed: int, what: str) -> None:
    """Raise an error if recordings together are too short for a model. `needed` is the smallest number of samples."""
    found = sum(recording.n_samples for recording in recordings)
    if found < needed:
        names = ", ".join(dict.fromkeys(label(recording) for recording in recordings))
        raise ModelError(f"{names}: {found} samples, but {what} needs at least {needed}")


def experiment_for(rig: Rig, given: Experiment | Recording) -> Experiment:
    """Return an experiment, after a check that a rig can take its commands; a single recording starts from rest."""
    experiment = as_experiment(given)
    for recording in experiment.recordings:
        check_command(recording, rig)
    return experiment


def check_command(recording: Recording, rig: Rig) -> None:
    """Raise an error unless a recording has one input, in the unit in which the rig takes its command."""
    if (count := len(recording.inputs)) != 1:
        raise DataError(
            f"{label(recording)}: it has {count} inputs, but the plant takes one, {rig.input_name}; give other measured "
            "signals as extras of the recording"
        )
    _check_units(recording, [("input", recording.input_names, recording.input_units, rig.input_unit)])


def check_units(recording: Recording, rig: Rig) -> None:
    """Raise an error if a reading has another place or unit than in the rig, or the command another unit."""
    check_command(recording, rig)
    rows = [("output", recording.output_names, recording.output_units, rig.output_unit)]
    further = {reading.name: reading.unit for reading in rig.further}
    first = next(zip(recording.output_names, recording.output_units, strict=True), UNSTATED["output"])
    if (first[0] in further and first != UNSTATED["output"]) or rig.output_name in recording.output_names[1:]:
        raise DataError(
            f'{label(recording)}: its first output is "{first[0]}", but the first reading of the rig is '
            f'"{rig.output_name}"; put the row of that reading first'
        )
    for name, unit in {
        **dict(zip(recording.output_names[1:], recording.output_units[1:], strict=True)),
        **recording.extra_units,
    }.items():
        rows += [("reading", (name,), (unit,), further[name])] if name in further else []
    _check_units(recording, rows)


def _check_units(recording: Recording, rows: list[tuple[str, tuple[str, ...], tuple[str, ...], str]]) -> None:
    """Raise an error if the first signal of a row (kind, names, units, unit wanted) is in another unit."""
    for kind, names, units, wanted in rows:
        for name, unit in list(zip(names, units, strict=True))[:1]:
            stated = unit and wanted and (name, unit) != UNSTATED.get(kind)
            here, there = UNITS[find_unit(unit)], UNITS[find_unit(wanted)]
            if not stated or unit == wanted or (here.si and here == there):
                continue
            factor = here.onto(there, wanted) if here.si and here.si == there.si else None
            times = f", {factor.numerator / factor.denominator:g} times these" if factor and not factor.shift else ""
            raise DataError(
                f'{label(recording)}: the {kind} "{name}" is in {unit}, but the model needs it in {wanted}; give a '
                f"recording with the values in {wanted}{times}"
            )


def check_command_range(recording: Recording, drive: DriveSpec) -> None:
    """Raise an error for commands beyond the rig's range, stated or usual, by more than half of it."""
    ceiling = HIGHEST_FILM_VOLTAGE / drive.gain
    least, largest = (-ceiling, ceiling) if drive.unit == "V" else _PULLED
    low = least if drive.command_min is None else drive.command_min
    high = largest if drive.command_max is None else drive.command_max
    margin = _RANGE_MARGIN * (high - low)
    stated = drive.command_min is not None and drive.command_max is not None
    floor, top = (low - margin, high + margin) if stated else (low, high)

    command = recording.inputs[0]
    outside = (command < floor) | (command > top)
    if not outside.any():
        return
    sample = int(np.argmax(outside))
    worst = float(command[np.argmax(np.abs(command))])
    text = (
        f"{label(recording)}: a command of {amount(f'{worst:g}', drive.unit)} is outside the rig's range of commands, "
        f"{amount(f'{low:g}', drive.unit)} to {amount(f'{high:g}', drive.unit)} (the first one outside is at "
        f"{recording.timepts[sample]:g} s)"
    )
    as_stretch = 1.0 + command
    if drive.unit != "V" and as_stretch.min() >= low and as_stretch.max() <= high:
        text += "; the values look like strains: add 1 to the column"
    as_command = command / drive.gain
    used = max(low, _LEAST_USE * high)
    if as_command.min() >= floor and used <= as_command.max() <= top and np.abs(worst) >= _LEAST_FILM_VOLTAGE:
        text += (
            f"; the values look like voltages on the film: divide the column by the gain of {drive.gain:g}, so that "
            f"{worst:g} V becomes {worst / drive.gain:g} V"
        )
    elif stated and command.min() >= 1e3 * floor and 1e3 * used <= command.max() <= 1e3 * top:
        text += "; they differ by a factor of about 1000: correct the unit of the column, or the range in the rig file"
    raise DataError(text)


def check_motion(recording: Recording, widest: float) -> None:
    """Raise an error for impossibly large displacements. `widest` is the longest dimension of the rig, m."""
    if recording.outputs.shape[0] == 0:
        return
    span = float(np.ptp(np.percentile(recording.outputs[0], _MOST_SAMPLES)))
    if span <= widest:
        return
    text = f"{label(recording)}: the displacement moves over {1e3 * span:.3g} mm, in a rig of {1e3 * widest:.3g} mm"
    if 1e-3 * span <= widest:
        text += (
            "; this is a thousand times too much, as of µm under displacement_mm or of mm under displacement_m: correct "
            "the unit in the column's name, or divide the column by 1000"
        )
    raise DataError(text)


def falls_with_voltage(recordings: Sequence[Recording]) -> bool:
    """Return whether the readings mostly fall while the squared voltage, which moves a film, rises."""
    both = np.concatenate([[r.inputs[0] ** 2, r.outputs[0]] for r in recordings if len(r.outputs)], axis=1)
    both = both[:, np.isfinite(both).all(axis=0)]
    moves = both.shape[1] > 0 and np.ptp(both, axis=1).all()
    return bool(moves and np.corrcoef(both)[0, 1] < -np.sqrt(0.5))
