"""``deatwin doctor``."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from deatwin.app.options import Jobs, Json, Quiet
from deatwin.studies.voice import Voice

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from deatwin.plant.model import Plant


@dataclass(frozen=True, kw_only=True)
class Part:
    """An optional package."""

    package: str
    use: str
    versions: str = ""  # Versions that suffice, as in pyproject.toml; empty if any does

    @property
    def command(self) -> str:
        """Command that installs it, wherever deatwin itself came from."""
        return f'pip install "{self.package}{self.versions}"' if self.versions else f"pip install {self.package}"


OPTIONAL = (
    Part(package="nptdms", use="TDMS files", versions=">=1.9"),
    Part(package="openpyxl", use="Excel workbooks", versions=">=3.1"),
    Part(package="xarray", use="NetCDF files, results as xarray", versions=">=2024.6"),
    Part(package="h5netcdf", use="NetCDF files", versions=">=1.3"),
    Part(package="h5py", use="MATLAB 7.3 and NetCDF files", versions=">=3.11"),
    Part(package="arviz", use="posteriors of SVB models as ArviZ data", versions=">=0.18"),
    Part(package="fmpy", use="export of FMUs", versions=">=0.3.20"),
    Part(package="slycot", use="H-infinity controllers", versions=">=0.6"),
    Part(package="dask", use="sweeps on a cluster", versions=">=2024.6"),
    Part(package="distributed", use="sweeps on a cluster", versions=">=2024.6"),
    Part(package="nicegui", use="live view", versions=">=3.18,<4"),
    Part(package="sysidentpy", use="benchmarks against SysIdentPy", versions=">=0.6"),
    Part(package="fastcan", use="benchmarks against fastcan", versions=">=0.6"),
    Part(package="pandas", use="recordings as data frames"),
    Part(package="nonlinear_benchmarks", use="public recordings by download"),
)
SLOWER = (
    ("simulations", 20, "bench_plant.py"),
    ("free runs of NARX models", 250, "bench_semp.py"),
    ("Kalman filters and smoothers", 6, "bench_kalman.py"),
)
"""Tasks, the factor by which they are slower without a compiler, and the script of tests/benchmarks that measured
it."""

Warm = Annotated[
    bool,
    typer.Option("--warm", help="Compile in advance what a diagnosis needs, so that your first diagnosis is faster."),
]
WarmRig = Annotated[
    str | None,
    typer.Option("--rig", metavar="RIG", help="Rig file whose plants --warm compiles; a diaphragm by default."),
]


def doctor(
    warm: Warm = False, rig: WarmRig = None, jobs: Jobs = -1, as_json: Json = False, quiet: Quiet = False
) -> None:
    """Show what is installed, whether a compiler was found, and what is slower without it.

    Example: deatwin doctor

    Before the first diagnosis: deatwin doctor --warm --rig rig.toml
    """
    from deatwin.plant.integrator.compiled import compiler
    from deatwin.studies.provenance import versions

    if rig is not None and not warm:
        raise typer.BadParameter("it needs --warm", param_hint="--rig")
    needed = list(_needed(rig)) if warm else []
    voice = Voice(as_json=as_json, quiet=quiet)
    program, optional = compiler(), versions(part.package for part in OPTIONAL)
    found = {
        "versions": versions(),
        "compiler": program,
        "slower_without_compiler": {what: by for what, by, _ in SLOWER},
        "optional": {
            part.package: {"version": optional.get(part.package), "use": part.use, "install": part.command}
            for part in OPTIONAL
        },
        **_cache(),
        "data": _data(),
    }
    lines = list(_lines(found))
    width = max(len(label) for label, _ in lines)
    for label, text in lines:
        voice.say(f"{label:{width}} {text}")
    compiled = _warm(voice, jobs, needed) if program else 0
    if warm:
        voice.say(
            f"{compiled} plants are compiled" if program else "nothing was compiled, because there is no compiler"
        )
    voice.result({**found, "compiled": compiled})


def _cache() -> dict[str, Any]:
    """Return the folder of compiled plants, and its size on the disk."""
    from deatwin.plant.integrator.compiled import cache_folder

    try:
        folder = cache_folder()
    except OSError as error:
        return {"cache": None, "cache_fault": f"{error.filename}: {error.strerror}"}
    sizes = []
    for place, folders, files in os.walk(folder):  # passes over a folder that another process removes meanwhile
        for name in (*folders, *files):
            with suppress(FileNotFoundError):
                sizes.append((Path(place) / name).stat().st_size)
    return {"cache": str(folder), "cache_files": len(sizes), "cache_bytes": sum(sizes)}


def _data() -> dict[str, Any]:
    """Return the folder of public recordings, and its content."""
    from deatwin.studies.stories import DATA_VARIABLE

    named = os.environ.get(DATA_VARIABLE)
    folder = Path(named) if named else None
    held = sorted(entry.name for entry in folder.iterdir() if entry.is_dir()) if folder and folder.is_dir() else None
    return {"variable": DATA_VARIABLE, "folder": named, "holds": held}


def _lines(found: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Return the lines of the answer, each with a label and a text."""
    yield from found["versions"].items()
    slower = ", ".join(f"{what} {by} times" for what, by, _ in SLOWER)
    yield "compiler", found["compiler"] or "no compiler was found on the path: install gcc or clang"
    yield "", f"without a compiler, programs are slower by about: {slower}"
    scripts = ", ".join(script for _, _, script in SLOWER)
    yield "", f"(measured by {scripts} in tests/benchmarks; to use another compiler, set DEATWIN_COMPILER)"
    for name, part in found["optional"].items():
        yield name, f"{part['version'] or 'absent: ' + part['install']} ({part['use']})"
    if found["cache"] is None:
        yield (
            "cache",
            f"{found['cache_fault']}: without a cache folder nothing is compiled; set DEATWIN_CACHE to another folder",
        )
    else:
        yield "cache", f"{found['cache']}: {found['cache_files']} files, {found['cache_bytes'] / 1e6:.1f} MB"
    data = found["data"]
    if data["folder"] is None:
        yield "data", f"{data['variable']} is not set: scenarios with public recordings need this variable or --data"
    elif data["holds"] is None:
        yield (
            "data",
            f"{data['folder']}: no such folder; {data['variable']} must name the folder of the public recordings",
        )
    else:
        yield "data", f"{data['folder']}: {', '.join(data['holds']) or 'empty'} ({data['variable']})"


