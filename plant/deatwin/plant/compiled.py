"""CasADi Functions compiled to machine code, once per user, where a C compiler is found."""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

import casadi as ca

__all__ = ["cache_folder", "compile_functions", "compiler"]

logger = logging.getLogger(__name__)
FLAGS = ("-O2", "-fPIC", "-shared")


def cache_folder() -> Path:
    """Where compiled code is kept, made with mode 0700; ``DEATWIN_CACHE`` overrides it."""
    folder = Path(os.environ.get("DEATWIN_CACHE") or _user_cache() / "deatwin")
    if not folder.is_dir():
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.chmod(0o700)  # whatever the umask
    return folder


def _user_cache() -> Path:
    """Where the system keeps a user's caches."""
    if platform.system() == "Windows":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    if platform.system() == "Darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


@lru_cache(maxsize=1)
def compiler() -> str | None:
    """Path of the C compiler, or None; ``DEATWIN_COMPILER`` names another, or none when it is empty."""
    wanted = os.environ.get("DEATWIN_COMPILER")
    if wanted is not None:
        return shutil.which(wanted) if wanted else None
    if platform.system() == "Windows":  # a Unix linker line is used below
        return None
    return next((path for name in ("cc", "gcc", "clang") if (path := shutil.which(name))), None)


def compile_functions(functions: Mapping[str, ca.Function]) -> dict[str, ca.Function]:
    """The same functions, compiled if possible.

    Parameters
    ----------
    functions : mapping of str to casadi.Function
        Names are C identifiers.

    Returns
    -------
    dict of str to casadi.Function
        Compiled; or as given, evaluated by CasADi's virtual machine, where there is no compiler or it fails.
    """
    program = compiler()
    if program is None:
        _say_once("no C compiler found: simulations run about ten times slower")
        return dict(functions)
    renamed = {name: _named(name, function) for name, function in functions.items()}
    generator = ca.CodeGenerator("plant.c")
    for function in renamed.values():
        generator.add(function)
    source = generator.dump()
    try:
        library = _library(source, program)
        return {name: ca.external(name, str(library)) for name in functions}
    except (OSError, RuntimeError, subprocess.SubprocessError) as error:
        _say_once(f"{program} could not compile the plant ({error}): simulations run about ten times slower")
        return dict(functions)


def _named(name: str, function: ca.Function) -> ca.Function:
    arguments = function.mx_in()
    return ca.Function(name, arguments, function.call(arguments))


def _library(source: str, program: str) -> Path:
    key = hashlib.sha256("\0".join((source, _version(program), *FLAGS, _processor())).encode()).hexdigest()[:32]
    folder = cache_folder()
    library = folder / f"{key}.so"
    if library.exists():
        return library
    # Built beside and renamed, so that two processes that start together never load half a file.
    with tempfile.TemporaryDirectory(dir=folder) as work:
        code, built = Path(work) / "plant.c", Path(work) / "plant.so"
        code.write_text(source)
        subprocess.run(
            [program, *FLAGS, str(code), "-o", str(built), "-lm"], check=True, capture_output=True, text=True
        )
        built.replace(library)
    return library


@lru_cache(maxsize=4)
def _version(program: str) -> str:
    answer = subprocess.run([program, "--version"], check=True, capture_output=True, text=True)
    return answer.stdout.splitlines()[0] if answer.stdout else program


def _processor() -> str:
    return f"{platform.system()} {platform.machine()} casadi {version('casadi')}"


@lru_cache(maxsize=8)
def _say_once(text: str) -> None:
    logger.warning(text)
