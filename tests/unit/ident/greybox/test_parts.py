"""Which readings count: of an unknown start, those by which fast motion has forgotten it."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.greybox.parts import Part, free_run_residuals, parts_of, settled
from deatwin.ident.mismatch.locate.track import tracks
from deatwin.ident.mismatch.quality.quality import check_quality
from deatwin.plant import Cone, Experiment, Plant, Recording

KNOWN = Plant(rig=Cone(sample_time=0.01, noise=1e-6, damping=0.3))
UNKNOWN = KNOWN.with_rig(replace(KNOWN.rig, start_is_known=False))


def experiment(*sizes: int, sample_time: float = 0.01) -> Experiment:
    clock, records = 0.0, []
    for size in sizes:
        record = Recording.from_arrays(np.zeros(size), np.zeros(size), sample_time, start=clock)
        records, clock = [*records, record], record.end
    return Experiment(recordings=tuple(records))


@pytest.mark.parametrize(
    ("sizes", "left_out"),
    [((2000,), (100,)), ((40, 3000), (40, 60)), ((300,), (30,))],
    ids=["a second", "a second into the next recording", "a tenth of a short one"],
)
def test_the_uncounted_time_of_an_unknown_start(sizes: tuple[int, ...], left_out: tuple[int, ...]) -> None:
    one = experiment(*sizes)
    masks = settled(one, UNKNOWN.rig)
    assert [int((~mask).sum()) for mask in masks] == list(left_out)
    assert all(mask[number:].all() for mask, number in zip(masks, left_out, strict=True))
    assert all(mask.all() for mask in settled(one, KNOWN.rig))
    assert parts_of(Part.whole(one), UNKNOWN.rig)[0].size == sum(sizes)  # who selects samples has them all


def test_a_recording_that_begins_in_the_middle_of_the_motion_fits_its_own_plant() -> None:
    rng = np.random.default_rng(3)
    commands = np.repeat(rng.uniform(0.5, 2.0, 100), 12)
    whole = KNOWN.simulate(Experiment(recordings=(Recording.from_arrays(commands, commands, 0.01),)))
    readings = whole.require().outputs[0][0]
    one = Experiment(recordings=(Recording.from_arrays(commands[101:], readings[101:], 0.01),))
    moved, counted = (free_run_residuals(UNKNOWN, p) for p in ((Part.whole(one),), parts_of(one, UNKNOWN.rig)))
    assert np.abs(moved).max() > 0.05 * np.ptp(readings)
    assert np.abs(counted).max() < 1e-3 * np.ptp(readings)
    (track,) = tracks(UNKNOWN, (one,))
    assert not track.residual[:99].any() and np.abs(track.residual).max() < 1e-3 * np.ptp(readings)
    checked = check_quality(UNKNOWN, one)
    assert not checked.usable[0][0][:99].any() and "the motion before the first sample is unknown" in " ".join(
        checked.notes
    )
