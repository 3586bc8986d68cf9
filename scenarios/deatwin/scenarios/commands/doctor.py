"""``deatwin doctor``."""

from __future__ import annotations

from typing import Annotated

import typer

from deatwin.scenarios.options import Jobs, Json, Quiet
from deatwin.scenarios.voice import Voice

__all__ = ["doctor"]

OPTIONAL = {
    "nptdms": "TDMS files",
    "h5netcdf": "NetCDF files",
    "xarray": "results as xarray",
    "sysidentpy": "benchmarks against SysIdentPy",
    "dask": "sweeps on a cluster",
}
Warm = Annotated[
    bool, typer.Option("--warm", help="Compile the usual plants ahead, so that the first diagnosis is quick.")
]


def doctor(warm: Warm = False, jobs: Jobs = -1, as_json: Json = False, quiet: Quiet = False) -> None:
    """Say what is installed, whether a compiler was found, and what is slower without it."""
    from deatwin.plant.integrator.compiled import cache_folder, compiler
    from deatwin.scenarios.provenance import versions

    voice = Voice(as_json=as_json, quiet=quiet)
    installed = versions()
    for name, text in installed.items():
        voice.say(f"{name:14} {text}")
    program = compiler()
    voice.say(f"{'compiler':14} {program or 'none found: simulations run about ten times slower'}")
    voice.say(f"{'cache':14} {cache_folder()}")
    optional = versions(OPTIONAL)
    for name, use in OPTIONAL.items():
        voice.say(f"{name:14} {optional.get(name, 'not installed')} ({use})")
    compiled = _warm(voice, jobs) if warm else 0
    if warm:
        voice.say(f"{compiled} plants are compiled" if program else "nothing was compiled: there is no compiler")
    voice.result({
        "versions": installed, "compiler": program, "cache": str(cache_folder()),
        "optional": {name: optional.get(name) for name in OPTIONAL}, "compiled": compiled,
    })  # fmt: skip


def _warm(voice: Voice, jobs: int) -> int:
    """Compile the plants that a diagnosis of a diaphragm asks for; how many there are."""
    from deatwin.ident.parallel import run_jobs
    from deatwin.plant.integrator.compiled import compiler
    from deatwin.scenarios.warming import compile_plant, usual_plants

    if compiler() is None:
        return 0
    plants = usual_plants()
    with voice.progress("compiling") as progress:
        run_jobs(
            compile_plant, [(plant,) for plant in plants], workers=jobs,
            finished=lambda count: progress(count / len(plants), f"compiled {count} of {len(plants)}"),
        )  # fmt: skip
    return len(plants)