def _warm(voice: Voice, jobs: int, plants: Sequence[Plant]) -> int:
    """Compile plants; return how many."""
    from deatwin.ident.parallel import run_jobs

    if not plants:
        return 0
    with voice.progress("compiling") as progress:
        run_jobs(
            _compile,
            [(plant,) for plant in plants],
            workers=jobs,
            finished=lambda count: progress(count / len(plants), f"compiled {count} of {len(plants)}"),
        )
    return len(plants)


def _needed(source: str | None) -> Iterator[Plant]:
    """Yield the plants of a diagnosis: in each variant of the rig the plant, a finer one, and that with each effect."""
    from deatwin.ident.mismatch.prepare import elsewhere
    from deatwin.ident.mismatch.refit.base import FEWER
    from deatwin.plant.effects.base import Alone
    from deatwin.plant.model import Plant
    from deatwin.plant.model_error import Refinable
    from deatwin.plant.rigs.diaphragm import Diaphragm
    from deatwin.plant.sources import load_plant

    nominal = Plant(rig=Diaphragm(ball_is_known=False)) if source is None else load_plant(source).plant
    read = nominal.rig.reading  # which is no part of the equations
    for rig in dict.fromkeys(replace(variant, reading=read) for variant in (nominal.rig, *nominal.rig.rivals())):
        plant = nominal.with_rig(rig)
        few = replace(plant, stages=min(FEWER, plant.stages))  # candidates are simulated with fewer stages
        yield from (plant, few)
        if isinstance(rig, Refinable):
            yield plant.with_rig(rig.finer())
        known = tuple(effect for effect in nominal.rig.effects() if few.accepts(effect))
        yield from (few.with_effects(effect) for effect in (*known, *elsewhere(few, known, {Alone.TOLD})))


def _compile(plant: Plant) -> None:
    """Compile the plant's equations into the user's cache."""
    plant.simulator  # noqa: B018  (building it compiles it)
