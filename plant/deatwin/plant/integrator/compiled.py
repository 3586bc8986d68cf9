"""Compile CasADi Functions to machine code, once per user, if a C compiler is found."""

from __future__ import annotations

import ctypes
import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from threading import Lock

import casadi as ca
import numpy as np

from deatwin.plant.errors import DataError
from deatwin.plant.files.replacing import replacing
from deatwin.plant.integrator.lanes import Exchange
from deatwin.plant.interrupts import obey

logger = logging.getLogger(__name__)
FLAGS = (
    "-O2",
    "-fPIC",
    "-shared",
    # Square roots need no errno, nothing traps, and quotients by the same number share its reciprocal (one rounding
    # more). All other arithmetic is as written.
    "-fno-math-errno",
    "-fno-trapping-math",
    "-freciprocal-math",
)
GCC_ONLY = (
    # Omit passes that find nothing in straight-line code and take a third of the time.
    "-fno-tree-pre",
    "-fno-gcse",
    "-fno-tree-vrp",
    "-fno-schedule-insns2",
    "-fno-code-hoisting",
    # Allocate registers for a whole function at once: straight-line code stays the same, in half of the time and with a
    # third of the memory.
    "-fira-region=one",
    # Call helpers directly, although another library could replace them. Inlining them at every call would take a tenth
    # of the time and gain nothing.
    "-fno-semantic-interposition",
    "-fno-inline-small-functions",
)
"""Options for GCC alone: Clang refuses some of these and does not need the others."""
LOOPS = ("-O3",)  # Compiler options that speed up code with loops, but not straight-line code
THIS_PROCESSOR = "-march=native"
WIDE_VECTORS = "__AVX__"
"""Macro that a compiler defines if its vectors hold at least four numbers; with fewer, lanes gain nothing."""
ONE_AT_A_TIME = Lock()  # Lock that makes threads wait for the one that already builds the library they need
SAID = "DEATWIN_SAID"  # Environment variable that records warnings, so that worker processes do not repeat them


def cache_folder() -> Path:
    """Return the folder of compiled code, created with mode 0700; ``DEATWIN_CACHE`` overrides it."""
    folder = Path(os.environ.get("DEATWIN_CACHE") or _user_cache() / "deatwin")
    if not folder.is_dir():
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.chmod(0o700)  # regardless of the umask
    return folder


def _user_cache() -> Path:
    """Return the folder in which the system keeps a user's caches."""
    if platform.system() == "Windows":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if platform.system() == "Darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def compiler() -> str | None:
    """Return the path of the C compiler, or None; ``DEATWIN_COMPILER`` sets it, and disables it if empty."""
    return _compiler(os.environ.get("DEATWIN_COMPILER"))


@lru_cache(maxsize=4)
def _compiler(wanted: str | None) -> str | None:
    if wanted is not None:
        return shutil.which(wanted) if wanted else None
    if platform.system() == "Windows":  # the options are those of a Unix linker
        return None
    return next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)


def key_of(origin: Iterable[ca.Function], numbers: np.ndarray) -> str | None:
    """Return the key of generated code, from equations, this package's code and the compiler."""
    program = compiler()
    try:
        if program is None:
            return None
        return _digest(*(f.serialize() for f in origin), numbers.tobytes().hex(), _own_code(), _target(program).key)
    except (OSError, subprocess.SubprocessError) as error:
        logger.debug("code has no key: %s", error)
        return None


def recalled(names: Iterable[str], key: str | None) -> dict[str, ca.Function] | None:
    """Return functions that were compiled before, by key."""
    if key is None:
        return None
    try:
        library = cache_folder() / Path((cache_folder() / f"{key}.txt").read_text(encoding="utf-8")).name
        return _loaded(names, library) if _sound(library) else None
    except (OSError, RuntimeError, ValueError) as error:
        logger.debug("no code is kept under %s: %s", key, error)
        return None


def compile_functions(
    functions: Mapping[str, ca.Function], in_lanes: Callable[[], Exchange] = Exchange, key: str | None = None
) -> dict[str, ca.Function]:
    """Return the functions, compiled if possible."""
    program = compiler()
    if program is None:
        _say_once("no C compiler found: simulations run about twenty times slower")
        return dict(functions)
    renamed = {name: _named(name, function) for name, function in functions.items()}
    generator = ca.CodeGenerator("plant.c")
    for function in renamed.values():
        generator.add(function)
    source = generator.dump()
    obey()  # CasADi may have lost an interrupt
    try:
        target = _target(program)
        if target.wide_vectors:
            source = in_lanes().into(source)
        library = _library(source, target)
        if key is not None:
            with replacing(cache_folder() / f"{key}.txt") as note:
                note.write_text(library.name, encoding="utf-8")
    except (OSError, DataError) as error:
        _say_once(f"the compiled plant cannot be kept ({error}): simulations run about twenty times slower")
        return dict(functions)
    except subprocess.SubprocessError as error:
        _say_once(f"{program} could not compile the plant ({error}): simulations run about twenty times slower")
        return dict(functions)
    try:
        return _loaded(functions, library)
    except RuntimeError as error:
        logger.debug("%s: %s", library, error)
        _say_once(f"the compiled plant in {cache_folder()} cannot be loaded: simulations run about twenty times slower")
        return dict(functions)


