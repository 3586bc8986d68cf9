"""Files that are no plain files, too large, or unpack to too much: refused before the memory is spent."""

import json
import os
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import pytest

from deatwin.ident.narx import NarxModel
from deatwin.plant import safe_read
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.errors import DataError, DeatwinError, ModelError
from deatwin.plant.files import read_recording
from deatwin.plant.rigs.rigfile import read_rig

READERS: dict[str, Callable[[Path], object]] = {
    "csv": read_recording,
    "mat": read_recording,
    "tdms": read_recording,
    "nc": read_recording,
    "toml": read_rig,
    "json": CalibratedPlant.load,
}
IN_LITTLE_MEMORY = """
import resource, sys
import h5py, nptdms, scipy.io, xarray, h5netcdf
import numpy as np
from deatwin.ident.narx import NarxModel
from deatwin.plant.calibrated import CalibratedPlant
from deatwin.plant.errors import DeatwinError
from deatwin.plant.files import read_recording
from deatwin.plant.files.formats import unpacked
from deatwin.plant.rigs.rigfile import read_rig
unpacked.RECORDING_BYTES = 700_000_000  # more than there will be
held = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (held + 600_000_000,) * 2)
for path in sys.argv[1:]:
    sys.frozen = path != "gzip.nc"  # no process of its own tries the others first
    ending = path.rpartition(".")[2]
    read = {"toml": read_rig, "json": NarxModel.load}.get(ending, read_recording)
    try:
        read(path)
        print(f"{path} was read")
    except DeatwinError as error:
        print(error)
# Of this program: ru_maxrss counts what started it as well.
print(next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")))
"""


@pytest.mark.parametrize("ending", READERS)
def test_pipes_and_devices_are_refused_and_not_waited_for(ending: str, tmp_path: Path) -> None:
    for name, make, said in (
        ("pipe", os.mkfifo, "this is a pipe; give a plain file"),
        ("zero", lambda path: os.symlink("/dev/zero", path), "this is a device; give a plain file"),
    ):
        path = tmp_path / f"{name}.{ending}"
        make(path)
        with pytest.raises(DeatwinError, match=f"{path.name}: {said}"):
            READERS[ending](path)


@pytest.mark.parametrize("ending", READERS)
def test_folders_and_links_to_nothing_are_named(ending: str, tmp_path: Path) -> None:
    folder, link = tmp_path / f"folder.{ending}", tmp_path / f"link.{ending}"
    folder.mkdir()
    with pytest.raises(DeatwinError, match=f"{folder.name}: .*Is a directory"):
        READERS[ending](folder)
    link.symlink_to(tmp_path / "gone")
    with pytest.raises(DeatwinError, match=rf"{link.name}: this is a link to .*gone, which does not exist"):
        READERS[ending](link)


