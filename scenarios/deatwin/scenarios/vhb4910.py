"""Measured pulls of VHB 4910: a strip that is taken as purely hyperelastic lacks a relaxation.

The recordings are load-unload pulls of real coupons at 0.01, 0.03 and 0.05 1/s, with 80 mm between the clamps
(github.com/Chongran-Zhao/VHB4910_data; it names no licence, so it is read where the user keeps it). A hyperelastic
`Coupon` is calibrated on the pulls at 0.01 and 0.05 1/s to stretches of 1.5 and 2, each from rest, and diagnosed. The
pulls at 0.03 1/s judge the answer, and so does a strip held at 2 for half an hour; nothing is chosen on them.

The scenario also diagnoses with a pull to 3 added: after pulls to 1.5, 2 and 3 at 0.01 1/s the strip hangs slack below
stretches of 1.14, 1.23 and 1.38, so it also softens with the largest stretch so far.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deatwin.ident.mismatch import diagnose
from deatwin.plant import Coupon, DataError, Experiment, Plant, Recording, read_recording
from deatwin.studies.missing_physics import Case, HeldOut, Law, experiment_of, tell
from deatwin.studies.public.records import Candidates, DataSet, recorded
from deatwin.studies.public.sources import data_folder
from deatwin.studies.stories import Setting

LENGTH = 80e-3  # Between the clamps, m
FITTED_RATES, HELD_OUT_RATE = ("0d01", "0d05"), "0d03"
STRETCHES, FAR = ("1d5", "2d0"), "3d0"
STEP = 10  # Samples of 20 ms from one of a black box to its next


def run(setting: Setting) -> Mapping[str, Any]:
    """Diagnose, and predict the held-out rate and a relaxation."""
    folder = data_folder(setting.data, "vhb4910")
    own, far = case(folder), [pull(file) for file in far_files(folder)]
    told = tell(setting, "vhb4910", lambda _: own)  # read once
    wider = diagnose(own.plant, [*own.fitted, *far], jobs=setting.jobs, seed=setting.seed)
    found = ", ".join(cause.effect for cause in wider.causes)
    result = {
        **told,
        "held_out_N": next(iter(told["held_out"].values())),
        "verdict_with_stretch_3": wider.verdict.value,
        "sentence_with_stretch_3": wider.sentence,
        "sentence": (
            f"{told['sentence']} If a pull to 3 at 0.05 1/s is added, the verdict is {wider.verdict.value}"
            f"{f' ({found})' if found else ''}."
        ),
    }
    setting.folder.text("vhb4910.json", json.dumps(result, indent=1, ensure_ascii=False) + "\n")
    return result


def case(folder: Path) -> Case:
    """The recordings and the plant."""
    pulls = folder / "loading_unloading"
    files = files_of(pulls, FITTED_RATES, STRETCHES)
    held = files_of(pulls, (HELD_OUT_RATE,), STRETCHES)
    relaxed = folder / "relaxation" / "2d0.csv"
    fitted = tuple(pull(file) for file in files)
    lower, higher = (pull(file) for file in held)
    return Case(
        name="vhb4910",
        title="VHB 4910",
        documented=("creep",),
        plant=Plant(rig=Coupon(length=LENGTH)),
        fitted=fitted,
        held_out=(
            HeldOut(name="The pull to 2 at 0.03 1/s", experiment=higher, black_box=_black_box(fitted, higher)),
            HeldOut(name="The pull to 1.5 at 0.03 1/s", experiment=lower),
            HeldOut(name="Half an hour at a stretch of 2", experiment=pull(relaxed)),
        ),
        unit="N",
        scale=1.0,
        files=(*files, *held, relaxed, *far_files(folder)),
        law=lambda amended: _law(amended, higher),
        notes=(
            "Diagnosed: pulls to stretches of 1.5 and 2 and back at 0.01 and 0.05 1/s, each from rest. Judged: the "
            "same at 0.03 1/s, and a strip that is stretched to 2 within seconds and held for half an hour.",
            "The plant is a hyperelastic strip without relaxation. Its stated model error is that of good "
            "phenomenological models of VHB. Black boxes receive the fitted pulls one after another, 5 times a "
            "second.",
        ),
    )


def _black_box(fitted: Sequence[Experiment], judged: Experiment) -> DataSet:
    """Stretch in, force out, the fitted pulls as one record."""

    def coarse(experiments: Sequence[Experiment]) -> Recording:
        records = [e.recordings[0] for e in experiments]
        stretch, force = (
            np.concatenate([values[0, ::STEP] for values in signal])
            for signal in ([r.inputs for r in records], [r.outputs for r in records])
        )
        return recorded(stretch - 1, force, STEP * records[0].sample_time, ("1", "N"))

    return DataSet(
        name="vhb4910",
        title="VHB 4910",
        unit="N",
        scale=1.0,
        train=coarse(fitted),
        test=coarse([judged]),
        candidates=Candidates(output_lags=2, input_lags=(0, 1, 2), degree=3, max_terms=10),
    )


def _law(amended: Plant, judged: Experiment) -> Law:
    """Force beyond what the strip has of its rubber elasticity."""
    record = judged.recordings[0]
    elastic, all_of_it = (p.simulate(judged).require().outputs[0][0] for p in (amended.without_effects(), amended))
    return Law(
        state="stretch",
        force="force beyond the elastic one (N)",
        measured=(record.inputs[0], record.outputs[0] - elastic),
        modelled=(record.inputs[0], all_of_it - elastic),
        caption="Held-out pull to 2 and back at 0.03 1/s, clockwise: measured and simulated force, both minus the "
        "elastic force of the amended plant.",
    )


def files_of(folder: Path, rates: Iterable[str], stretches: Sequence[str]) -> list[Path]:
    """The pulls of some rates to some stretches."""
    found = []
    for rate in rates:
        for stretch in stretches:
            files = sorted(folder.glob(f"{rate}_{stretch}*.csv"))
            if not files:
                raise DataError(
                    f"{folder}: no file matching {rate}_{stretch}*.csv in this folder; the folder must contain the vhb4910 "
                    "recordings"
                )
            found.append(files[0])
    return found


def far_files(folder: Path) -> list[Path]:
    """The pulls that go further than those that are judged."""
    return files_of(folder / "loading_unloading", FITTED_RATES[-1:], (FAR,))


def pull(file: Path) -> Experiment:
    """One pull: stretch in, force out."""
    measured = read_recording(file, input_column="#2", output_column="#3")
    stretch, force = 1 + measured.inputs[0] / LENGTH, measured.outputs[0]
    more = {"start": measured.start, "provenance": measured.provenance}
    return experiment_of(Coupon(length=LENGTH), stretch, force, measured.sample_time, **more)