def compile_source(source: str) -> Path | None:
    """Compile C code to a library in the user's cache, once."""
    program = compiler()
    if program is None:
        _say_once("no C compiler found: loops over samples run about a hundred times slower")
        return None
    try:
        target = _target(program)
        flags = (*target.flags, *LOOPS)
        return _library(source, replace(target, flags=flags, key="\0".join((target.key, *LOOPS))))
    except (OSError, subprocess.SubprocessError) as error:
        logger.debug("%s: %s", program, error)  # not in the warning: it names temporary files, which always differ
        _say_once(f"{program} could not compile a loop over samples: it runs about a hundred times slower")
        return None


def load_source(source: str) -> ctypes.CDLL | None:
    """Compile C code, once, and load it; None without a compiler, or if the cache folder permits no execution."""
    library = compile_source(source)
    with suppress(OSError):
        return None if library is None else ctypes.CDLL(str(library))
    return None


@dataclass(frozen=True, kw_only=True)
class _Target:
    """Compiler and the processor for which it compiles."""

    program: str
    flags: tuple[str, ...]
    wide_vectors: bool
    key: str


@lru_cache(maxsize=4)
def _target(program: str) -> _Target:
    """Describe the compiler's target on this computer, for the key, because computers may share a user's cache."""
    version_text = subprocess.run([program, "--version"], check=True, capture_output=True, text=True).stdout
    asked = subprocess.run(
        [program, THIS_PROCESSOR, "-dM", "-E", "-xc", os.devnull], check=False, capture_output=True, text=True
    )
    knows = asked.returncode == 0
    macros = asked.stdout if knows else ""
    flags = (*FLAGS, THIS_PROCESSOR) if knows else FLAGS
    if "__GNUC__" in macros and "__clang__" not in macros:
        flags = (*flags, *GCC_ONLY)
    key = "\0".join((version_text, macros, *flags, platform.system(), platform.machine(), version("casadi")))
    return _Target(program=program, flags=flags, wide_vectors=WIDE_VECTORS in macros, key=key)


@lru_cache(maxsize=1)
def _own_code() -> str:
    """Return a digest of the modules of this folder, which turn equations into code."""
    return _digest(*(file.read_text(encoding="utf-8") for file in sorted(Path(__file__).parent.glob("*.py"))))


def _digest(*parts: str) -> str:
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:32]


def _named(name: str, function: ca.Function) -> ca.Function:
    arguments = function.mx_in()
    return ca.Function(name, arguments, function.call(arguments))


def _library(source: str, target: _Target) -> Path:
    folder, digest = cache_folder(), _digest(source, target.key)
    with ONE_AT_A_TIME:
        known = next((found for found in folder.glob(f"{digest}-*.so") if _sound(found)), None)
        return known or _built(source, target, folder, digest)


def _loaded(names: Iterable[str], library: Path) -> dict[str, ca.Function]:
    return {name: ca.external(name, str(library)) for name in names}


def _sound(library: Path) -> bool:
    """Return whether a library is intact, by the checksum in its name; remove it if not."""
    try:
        if _checksum(library) == library.stem.rpartition("-")[2]:
            return True
    except (OSError, ValueError):  # ValueError: a null character in the name
        return False
    with suppress(OSError):
        library.unlink()
    logger.warning("%s was damaged: it is removed and built anew", library)
    return False


def _checksum(library: Path) -> str:
    return hashlib.sha256(library.read_bytes()).hexdigest()[:16]


def _built(source: str, target: _Target, folder: Path, digest: str) -> Path:
    # Built under another name and then renamed, so that a process that starts meanwhile never loads half a file.
    with tempfile.TemporaryDirectory(dir=folder) as work:
        code, built = Path(work) / "plant.c", Path(work) / "plant.so"
        code.write_text(source)
        subprocess.run(
            [target.program, *target.flags, str(code), "-o", str(built), "-lm"],
            check=True,
            capture_output=True,
            text=True,
        )
        return built.replace(folder / f"{digest}-{_checksum(built)}.so")


def _say_once(text: str) -> None:
    """Warn once in this process and its child processes."""
    said = os.environ.get(SAID, "")
    if text not in said.splitlines():
        os.environ[SAID] = f"{said}\n{text}".strip()
        logger.warning(text)