@pytest.mark.parametrize("ending", READERS)
def test_a_file_of_ten_gigabytes_is_refused_by_its_size(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"large.{ending}"
    with open(path, "wb") as file:
        file.truncate(10 * 2**30)  # sparse: takes no room on the disk
    most = {"csv": "1 GB", "json": "500 MB", "toml": "1 MB"}.get(ending, "2 GB")
    with pytest.raises(
        DeatwinError, match=rf"{path.name}: the file is too large: 10\.7 GB; at most {most} can be read"
    ):
        READERS[ending](path)


def test_limits_are_where_the_documents_say() -> None:
    page = (Path(__file__).parents[4] / "docs/how-to/files-and-export.md").read_text(encoding="utf-8")
    for limit in (safe_read.RECORDING_BYTES, safe_read.TEXT_BYTES, safe_read.DOCUMENT_BYTES, safe_read.RIG_BYTES):
        assert safe_read.in_words(limit) in page
    for count in (safe_read.ROWS, safe_read.DOCUMENT_VALUES, safe_read.COLUMNS):
        assert f"{count:,}".replace(",", " ") in page


def level_5(*elements: bytes) -> bytes:
    """A MATLAB file of version 5, by its format's description."""
    return b"MATLAB 5.0".ljust(124) + struct.pack("<H2s", 0x0100, b"IM") + b"".join(elements)


def element(kind: int, content: bytes) -> bytes:
    """A tag and what it is of, filled up to 8 bytes."""
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def array(name: bytes, array_class: int, lengths: tuple[int, ...], content: bytes) -> bytes:
    """An array of a class: 1 is a cell, 6 a matrix of doubles."""
    dimensions = struct.pack(f"<{len(lengths)}i", *lengths)
    head = element(6, struct.pack("<II", array_class, 0)) + element(5, dimensions) + element(1, name)
    return element(14, head + content)


def zeros(gigabytes: int) -> bytes:
    """Doubles of 0, packed: a block that ends in a full flush stands by itself and can be repeated."""
    packer, count = zlib.compressobj(9, wbits=-15), gigabytes * 10**9
    head = element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<2i", count // 8, 1)) + element(1, b"time_s")
    tag = struct.pack("<II", 14, len(head) + 8 + count) + head + struct.pack("<II", 9, count)
    begin = packer.compress(tag) + packer.flush(zlib.Z_FULL_FLUSH)
    block = packer.compress(bytes(10**7)) + packer.flush(zlib.Z_FULL_FLUSH)
    return b"\x78\xda" + begin + block * (count // 10**7) + packer.flush()


def structs_of_cells() -> bytes:
    """A struct with a cell that declares a hundred million entries and holds none."""
    cell = array(b"", 1, (100_000_000, 1), b"")
    fields = struct.pack("<HHI", 5, 4, 8) + element(1, b"log\0\0\0\0\0")  # a small element, then the names
    return array(b"s", 2, (1, 1), fields + cell)


def hdf5(path: Path, **options: object) -> None:
    """Three datasets of 8 GB each that take hardly any room, as nothing was written."""
    import h5py

    with h5py.File(path, "w", userblock_size=512 if path.suffix == ".mat" else 0) as file:
        for name in ("time_s", "command_V", "displacement_mm"):
            file.create_dataset(name, shape=(10**9,), dtype="f8", **options)
    if path.suffix == ".mat":
        with open(path, "r+b") as file:
            file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def netcdf_of_one_place(path: Path) -> None:
    """Version 3 with a thousand variables that are the same 8 MB."""
    samples, count = 1_000_000, 1000
    parts = [b"CDF\x02", struct.pack(">iiii", 0, 10, 1, 1), b"t\0\0\0", struct.pack(">i", samples)]
    parts += [struct.pack(">ii", 0, 0), struct.pack(">ii", 11, count)]
    begin = sum(map(len, parts)) + count * (4 + 8 + 4 + 4 + 8 + 4 + 4 + 8)
    for number in range(count):
        name = f"v{number:05}".encode()
        parts.append(struct.pack(">i", len(name)) + name.ljust(8, b"\0") + struct.pack(">ii", 1, 0))
        parts.append(struct.pack(">iiiiq", 0, 0, 6, 8 * samples, begin))
    path.write_bytes(b"".join(parts) + bytes(8 * samples))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the limit of memory is set as Linux does")
def test_what_unpacks_to_too_much_is_refused_within_little_memory(tmp_path: Path) -> None:
    """600 MB more than the libraries take themselves; each of these files would unpack to gigabytes."""
    for package in ("h5py", "nptdms", "xarray", "h5netcdf"):
        pytest.importorskip(package)
    (tmp_path / "zeros.mat").write_bytes(level_5(element(15, zeros(1))))
    (tmp_path / "cells.mat").write_bytes(level_5(array(b"c", 1, (100_000_000, 1), b"")))
    (tmp_path / "nested.mat").write_bytes(level_5(structs_of_cells()))
    (tmp_path / "packed.mat").write_bytes(level_5(element(15, zlib.compress(structs_of_cells()))))
    hdf5(tmp_path / "empty.mat")
    hdf5(tmp_path / "gzip.mat", chunks=(10**6,), compression="gzip")
    hdf5(tmp_path / "gzip.nc", chunks=(10**6,), compression="gzip")
    netcdf_of_one_place(tmp_path / "same.nc")
    (tmp_path / "deep.json").write_text("[" * 100_000)
    (tmp_path / "list.json").write_bytes(b'{"schema": "deatwin/narx/1", "terms": [' + b"[]," * 10_000_000 + b"[]]}")
    (tmp_path / "digits.json").write_text('{"schema": "deatwin/narx/1", "sample_time_s": ' + "9" * 5000 + "}")
    (tmp_path / "whole.json").write_text('{"schema": "deatwin/narx/1", "sample_time_s": ' + "9" * 310 + "}")
    (tmp_path / "infinite.json").write_text('{"schema": "deatwin/narx/1", "sample_time_s": 1e400}')
    (tmp_path / "array.toml").write_text("a = [" + "0," * 499_990 + "]")
    (tmp_path / "digits.toml").write_text("a = " + "9" * 5000)
    (tmp_path / "lines.csv").write_bytes(b"time_s,command_V\n" + b"1,2\n" * 20_000_000)
    (tmp_path / "columns.csv").write_text(",".join(f"c{k}" for k in range(20_000)) + "\n" + ",".join(["1"] * 20_000))
    expected = {
        "zeros.mat": "it unpacks to 700 MB or more; at most 700 MB can be read",
        "cells.mat": "it declares more entries of a cell or struct than it holds; it is damaged",
        "nested.mat": "it declares more entries of a cell or struct than it holds; it is damaged",
        "packed.mat": "it declares more entries of a cell or struct than it holds; it is damaged",
        "empty.mat": "it unpacks to 8 GB or more; at most 700 MB can be read",
        "gzip.mat": "it unpacks to 8 GB or more; at most 700 MB can be read",
        "gzip.nc": "it unpacks to 8 GB or more; at most 700 MB can be read",
        "same.nc": "it declares more samples than it holds; it is damaged",
        "deep.json": "not a readable JSON file (lists are nested too deeply)",
        "list.json": "it holds 20000004 numbers, texts and lists; at most 20000000 can be read",
        "digits.json": f"not a readable JSON file ({'9' * 20}… is not a finite number)",
        "whole.json": f"not a readable JSON file ({'9' * 20}… is not a finite number)",
        "infinite.json": "not a readable JSON file (1e400 is not a finite number)",
        "array.toml": "5 mistakes: (1) line 1: unknown section [a]; known are film, load, drive, sensor",
        "digits.toml": "this is not valid TOML: Exceeds the limit",
        "lines.csv": "it has 20000001 lines; at most 20000000 can be read",
        "columns.csv": "it has 20000 columns; at most 10000 can be read",
    }
    done = subprocess.run(
        [sys.executable, "-c", IN_LITTLE_MEMORY, *expected],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 0 and done.stderr == "", done.stderr[-2000:]
    *said, peak = done.stdout.splitlines()
    for (name, text), line in zip(expected.items(), said, strict=True):
        assert line.startswith(f"{name}: {text}"), line
    assert int(peak) < 1_000_000  # kB, libraries included


@pytest.mark.usefixtures("in_one_process")
def test_samples_in_another_file_are_not_fetched(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    secret = tmp_path / "secret.bin"
    secret.write_bytes(bytes(160))
    for name in ("link", "raw", "virtual"):
        path = tmp_path / f"{name}.mat"
        with h5py.File(path, "w", userblock_size=512) as file:
            if name == "link":
                file["time_s"] = h5py.ExternalLink("secret.h5", "/time_s")
            elif name == "raw":
                file.create_dataset("time_s", shape=(20,), dtype="f8", external=[(str(secret), 0, 160)])
            else:
                layout = h5py.VirtualLayout(shape=(20,), dtype="f8")
                layout[:] = h5py.VirtualSource(str(secret), "time_s", shape=(20,))
                file.create_virtual_dataset("time_s", layout)
        with pytest.raises(DataError, match=f'{path.name}: "time_s" lies in another file'):
            read_recording(path)


@pytest.mark.parametrize("term", ["y(k-1)^99999999999", "u(k-999999999)", "u99999(k-1)", "y(k-1)^" + "9" * 5000])
def test_terms_that_would_fill_the_memory_are_refused(term: str, tmp_path: Path) -> None:
    path = tmp_path / "narx.json"
    NarxModel.from_terms({"y(k-1)": 0.5}, sample_time=0.1).save(path)
    document = json.loads(path.read_text())
    document["terms"][0]["term"] = term
    path.write_text(json.dumps(document))
    with pytest.raises(ModelError, match=r"narx.json: .*(is above|not as the schema)"):
        NarxModel.load(path)
