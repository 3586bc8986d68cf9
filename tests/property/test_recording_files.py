"""What is written into a file is read back."""

import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from deatwin.plant.csvtable import read_table
from deatwin.plant.files import read_recording, write_csv, write_recording
from deatwin.plant.recording import Recording
from deatwin.plant.rigs.rigfile import RigFile

finite = st.floats(allow_nan=False, allow_infinity=False)
moderate = st.floats(-1e6, 1e6, allow_subnormal=False)
lengths = st.shared(st.integers(2, 40), key="samples")


@settings(deadline=None, max_examples=50)
@given(columns=arrays(np.float64, st.tuples(st.integers(1, 4), lengths), elements=finite))
def test_numbers_survive_bit_for_bit(columns: np.ndarray) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        write_csv(path, {f"column {k}": column for k, column in enumerate(columns)})
        np.testing.assert_array_equal(read_table(path).numbers(list(range(len(columns)))), columns)


@settings(deadline=None, max_examples=50)
@given(
    command=arrays(np.float64, lengths, elements=moderate),
    displacement=arrays(np.float64, lengths, elements=moderate),
    milliseconds=st.integers(1, 5000),
    start=st.integers(0, 10**6),
)
def test_recordings_survive(
    command: np.ndarray, displacement: np.ndarray, milliseconds: int, start: int
) -> None:
    recording = Recording.from_arrays(command, displacement, milliseconds / 1000, start=start / 1000)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rec.csv"
        write_recording(path, recording)
        again = read_recording(path)
    np.testing.assert_array_equal(again.inputs, recording.inputs)
    np.testing.assert_allclose(again.outputs, recording.outputs, rtol=1e-15)
    np.testing.assert_allclose(again.timepts, recording.timepts, atol=1e-6)


@settings(deadline=None, max_examples=50)
@given(
    thickness=st.floats(0.001, 10.0),
    electrode=st.floats(1.0, 79.0),
    noise=st.floats(0.0, 1e4, allow_subnormal=False),
    ball=st.sampled_from(["bonded", "sliding"]),
)
def test_rig_survives(thickness: float, electrode: float, noise: float, ball: str) -> None:
    rig = RigFile.from_dict(
        {
            "film": {
                "material": "VHB 4905",
                "thickness_mm": float(f"{thickness:.9g}"),
                "prestretch": 3.5,
                "frame_diameter_mm": 80.0,
                "electrode_diameter_mm": float(f"{electrode:.9g}"),
                "ball": ball,
            },
            "load": {"mass_g": 3.0, "contact_diameter_mm": 0.5},
            "drive": {"gain": 800.0, "start_ramp_s": 2.0, "start_hold_s": 3.0},
            "sensor": {
                "sample_rate_Hz": 50.0,
                "noise_um": float(f"{noise:.9g}"),
                "zero": "displacement at zero volts",
            },
        }
    )
    assert RigFile.from_dict(rig.to_dict(), rig.source) == rig
