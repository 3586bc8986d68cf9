"""What a command was given: the plant, and the recordings that go with it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.errors import DataError
from deatwin.plant.files import read_commands, read_experiment
from deatwin.plant.files.columns import COLUMNS
from deatwin.plant.files.units import UNITS, split_unit
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.base import Rig
from deatwin.plant.rigs.rigfile import RigFile, read_rig
from deatwin.plant.sources import load_plant

__all__ = ["GivenPlant", "reading_column"]


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenPlant:
    """A plant as the command line named it.

    Parameters
    ----------
    source : str
        Rig file, ``model.json`` or ``module:function``.
    model : CalibratedPlant
        What it is.
    described : RigFile or None
        The rig file, whose command range is checked.
    input_column, output_column : str or None
        Columns asked for; by default those with the names of the plant's own signals.
    dt : float or None
        Sample time of files that hold no times, s.
    time_column : str or None
        Column of the times that was asked for.
    """

    source: str
    model: CalibratedPlant
    described: RigFile | None
    input_column: str | None
    output_column: str | None
    dt: float | None = None
    time_column: str | None = None

    @classmethod
    def load(
        cls,
        source: str,
        *,
        input_column: str | None = None,
        output_column: str | None = None,
        dt: float | None = None,
        time_column: str | None = None,
    ) -> GivenPlant:
        """Load the plant.

        Parameters
        ----------
        source : str
            As in the class.
        input_column, output_column, dt, time_column : optional
            As in the class.

        Returns
        -------
        GivenPlant

        Raises
        ------
        RigError, ModelError
            If the source does not give a plant.
        """
        model = load_plant(source)
        rig = model.plant.rig
        return cls(
            source=source,
            model=model,
            described=read_rig(source) if source.endswith(".toml") else None,
            input_column=input_column or _own_column(rig.input_name),
            output_column=output_column or _own_column(rig.output_name),
            dt=dt,
            time_column=time_column,
        )

    def experiment(self, files: Iterable[str | Path], *, allow_gaps: bool = False) -> Experiment:
        """Read recordings of one experiment.

        Parameters
        ----------
        files : iterable of path
            On one clock.
        allow_gaps : bool
            Split records at gaps; else a gap is an error.

        Returns
        -------
        Experiment

        Raises
        ------
        DataError
            If they cannot be read, or the readings are in no unit of the rig's.
        """
        read = read_experiment(
            files, input_column=self.input_column, output_column=self.output_column, time_column=self.time_column,
            allow_gaps=allow_gaps, dt=self.dt, rig=self.described,
        )  # fmt: skip
        for record in read.recordings:
            self._require_unit(record)
        return read

    def _require_unit(self, record: Recording) -> None:
        """A reading in mm without its unit would be taken for one in m."""
        rig, unit, name = self.model.plant.rig, record.output_units[0], record.output_names[0]
        if rig.output_unit in ("", "1") or unit == rig.output_unit:
            return
        usual = split_unit(COLUMNS.get(rig.output_name, f"{rig.output_name}_{rig.output_unit}"))[1]
        raise DataError(
            f'{record.provenance.get("file", "recording")}: the column "{name}" has the unit {unit or "(none)"}; it '
            f'must be one like {usual}: write the unit behind its name, as in "{name}_{usual}"'
        )

    def commands(self, file: str | Path) -> Recording:
        """Read the commands of a file; readings in it are not looked at.

        Parameters
        ----------
        file : path
            Any format that recordings come in.

        Returns
        -------
        Recording
        """
        return read_commands(
            file, input_column=self.input_column, time_column=self.time_column, dt=self.dt, rig=self.described
        )


def reading_column(rig: Rig) -> tuple[str, float]:
    """Column header for a rig's readings, and how many of its units one SI unit is.

    Parameters
    ----------
    rig : Rig
        Any.

    Returns
    -------
    tuple of str and float
        For example ``("displacement_mm", 1000.0)``.
    """
    header = COLUMNS.get(rig.output_name, f"{rig.output_name}_{rig.output_unit}")
    unit = UNITS.get(split_unit(header)[1], UNITS[""])
    return header, unit.denominator / unit.numerator


def _own_column(name: str) -> str | None:
    """A signal that recordings do not usually have is looked for under its own name."""
    return None if name in ("command", "displacement") else name
