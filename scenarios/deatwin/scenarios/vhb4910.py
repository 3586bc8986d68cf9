"""Measured pulls of VHB 4910: a strip that is taken as purely hyperelastic lacks a relaxation.

The recordings are load-unload pulls of real coupons at strain rates of 0.01, 0.03 and 0.05 1/s, with 80 mm
between the clamps (github.com/Chongran-Zhao/VHB4910_data; it names no licence, so it is read where the user
keeps it). A hyperelastic `Coupon` is calibrated on the pulls at 0.01 and 0.05 1/s, each an experiment of
its own from rest, and diagnosed. The pulls at 0.03 1/s judge the answer; nothing is chosen on them.

Pulls to stretches of 1.5 and 2 are used. With those to 3 added, `diagnose` answers *unknown*, on the fitted
rates alone: after pulls to 1.5, 2 and 3 at 0.01 1/s the strip hangs slack below stretches of 1.14, 1.23 and
1.38, so it also softens with the largest stretch so far, for which the catalogue has no effect yet. The
scenario runs that too, and reports it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.ident.greybox.fit import Part, calibrate
from deatwin.ident.mismatch import diagnose
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.errors import DataError
from deatwin.plant.files import read_csv
from deatwin.plant.model import Plant
from deatwin.plant.recording import Experiment, Recording
from deatwin.plant.rigs.coupon import Coupon
from deatwin.scenarios.diagnosing import DiagnosisTask
from deatwin.scenarios.stories import Setting, data_folder

__all__ = ["FITTED_RATES", "HELD_OUT_RATE", "STRETCHES", "files_of", "free_run_error", "pull", "run"]

LENGTH = 80e-3
"""Between the clamps, m."""
FITTED_RATES, HELD_OUT_RATE = ("0d01", "0d05"), "0d03"
STRETCHES, ALL_STRETCHES = ("1d5", "2d0"), ("1d5", "2d0", "3d0")


def run(setting: Setting) -> Mapping[str, Any]:
    """Calibrate, diagnose, and predict the held-out rate.

    Parameters
    ----------
    setting : Setting
        Folder, data and the like.

    Returns
    -------
    mapping
        Verdicts, causes, and the free-run errors on the held-out pulls in N.

    Raises
    ------
    DataError
        If the recordings are absent.
    """
    folder = data_folder(setting.data, "vhb4910") / "loading_unloading"
    plant = Plant(rig=Coupon(length=LENGTH))
    files = files_of(folder, FITTED_RATES, STRETCHES)
    fitted = [pull(file) for file in files]
    task = DiagnosisTask(
        plant=plant,
        experiments=fitted,
        files=files,
        command=setting.command,
        jobs=setting.jobs,
        seed=setting.seed,
    )
    diagnosis = task.run(setting.folder, setting.progress)
    base = calibrate(plant, [Part.whole(experiment) for experiment in fitted])
    held_out = [pull(file) for file in files_of(folder, (HELD_OUT_RATE,), STRETCHES)]
    errors = {
        "base": free_run_error(CalibratedPlant.nominal(base.plant), held_out),
        "amended": free_run_error(diagnosis.model or CalibratedPlant.nominal(base.plant), held_out),
    }
    wider = diagnose(
        plant, [pull(file) for file in files_of(folder, FITTED_RATES, ALL_STRETCHES)],
        jobs=setting.jobs, seed=setting.seed,
    )  # fmt: skip
    result = {
        "verdict": diagnosis.verdict.value,
        "causes": [cause.effect for cause in diagnosis.causes],
        "held_out_N": errors,
        "verdict_with_stretch_3": wider.verdict.value,
        "sentence": (
            f"{diagnosis.sentence} Pulls at 0.03 1/s, which nothing was chosen on: "
            f"{errors['base']:.3f} N rms before, {errors['amended']:.3f} N after. "
            f"With the pulls to a stretch of 3 added the verdict is {wider.verdict.value}."
        ),
    }
    setting.folder.text("vhb4910.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    return result


def files_of(folder: Path, rates: Iterable[str], stretches: Sequence[str]) -> list[Path]:
    """The pulls of some rates to some stretches.

    Parameters
    ----------
    folder : path
        With the files ``<rate>_<stretch>[_1].csv``.
    rates, stretches : iterable of str
        As in the files' names.

    Returns
    -------
    list of path

    Raises
    ------
    DataError
        If one is absent.
    """
    found = []
    for rate in rates:
        for stretch in stretches:
            files = sorted(folder.glob(f"{rate}_{stretch}*.csv"))
            if not files:
                raise DataError(f"{folder}: no file {rate}_{stretch}*.csv")
            found.append(files[0])
    return found


def pull(file: Path) -> Experiment:
    """One pull: stretch in, force out.

    Parameters
    ----------
    file : path
        Time, displacement and force, under a Chinese header.

    Returns
    -------
    Experiment
        Of one recording, from rest at a stretch of 1.
    """
    measured = read_csv(file, input_column="#2", output_column="#3")[0]
    record = Recording.from_arrays(
        1 + measured.inputs / LENGTH, measured.outputs, measured.sample_time, start=measured.start,
        input_names=("stretch",), input_units=("1",), output_names=("force",), output_units=("N",),
        provenance=measured.provenance,
    )  # fmt: skip
    return Experiment(recordings=(record,))


def free_run_error(model: CalibratedPlant, experiments: Iterable[Experiment]) -> float:
    """Rms difference of a free run from the measured readings, over all samples of all experiments.

    Parameters
    ----------
    model : CalibratedPlant
        Predicts.
    experiments : iterable of Experiment
        Each from rest.

    Returns
    -------
    float
        SI.
    """
    errors = [
        record.outputs[0] - mean
        for experiment in experiments
        for record, mean in zip(experiment.recordings, model.predict(experiment).mean, strict=True)
    ]
    return float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
