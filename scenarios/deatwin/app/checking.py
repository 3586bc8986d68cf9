"""Run a check from input files to output files; used by `deatwin check`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from deatwin.app.check_report.page import write_check_report
from deatwin.app.check_report.view import View
from deatwin.control import Check, ControlError, Specification
from deatwin.control import check as check_design
from deatwin.control.design.named import Wanted, design_named
from deatwin.ident.mismatch.diagnosis import SCHEMA
from deatwin.ident.narx import NarxModel, excited_band
from deatwin.ident.narx.excited import BAND_KEY, number_of
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.documents import read_document
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.recording import Recording
from deatwin.studies.diagnosing import RIVALS
from deatwin.studies.folder import ResultFolder
from deatwin.studies.provenance import RunRecord, hashes
from deatwin.studies.report.rendering import Origin
from deatwin.studies.voice import Progress

CALIBRATED = "the calibrated model"  # Name of the plant from a diagnosis that named no cause
POINTS = 9  # Operating points of a range at which margins are judged


@dataclass(frozen=True, kw_only=True, eq=False)
class CheckTask:
    """All inputs of a check."""

    model: NarxModel  # Identified model
    plant: CalibratedPlant  # Physical plant
    files: Sequence[str | Path]  # Files from which model, plants and recording were read
    command: Sequence[str]
    design: str  # Name of the controller's design
    closed_loop_time: float | None  # s; chosen as by lambda tuning if None
    operating_input: float | None
    operating_range: tuple[float, float] | None  # Range over which margins are judged, in the input's unit
    recording: Recording | None  # Recording from which the model was identified, or better another one
    rivals: Mapping[str, CalibratedPlant]  # Further plants that the actuator may be
    jobs: int  # Worker processes, for the record only, because a check is a single task
    seed: int  # Seed of all random numbers

    def __post_init__(self) -> None:
        if self.operating_range is not None:
            low, high = self.operating_range
            if not -math.inf < low < high < math.inf:
                raise ControlError(
                    f"the operating range {low:g} to {high:g} is empty: its ends must be finite, the lower one first"
                )
            if self.operating_input is not None and not low <= self.operating_input <= high:
                raise ControlError(
                    f"the operating input {self.operating_input:g} lies outside of the operating range, {low:g} to "
                    f"{high:g}: give one inside, or a range that contains it"
                )
        rig = self.plant.plant.rig
        for name, rival in self.rivals.items():
            theirs = rival.plant.rig
            if abs(theirs.sample_time / rig.sample_time - 1.0) > 1e-6:
                raise ModelError(
                    f"the alternative {name} is sampled every {theirs.sample_time:g} s, the plant every {rig.sample_time:g} s"
                )

    def run(self, folder: ResultFolder, progress: Progress) -> Check:
        """Design and judge the controller; write check, report, figures' data and run record."""
        inputs, specification = hashes(self.files), Specification()
        record = RunRecord(command=self.command, inputs=inputs, seed=self.seed, jobs=self.jobs)
        rig, at = self.plant.plant.rig, self.operating_input
        if at is None and self.operating_range is not None:
            at = 0.5 * sum(self.operating_range)
        wanted = Wanted(
            model=self.model,
            reading=rig.reading,
            closed_loop_time=self.closed_loop_time,
            band_Hz=number_of(self.model.provenance, BAND_KEY)
            if self.recording is None
            else excited_band(self.recording),
            operating_range=self.operating_range,
        )
        check = check_design(
            self.model,
            self.plant,
            rng=np.random.default_rng(self.seed),
            design=design_named(self.design, wanted),
            operating_input=at,
            operating_inputs=None if self.operating_range is None else np.linspace(*self.operating_range, POINTS),
            command_limits=rig.command_range,
            recording=self.recording,
            specification=specification,
            others=self.rivals,
            progress=lambda share: progress(share, "closing the loop"),
        )
        plants = {"plant": self.plant.plant, **{name: rival.plant for name, rival in self.rivals.items()}}
        view = View(check=check, model=self.model, plants=plants, specification=specification)
        folder.save("check.json", check.save)
        write_check_report(folder, view, Origin.of(record))
        folder.remove_former(r"figures/\w+\.csv")
        record.save(folder)
        return check


def rival_files(plant: str, diagnosis: Path | None, sources: Sequence[str]) -> dict[str, str]:
    """Return the files of alternative plants, by name."""
    found = {} if diagnosis is None else _diagnosed(diagnosis)
    given = {**found, **{source: source for source in sources}}
    return {name: source for name, source in given.items() if Path(source).resolve() != Path(plant).resolve()}


def _diagnosed(folder: Path) -> dict[str, str]:
    """Return the plant found by a diagnosis, and its alternatives."""
    if not (folder / "diagnosis.json").is_file():
        raise DataError(f"{folder}: there is no diagnosis.json; give the folder that deatwin diagnose wrote")
    effects = read_document(folder / "diagnosis.json", SCHEMA, lambda content: [c["effect"] for c in content["causes"]])
    model = folder / "model.json"  # missing if the recording could not be diagnosed
    best = {"+".join(effects) or CALIBRATED: str(model)} if model.is_file() else {}
    return {**best, **{path.stem: str(path) for path in sorted((folder / RIVALS).glob("*.json"))}}
