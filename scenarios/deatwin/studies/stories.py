"""The stories that `deatwin scenario NAME` runs."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from deatwin.plant.errors import DataError, nearest
from deatwin.studies.folder import ResultFolder
from deatwin.studies.voice import Progress

if TYPE_CHECKING:
    from deatwin.studies.provenance import RunRecord


DATA_VARIABLE = "DEATWIN_DATA"


@dataclass(frozen=True, kw_only=True, eq=False)
class Setting:
    """What a story is given."""

    folder: ResultFolder
    data: Path | None  # Folder of public recordings
    command: Sequence[str]
    jobs: int
    seed: int
    progress: Progress  # Takes the share that is done and what is being done
    size: str | None = None  # How much is done, where the story comes in several sizes; its usual one by default

    def record(self, inputs: Sequence[dict[str, str]] = ()) -> RunRecord:
        """The record of a run that starts now."""
        from deatwin.studies.provenance import RunRecord

        return RunRecord(command=self.command, inputs=list(inputs), seed=self.seed, jobs=self.jobs)


@dataclass(frozen=True, kw_only=True)
class Story:
    """An entry of the list."""

    name: str  # What it is called and shows
    line: str
    minutes: float  # It takes about so long on two cores
    module: str  # Has a function ``run(setting)`` that returns plain data with a ``sentence``
    sizes: tuple[str, ...] = ()
    times: tuple[float, ...] = ()  # About how many minutes each size takes on two cores
    resumes: bool = False

    @property
    def told(self) -> str:
        """The line, and after it which times the sizes take and whether the story resumes."""
        sizes = ", ".join(f"{size} {_in_words(time)}" for size, time in zip(self.sizes, self.times, strict=True))
        about = "; ".join(text for text in (sizes, "resumes" if self.resumes else "") if text)
        return f"{self.line} ({about})" if about else self.line

    def require_size(self, size: str | None) -> None:
        """Raise DataError unless the story can be had in a size."""
        if size is not None and size not in self.sizes:
            known = f"known: {', '.join(self.sizes)}" if self.sizes else "it has one size: leave --size out"
            raise DataError(f"the scenario {self.name} has no size {size!r}{nearest(size, self.sizes)} ({known})")

    @property
    def run(self) -> Callable[[Setting], Mapping[str, Any]]:
        """The story itself."""
        function: Callable[[Setting], Mapping[str, Any]] = import_module(self.module).run
        return function


STORIES: Mapping[str, Story] = MappingProxyType(
    {
        s.name: s
        for s in (
            Story(
                name="vhb4910",
                minutes=2,
                module="deatwin.scenarios.vhb4910",
                line="measured pulls of VHB 4910: a hyperelastic strip lacks a relaxation",
            ),
            Story(
                name="silverbox",
                minutes=1.5,
                module="deatwin.scenarios.real_physics.silverbox",
                line="a measured oscillator, described as linear: the cubic spring is found",
            ),
            Story(
                name="emps",
                minutes=1.5,
                module="deatwin.scenarios.real_physics.emps",
                line="a measured drive in closed loop, described with viscous friction: dry friction is found",
            ),
            Story(
                name="cascaded-tanks",
                minutes=1,
                module="deatwin.scenarios.real_physics.cascaded_tanks",
                line="two measured tanks, described without their brim: the overflow is found",
            ),
            Story(
                name="bouc-wen",
                minutes=2,
                module="deatwin.scenarios.real_physics.bouc_wen",
                line="the Bouc-Wen benchmark, described as linear: the hysteresis is found",
            ),
            Story(
                name="your-own-rig",
                minutes=0.5,
                module="deatwin.scenarios.your_own_rig",
                line="a user's plant of thirty lines, a quarter of a car: a drag that it lacks is found",
            ),
            Story(
                name="thesis-data",
                minutes=0.5,
                module="deatwin.scenarios.thesis_data",
                line="the thesis' six actuators: recordings, drifts, figures 2.5 to 2.8",
            ),
            Story(
                name="semp-fleet",
                minutes=0.8,
                module="deatwin.scenarios.fleet_models.semp_fleet",
                line="the six actuators identified by SEMP and FRO, validated, and what drift and hysteresis undo",
            ),
            Story(
                name="svb-fleet",
                minutes=0.8,
                module="deatwin.scenarios.fleet_models.svb_fleet",
                line="the six actuators by sparse variational Bayes: posteriors, bands, and SEMP beside them",
            ),
            Story(
                name="prestretch-sweep",
                minutes=0.3,
                module="deatwin.scenarios.prestretch",
                line="what prestretch does: each claim that is made for it, with a number",
            ),
            Story(
                name="svb-benchmark",
                minutes=8,
                module="deatwin.scenarios.svb_benchmark",
                resumes=True,
                line="how often the true NARX structure is found: all methods on systems whose equations are known",
            ),
            Story(
                name="frequency-analysis",
                minutes=1.5,
                module="deatwin.scenarios.frequency_analysis",
                line="frequency responses of all orders and NOFRFs: systems that are known, then the six actuators",
            ),
            Story(
                name="time-varying",
                minutes=1.2,
                module="deatwin.scenarios.time_varying",
                line="parameters along time: known systems, then what drifts in the six actuators, and spectra that follow",
            ),
            Story(
                name="frequency-uncertainty",
                minutes=1.5,
                module="deatwin.scenarios.frequency_uncertainty",
                line="how well frequency responses are known; how consistent fabrication is: where six actuators differ",
            ),
            Story(
                name="regression-lessons",
                minutes=0.5,
                module="deatwin.scenarios.regression_lessons",
                line="ridge and LASSO constraints, bias and variance, Occam's razor: each lesson with a check",
            ),
            Story(
                name="concealed-physics",
                minutes=240,
                module="deatwin.scenarios.concealed_physics",
                sizes=("tiny", "long", "standard", "full"),
                times=(5, 150, 240, 480),
                resumes=True,
                line="the diagnosis on trial: effects are concealed from it in sealed cases, and it has to find them",
            ),
            Story(
                name="unexplained-drift",
                minutes=5,
                module="deatwin.scenarios.unexplained_drift",
                resumes=True,
                line="six actuators, their drifts concealed: what the diagnosis names, and what repeatability proves",
            ),
            Story(
                name="control-check",
                minutes=3,
                module="deatwin.scenarios.control_check",
                sizes=("short", "standard", "full"),
                times=(3, 15, 55),
                resumes=True,
                line="designs on rigs that no check has seen: what the inverse buys, and if verdicts keep their word",
            ),
            Story(
                name="real-data",
                minutes=1,
                module="deatwin.scenarios.real_data",
                line="free runs on public recordings: Silverbox, buck converter, cascaded tanks, EMPS",
            ),
        )
    }
)


def _in_words(minutes: float) -> str:
    return f"{minutes / 60:g} h" if minutes >= 90 else f"{minutes:g} min"


def story(name: str) -> Story:
    """The story of that name."""
    try:
        return STORIES[name]
    except KeyError:
        known = ", ".join(STORIES)
        raise DataError(f"there is no scenario {name!r}{nearest(name, STORIES)} (known: {known})") from None


def data_folder(given: Path | None, name: str) -> Path:
    """A folder of public recordings."""
    root = given or os.environ.get(DATA_VARIABLE)
    if not root:
        from deatwin.scenarios.real_data.sources import downloaded

        return downloaded(name)
    folder = Path(root) / name
    if not folder.is_dir():
        raise DataError(f"{folder}: no such folder; it must hold the recordings {name}")
    return folder
