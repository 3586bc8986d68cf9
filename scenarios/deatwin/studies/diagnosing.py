"""Run a diagnosis from input files to output files; used by `deatwin diagnose`, the demo and the scenarios."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from deatwin.ident.mismatch import INPUT_FILE, Diagnosis, diagnose
from deatwin.plant.amplitudes import written_amplitude
from deatwin.plant.effects import Effect
from deatwin.plant.interrupts import obeying
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment
from deatwin.studies.folder import ResultFolder, require_unread
from deatwin.studies.partial import FinishedSteps, remove_partial
from deatwin.studies.provenance import RunRecord, hashes
from deatwin.studies.report.page import write_report
from deatwin.studies.report.rendering import Origin
from deatwin.studies.voice import Progress

RIVALS = "rivals"  # Folder of the plants that a diagnosis cannot distinguish from its answer, if there are any
WRITTEN = ("diagnosis.json", "model.json", INPUT_FILE, "report.html", "run.json")  # Files that every diagnosis writes


@dataclass(frozen=True, kw_only=True, eq=False)
class DiagnosisTask:
    """All inputs of a diagnosis."""

    plant: Plant  # Nominal or amended plant
    experiments: Sequence[Experiment]  # Experiments, each from rest
    files: Sequence[str | Path]  # Files from which plant and recordings were read
    command: Sequence[str]
    effects: Sequence[Effect] | None = None  # Effects to be considered; the catalogue by default
    jobs: int = 1  # Worker processes
    seed: int = 0

    def run(self, folder: ResultFolder, progress: Progress, say: Callable[[str], None] | None = None) -> Diagnosis:
        """Diagnose and write all files; `say` receives size and place of the mismatch as soon as they are known."""
        for name in WRITTEN:
            require_unread(folder.path / name, self.files)
        inputs = hashes(self.files)
        record = RunRecord(command=self.command, inputs=inputs, seed=self.seed, jobs=self.jobs)
        unit = written_amplitude(self.plant.rig.output_unit)[0]
        diagnosis = self._diagnosed(folder, record, FinishedSteps(progress, unit, say))
        if diagnosis.model is not None:
            folder.save("model.json", diagnosis.model.save)
        remove_partial(folder)
        for effects, rival in diagnosis.rival_models.items():
            folder.save(f"{RIVALS}/{effects}.json", rival.save)
        advice = None if diagnosis.findings is None else diagnosis.findings.advice
        if advice is not None and advice.recording is not None:
            folder.save(INPUT_FILE, advice.save_input)
        write_report(folder, diagnosis, Origin.of(record))
        folder.remove_former(rf"{RIVALS}/[^/]+\.json|figures/\w+\.csv")
        record.save(folder)
        return diagnosis

    def _diagnosed(self, folder: ResultFolder, record: RunRecord, finished: FinishedSteps) -> Diagnosis:
        """Write the diagnosis or, after an interrupt, the finished steps."""
        try:
            with obeying():
                diagnosis = diagnose(
                    self.plant,
                    self.experiments,
                    effects=self.effects,
                    jobs=self.jobs,
                    seed=self.seed,
                    progress=finished.tell,
                    through=finished.take,
                )
            folder.save("diagnosis.json", diagnosis.save)
        except KeyboardInterrupt:
            raise KeyboardInterrupt(finished.save(folder, self.plant, record)) from None
        return diagnosis
