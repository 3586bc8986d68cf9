"""Location of the mismatch in time, frequency, operating region and part of the plant."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from typing import ClassVar

import numpy as np

from deatwin.ident.mismatch.datasets import places
from deatwin.ident.mismatch.locate.frequency import Bands, Lines, locate_frequency, locate_lines
from deatwin.ident.mismatch.locate.place import Places, locate_place
from deatwin.ident.mismatch.locate.region import Regions, locate_region
from deatwin.ident.mismatch.locate.response import draw_response, locate_response
from deatwin.ident.mismatch.locate.time import Times, locate_time
from deatwin.ident.mismatch.locate.track import Unit, readings, tracks
from deatwin.ident.mismatch.located import LinesSummary, LocationSummary, ReadingLocation, ResponseDifference
from deatwin.ident.mismatch.model_error import error_in
from deatwin.ident.mismatch.naming.candidate import Candidate
from deatwin.ident.mismatch.problem import DiagnosisProblem
from deatwin.ident.mismatch.quality.quality import DataQuality
from deatwin.ident.mismatch.steps_take import checks_its_arguments
from deatwin.plant.amplitudes import amplitude_unit, written_amplitude
from deatwin.plant.datasets import Described, Metadata, attribute, several
from deatwin.plant.drawing import Axes
from deatwin.plant.recording import Recording


@dataclass(frozen=True, kw_only=True, eq=False)
class Location(Described):
    """Location of the mismatch in time, frequency, operating region and part of the plant.

    All fields except `readings` describe the first reading.

    Parameters
    ----------
    time : Times
        Intervals of time with a mismatch.
    frequency : Bands
        Frequency bands with a mismatch.
    lines : Lines or None
        Residual under a periodic input: at the excited spectral lines, at the other odd and even lines, and its part
        that varies between periods. None if no recording is periodic.
    region : Regions
        Ranges of operating signals, such as the command or the reading, in which the mean residual is not zero.
    place : Places
        How well the signals at each place of the plant predict the mismatch.
    response : tuple of ResponseDifference, or None
        Orders and frequency bands in which the recorded frequency response differs from that of the plant; None if this
        could not be tested.
    unit : tuple of str and float
        Unit in which amplitudes are reported, and its size in SI.
    readings : tuple of ReadingLocation or None
        Location in each reading other than the first; None if there is only one reading.
    """

    time: Times
    frequency: Bands
    lines: Lines | None
    region: Regions
    place: Places
    response: tuple[ResponseDifference, ...] | None
    unit: Unit
    readings: tuple[ReadingLocation, ...] | None = None

    DERIVED: ClassVar[Mapping[str, Metadata]] = {
        "tables": several(lambda found: places(found.summary, found.unit[0])),
        "period_s": attribute(of=attrgetter("time.period_s")),
    }

    @property
    def summary(self) -> LocationSummary:
        """Summarise the location for a diagnosis, with amplitudes in the reported unit."""
        size, lines = self.unit[1], self.lines
        return LocationSummary(
            time=tuple(replace(window, slope=window.slope / size) for window in self.time),
            period_s=self.time.period_s,
            frequency=self.frequency.bands,
            lines=None
            if lines is None
            else LinesSummary(
                period_s=lines.period_s,
                periods=lines.periods,
                groups=tuple(replace(group, rms=group.rms / size) for group in lines.groups),
            ),
            region=self.region.regions,
            place=self.place.summary,
            response=self.response,
            readings=self.readings,
        )

    def plot(self, ax: Sequence[Axes] | None = None) -> list[Axes]:
        """Draw one diagram each for time, frequency, operating region and place, and for lines and response if known.

        Parameters
        ----------
        ax : sequence of four to six matplotlib Axes, optional
            Axes to draw on; a new figure by default.

        Returns
        -------
        list of matplotlib Axes
        """
        unit = (written_amplitude(self.unit[0])[0], self.unit[1])
        panels: list[Callable[[Axes], object]] = [
            lambda axes: self.time.plot(axes, unit=unit),
            self.frequency.plot,
            lambda axes: self.region.plot(axes).set_ylabel(f"mean residual ({unit[0]})"),
            self.place.plot,
        ]
        if (lines := self.lines) is not None:
            panels.append(lambda axes: lines.plot(axes, unit=unit))
        if response := self.response:
            panels.append(lambda axes: draw_response(response, axes))
        given = list(ax) if ax is not None else _new_axes(len(panels))
        for axes, panel in zip(given, panels, strict=True):
            panel(axes)
        return given


def _new_axes(count: int) -> list[Axes]:
    from matplotlib import pyplot

    rows = (count + 1) // 2
    axes: list[Axes] = pyplot.subplots(rows, 2, figsize=(11, 3.5 * rows), layout="constrained")[1].ravel().tolist()
    for unused in axes[count:]:
        unused.remove()
    return axes[:count]


@checks_its_arguments
def locate(base: Candidate, problem: DiagnosisProblem, checked: DataQuality, rng: np.random.Generator) -> Location:
    """Locate the mismatch in time, frequency, operating region and part of the plant.

    Parameters
    ----------
    base : Candidate
        The calibrated base plant.
    problem : DiagnosisProblem
        Diagnosis problem with the recordings.
    checked : DataQuality
        The same recordings, with their faulty samples marked.
    rng : numpy.random.Generator
        Random generator for the test whether signals at a place predict the mismatch better than by chance.

    Returns
    -------
    Location

    Raises
    ------
    SimulationError
        If the plant cannot be simulated on the recordings.
    """
    plant = base.calibration.plant
    unit, model_error = amplitude_unit(plant.rig.output_unit), plant.rig.model_error
    found = tracks(plant, checked.experiments, usable=checked.usable)
    simulated = [y for each in readings(plant, checked.experiments) for y in each]
    return Location(
        time=locate_time(found, base.noise**2 + model_error**2),
        frequency=locate_frequency(found, base.noise),
        lines=locate_lines(found, base.noise),
        region=replace(locate_region(found, unit[1]), unit=written_amplitude(plant.rig.output_unit)[0]),
        place=locate_place(base, problem.of_first, rng),
        response=locate_response(_sound(checked, simulated), simulated, model_error),
        unit=unit,
        readings=_of_further(base, problem, checked),
    )


def _of_further(base: Candidate, problem: DiagnosisProblem, checked: DataQuality) -> tuple[ReadingLocation, ...] | None:
    """Return where the mismatch lies in each further recorded reading."""
    plant = base.calibration.plant
    records = [record for experiment in checked.experiments for record in experiment.recordings]
    found = []
    for reading in problem.nominal.rig.further:
        own = error_in(plant.rig, reading, records)
        if own is not None:
            residual = tracks(plant, checked.experiments, reading.name, checked.known(reading.name))
            found.append(
                ReadingLocation(
                    reading=reading.name,
                    time=locate_time(residual, reading.noise**2 + own**2).windows,
                    frequency=locate_frequency(residual, reading.noise).bands,
                    region=locate_region(residual, 1.0).regions,
                )
            )
    return tuple(found) or None


def _sound(checked: DataQuality, simulated: Sequence[np.ndarray]) -> list[Recording]:
    """Replace faulty readings, which say nothing about the response, by simulated ones."""
    records = [record for experiment in checked.experiments for record in experiment.recordings]
    masks = [mask for each in checked.usable for mask in each]
    return [
        replace(record, outputs=np.where(mask, record.outputs, y))
        for record, mask, y in zip(records, masks, simulated, strict=True)
    ]
