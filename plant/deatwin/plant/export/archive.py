"""Build FMU archives: compile the sources for this computer, and zip all files."""

from __future__ import annotations

import platform
import subprocess
import zipfile
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from deatwin.plant.errors import ModelError
from deatwin.plant.files.replacing import replacing
from deatwin.plant.integrator.compiled import compiler

_ENDINGS = {"Linux": "so", "Darwin": "dylib"}
_PROCESSORS = {"x86_64": "x86_64", "AMD64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}
_FLAGS = ("-std=c99", "-O1", "-fPIC", "-shared", "-fvisibility=hidden")
_SAID = 300  # Number of characters that an error quotes from the start of a compiler's messages


def headers() -> Path:
    """Return the folder of the FMI headers, which fmpy provides."""
    found = find_spec("fmpy")
    if found is None or found.origin is None:
        raise ModelError('an FMU needs the FMI 3.0 headers: install them with pip install "fmpy>=0.3.20"')
    return Path(found.origin).parent / "c-code"


def compiled(contents: Mapping[str, bytes], name: str) -> dict[str, bytes]:
    """Return the files of an FMU, including a binary for this computer."""
    include, program, system = headers(), compiler(), platform.system()
    if program is None or system not in _ENDINGS:
        raise ModelError("an FMU needs a C compiler, and none was found (deatwin doctor): install gcc or clang")
    machine = _PROCESSORS.get(platform.machine(), platform.machine())
    target = f"binaries/{machine}-{system.lower()}/{name}.{_ENDINGS[system]}"
    with TemporaryDirectory() as folder:
        sources = []
        for place, content in contents.items():
            if place.startswith("sources/") and place.endswith((".c", ".h")):
                (Path(folder) / Path(place).name).write_bytes(content)
                sources += [Path(place).name] if place.endswith(".c") else []
        command = [program, *_FLAGS, f"-I{include}", "-I.", *sources, "-o", "built", "-lm"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ModelError(f"{program} could not compile the FMU: {done.stderr.strip()[:_SAID]}")
        return {**contents, target: (Path(folder) / "built").read_bytes()}


def write_fmu(path: str | Path, contents: Mapping[str, bytes]) -> Path:
    """Zip the files of an FMU under a temporary name, then rename the archive."""
    with replacing(path) as beside, zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as archive:
        for place, content in sorted(contents.items()):
            archive.writestr(place, content)
    return Path(path)
