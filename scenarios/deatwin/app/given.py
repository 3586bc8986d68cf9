"""Load the plant and the recordings given to a command."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from deatwin.ident.narx import NarxModel
from deatwin.ident.nss.document import SCHEMA as STATES
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.checks import check_command_range, check_motion, falls_with_voltage
from deatwin.plant.documents import read_json
from deatwin.plant.errors import ModelError
from deatwin.plant.files import read_commands, read_experiment
from deatwin.plant.files.headers import split_unit
from deatwin.plant.files.units import UNITS
from deatwin.plant.files.usual import COLUMNS, usual_unit
from deatwin.plant.readoptions import NO_OPTIONS, ReadOptions
from deatwin.plant.recording import Experiment, Recording, label
from deatwin.plant.rigs.rigfile import RigFile
from deatwin.plant.rigs.rigkeys import AGAINST
from deatwin.plant.sources import load_plant, read_described


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenPlant:
    """A plant given on the command line."""

    source: str  # Rig file, ``model.json`` or ``module:function``
    model: CalibratedPlant  # The plant
    described: RigFile | None  # The rig file, used for its command range
    options: ReadOptions  # Options for reading recordings; by default columns have the names of the plant's own signals

    @classmethod
    def load(cls, source: str, asked: ReadOptions = NO_OPTIONS) -> GivenPlant:
        """Load the plant."""
        described = read_described(source) if source.endswith(".toml") else None
        model = load_plant(described or source)
        rig = model.plant.rig
        usual = ReadOptions(
            input_column=_own_column(rig.input_name, rig.input_unit),
            output_column=_own_column(rig.output_name, rig.output_unit),
        )
        return cls(
            source=source,
            model=model,
            described=described if isinstance(described, RigFile) else None,
            options=usual | asked,
        )

    def experiment(self, files: Iterable[str | Path]) -> Experiment:
        """Read recordings of one experiment."""
        rig = self.model.plant.rig
        read = read_experiment(
            files,
            **self.options.given,
            reading=rig.reading,
            input_unit=rig.input_unit,
            output_unit=rig.output_unit,
            readings=rig.further,
        )
        if self.described is not None:
            for record in read.recordings:
                check_command_range(record, self.described.drive)
                check_motion(record, self.described.widest)
        return read

    def commands(self, file: str | Path) -> Recording:
        """Read the commands of a file; its readings are ignored."""
        rig = self.model.plant.rig
        options = self.options.without("output_column", "allow_gaps").given
        return read_commands(file, **options, reading=rig.reading, input_unit=rig.input_unit, rig=self.described)


def narx_model(file: str | Path) -> NarxModel:
    """Read a NARX model; for a nonlinear state space, say what works instead."""
    document = read_json(file)
    if isinstance(document, dict) and document.get("schema") == STATES:
        raise ModelError(
            f"{file}: this is a nonlinear state space, but this command takes only NARX models: identify the same recordings "
            "again with --method frols or grow; a state space can be simulated in Python "
            "(deatwin.ident.nss.NonlinearStateSpace.load)"
        )
    return NarxModel.load(file)


def direction_notes(plant: GivenPlant, records: Sequence[Recording]) -> list[str]:
    """Return a sentence if the readings move against the direction stated in the rig file."""
    if plant.described is None or plant.described.sensor.direction == AGAINST or not falls_with_voltage(records):
        return []
    return [
        f"in the recordings the {plant.model.plant.rig.output_name} falls when the voltage rises, but in the simulation of this "
        f"{plant.described.kind} it rises; "
        f'if the sensor is mounted on the other side, write direction = "{AGAINST}" under [sensor] of {plant.source}'
    ]


def absent_readings(plant: GivenPlant, records: Sequence[Recording]) -> list[str]:
    """Return a sentence for each further reading of the rig that no recording contains."""
    recorded = {name for record in records for name in record.extras}
    return [
        f'no recording contains the reading "{reading.name}" of {plant.source}, so this reading is not used'
        for reading in plant.model.plant.rig.further
        if reading.name not in recorded
    ]


def column_of(name: str, unit: str) -> tuple[str, float]:
    """Return the column header for a signal with an SI unit, and the factor to the column's unit."""
    if name not in COLUMNS or usual_unit(name) != unit:  # another quantity, or a unit of the rig's own
        return (name if unit in ("", "1") else f"{name}_{unit}"), 1.0
    shown = UNITS[split_unit(COLUMNS[name])[1]]
    return COLUMNS[name], shown.denominator / shown.numerator


def _own_column(name: str, unit: str) -> str | None:
    """Return the header under a signal's own name, if it is unusual in recordings or has another unit."""
    return None if name in ("command", "displacement") and usual_unit(name) == unit else name


def clock_notes(records: Iterable[Recording]) -> list[str]:
    """Return a sentence for each change made to the clock of a recording."""
    return [
        f"{label(record)}: {said}"
        for record in records
        for key in ("resampled", "clock")
        if (said := record.provenance.get(key))
    ]
