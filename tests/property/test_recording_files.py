"""What is written into a file is read back, to the last bit."""

import json
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rig_files import SOUND

from deatwin.plant.files import read_recording, write_csv, write_recording
from deatwin.plant.files.csvtable import read_table
from deatwin.plant.files.units import UNITS
from deatwin.plant.recording import Recording
from deatwin.plant.rigs.rigfile import RigFile

finite = st.floats(allow_nan=False, allow_infinity=False)
moderate = st.floats(-1e6, 1e6, allow_subnormal=False)
lengths = st.shared(st.integers(2, 40), key="samples")
# Texts without lone surrogates, which no encoding holds; null characters end texts in MATLAB and TDMS files.
texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=8)
signal_names = st.one_of(
    st.sampled_from(["command", "displacement", "temperature", "time", "x_mm", "1", "INF", "V", "signal_1", "deatwin"]),
    texts,
)
signal_units = st.sampled_from(["", *sorted({unit.si for unit in UNITS.values()} - {""}), "m/s", "%"])
packages = {".csv": [], ".mat": [], ".tdms": ["nptdms"], ".nc": ["xarray", "h5netcdf", "h5py"]}


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    """Any recording: several inputs and outputs or none, any names, values down to the subnormal."""
    samples = draw(st.integers(1, 12))
    counts = [draw(st.integers(1, 2)), draw(st.integers(0, 2))]
    inputs, outputs = (draw(arrays(np.float64, (count, samples), elements=finite)) for count in counts)
    extras = draw(st.dictionaries(signal_names, arrays(np.float64, samples, elements=finite), max_size=2))
    return Recording(
        inputs=inputs,
        outputs=outputs,
        sample_time=draw(st.floats(1e-5, 1e3)),
        start=draw(st.floats(0.0, 1e5)),
        input_names=tuple(draw(st.lists(signal_names, min_size=counts[0], max_size=counts[0], unique=True))),
        output_names=tuple(draw(st.lists(signal_names, min_size=counts[1], max_size=counts[1], unique=True))),
        input_units=tuple(draw(signal_units) for _ in range(counts[0])),
        output_units=tuple(draw(signal_units) for _ in range(counts[1])),
        extras=extras,
        extra_units={name: draw(signal_units) for name in extras},
        provenance=draw(st.dictionaries(st.one_of(st.just("file"), texts), texts, max_size=2)),
    )


@pytest.mark.parametrize("ending", packages)
@settings(deadline=None, max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(recording=recordings())
def test_recordings_survive_bit_for_bit(in_one_process: None, ending: str, recording: Recording) -> None:
    for package in packages[ending]:
        pytest.importorskip(package)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"rec{ending}"
        write_recording(path, recording)
        again = read_recording(path)
    for name in ("sample_time", "start", "input_names", "output_names", "input_units", "output_units", "extra_units"):
        assert getattr(again, name) == getattr(recording, name)
    for name in ("inputs", "outputs", "timepts"):
        assert getattr(again, name).tobytes() == getattr(recording, name).tobytes()
    assert list(again.extras) == list(recording.extras)
    for name, values in recording.extras.items():
        assert again.extras[name].tobytes() == values.tobytes()
    found = again.provenance  # entries that the new file has too are kept behind its own
    assert {key: found.get(f"origin.{key}", found.get(key)) for key in recording.provenance} == recording.provenance


@settings(deadline=None, max_examples=50)
@given(columns=arrays(np.float64, st.tuples(st.integers(1, 4), lengths), elements=st.floats(-1e29, 1e29)))
def test_numbers_survive_bit_for_bit(columns: np.ndarray) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        write_csv(path, {f"column {k}": column for k, column in enumerate(columns)})
        np.testing.assert_array_equal(read_table(path).si(list(range(len(columns)))), columns)


@settings(deadline=None, max_examples=50)
@given(
    command=arrays(np.float64, lengths, elements=moderate),
    displacement=arrays(np.float64, lengths, elements=moderate),
    milliseconds=st.integers(1, 5000),
    start=st.integers(0, 10**6),
)
def test_plain_recordings_survive_without_a_description(
    command: np.ndarray, displacement: np.ndarray, milliseconds: int, start: int
) -> None:
    recording = Recording.from_arrays(command, displacement, milliseconds / 1000, start=start / 1000)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rec.csv"
        write_recording(path, recording)
        assert path.read_text().startswith("time_s,command_V,displacement_mm\n")
        again = read_recording(path)
    np.testing.assert_array_equal(again.inputs, recording.inputs)
    np.testing.assert_array_equal(again.outputs, recording.outputs)
    assert (again.sample_time, again.start) == (recording.sample_time, recording.start)


@settings(deadline=None, max_examples=50)
@given(
    thickness=st.floats(0.001, 10.0),
    electrode=st.floats(1.0, 79.0),
    noise=st.floats(0.0, 1e4, allow_subnormal=False),
    ball=st.sampled_from(["bonded", "sliding"]),
)
def test_rig_survives(thickness: float, electrode: float, noise: float, ball: str) -> None:
    film = {"thickness_mm": float(f"{thickness:.9g}"), "electrode_diameter_mm": float(f"{electrode:.9g}"), "ball": ball}
    rig = RigFile.from_dict(
        {
            **SOUND,
            "film": {**SOUND["film"], **film},
            "load": {**SOUND["load"], "contact_diameter_mm": 0.5},
            "drive": {**SOUND["drive"], "command_min_V": 1.1, "command_max_V": 3.75},
            "sensor": {**SOUND["sensor"], "noise_um": float(f"{noise:.9g}"), "resolution_um": 1.2},
        }
    )
    assert RigFile.from_dict(json.loads(json.dumps(rig.to_dict())), rig.source) == rig
