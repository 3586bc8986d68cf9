"""Compare what two commits compute, file by file: ``python tests/tools/oracle.py BASE HEAD``.

A change that is meant to move code, not results, must leave every result as it was. Both commits are installed and run
on this machine with the same seeds, and their files are compared byte for byte:

- for each of the nine experiments in tests/recordings: ``narx.json`` (identify), ``diagnosis.json`` and ``model.json``
  (diagnose), and ``check.json`` (the check that the README shows, with both models and the diagnosis);
- for the tiny study of concealed physics: every case, the key and the summary.

Results are kept in the system's temporary folder under what they depend on (the product's files, the recordings, the
commands, the installed packages), so that several commits are compared with one BASE at the cost of one run each, and
a commit that leaves the product alone costs nothing. Nothing is kept in the repository: other machines round otherwise.
"""

from __future__ import annotations

import argparse
import fcntl
import gzip
import hashlib
import io
import json
import os
import resource
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
RECORDINGS = ROOT / "tests" / "recordings"
INPUTS = ("rig.toml", "noise.csv", "steps.csv", "check.csv")
STUDY = "tiny-study"
COMMANDS = {
    "recording": (
        "identify noise.csv --method svb --out narx.json",
        "diagnose rig.toml noise.csv steps.csv --seed 0 --jobs 1 --out found",
        "check narx.json --plant found/model.json --diagnosis found --recording check.csv --seed 0 --out control",
    ),
    STUDY: ("scenario concealed-physics --size tiny --seed 0 --jobs 1 --out study",),
}
"""Of one process each: as many experiments as there are processors run side by side."""
COMPARED = {
    "recording": ("narx.json", "found/diagnosis.json", "found/model.json", "control/check.json"),
    STUDY: ("study/key.json", "study/concealed-physics.json", "study/cases/*.json"),
}
EXEMPT = {
    "found/model.json": {"/deatwin": "the version that wrote the file"},
    "study/concealed-physics.json": {"/seal": "a hash of the source files and of their modules' names"},
    "study/cases/*.json": {
        "/seal": "a hash of the source files and of their modules' names",
        "/seconds": "processor time",
        "/seconds_in_all": "processor time",
    },
}
"""What may differ between equal runs, by file and JSON path, with the reason. No ``run.json`` is compared: it holds all
else that may (command, time, versions, machine)."""
CASES_AS_JSON = """
import pathlib, scipy.io
for path in pathlib.Path("study/cases").glob("*.nc"):
    with scipy.io.netcdf_file(path, mmap=False) as case:
        path.with_suffix(".json").write_bytes(b"".join(case.variables["record"][:].ravel().tolist()))
"""
"""A case's file is NetCDF; its variable ``record`` is the JSON document."""


class RunError(Exception):
    """A commit that could not be installed, or a command of it that failed."""


def call(*arguments: str | Path, folder: Path = ROOT, environment: Mapping[str, str] | None = None) -> bytes:
    """Run a program and return what it prints."""
    words = [str(word) for word in arguments]
    done = subprocess.run(
        words, cwd=folder, env=environment, stdin=subprocess.DEVNULL, capture_output=True, check=False
    )
    if done.returncode:
        said = (done.stderr or done.stdout).decode(errors="replace").strip()[-2000:]
        raise RunError(f"{' '.join(words)} (status {done.returncode}):\n{said}")
    return done.stdout


def clean_environment(**own: str) -> dict[str, str]:
    """The user's environment without what could lead to another deatwin, and with one thread a process."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "DEATWIN", "VIRTUAL_"))}
    threads = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
    return {**kept, **threads, "PYTHONHASHSEED": "0", "PIP_DISABLE_PIP_VERSION_CHECK": "1", **own}


def digest(*parts: str | bytes) -> str:
    """Short hash of several texts."""
    found = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else part
        found.update(len(data).to_bytes(8, "big") + data)
    return found.hexdigest()[:16]


@contextmanager
def made_once(folder: Path) -> Iterator[Path | None]:
    """Give an empty folder to fill, which then becomes `folder`; None if that is there. Other oracles wait."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    with open(folder.with_name(folder.name + ".lock"), "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if folder.is_dir():
            yield None
            return
        unfinished = folder.with_name(folder.name + ".unfinished")
        shutil.rmtree(unfinished, ignore_errors=True)
        unfinished.mkdir()
        yield unfinished
        unfinished.rename(folder)


@dataclass(frozen=True)
class Commit:
    """A commit, and where its installed packages and results are kept."""

    name: str
    """As it was given."""
    commit: str
    key: str
    """Hash of all that its results depend on but for the inputs of a run."""
    needed: tuple[str, ...]
    """Packages to install beside it."""
    repository: Path
    cache: Path

    @classmethod
    def of(cls, name: str, repository: Path, cache: Path) -> Commit:
        """Look a commit up. A branch may move while it is run, so that its hash is kept."""
        commit = call("git", "rev-parse", "--verify", f"{name}^{{commit}}", folder=repository).decode().strip()
        settings = tomllib.loads(call("git", "show", f"{commit}:pyproject.toml", folder=repository).decode())
        project, build, hatch = settings["project"], settings["build-system"], settings["tool"]["hatch"]
        trees = call("git", "ls-tree", commit, *hatch["build"]["targets"]["wheel"]["sources"], folder=repository)
        key = digest(trees, json.dumps([project, build, hatch], sort_keys=True), sys.version)
        needed = (*project.get("dependencies", ()), *build["requires"])
        return cls(name, commit, key, needed, repository, cache)

    def python(self) -> Path:
        """Interpreter of an environment with the packages that the project depends on, made once for all commits.

        Both commits get the same releases of these, so that a difference can only come from the commits.
        """
        folder = self.cache / f"environment-{digest(*sorted(self.needed), sys.version)}"
        with made_once(folder) as fresh:
            if fresh is not None:
                print(f"installing the packages that {self.name} depends on", flush=True)
                call(sys.executable, "-m", "venv", fresh)
                if self.needed:
                    pip = (fresh / "bin" / "python", "-m", "pip", "install", "-q")
                    call(*pip, *self.needed, environment=clean_environment())
        return folder / "bin" / "python"

    def installed(self) -> Path:
        """Folder of the commit's own packages, built from its files as a wheel and installed as a user's would be.

        A checkout on PYTHONPATH would hide files that the wheel lacks, and its entry points.
        """
        folder = self.cache / f"installed-{self.key}"
        with made_once(folder) as fresh:
            if fresh is not None:
                with tempfile.TemporaryDirectory() as source:
                    packed = io.BytesIO(call("git", "archive", self.commit, folder=self.repository))
                    with tarfile.open(fileobj=packed) as files:
                        # The archive is of our own commit; releases before 3.11.4 know no filter.
                        files.extractall(source, **({"filter": "data"} if hasattr(tarfile, "data_filter") else {}))
                    options = ("-q", "--no-deps", "--no-build-isolation", "--target", fresh)
                    call(self.python(), "-m", "pip", "install", *options, source, environment=clean_environment())
        return folder

    def results(self, job: Job) -> Path:
        """Folder of a job's results, run if they are not there."""
        site, python = self.installed(), self.python()
        folder = self.cache / f"results-{self.key}" / f"{job.name}-{job.key}"
        with made_once(folder) as fresh:
            if fresh is not None:
                started = time.monotonic()
                for name, content in job.inputs.items():
                    (fresh / name).write_bytes(content)
                environment = clean_environment(PYTHONPATH=str(site))
                for command in COMMANDS[job.kind]:
                    call(python, site / "bin" / "deatwin", *command.split(), folder=fresh, environment=environment)
                if job.kind == STUDY:
                    call(python, "-c", CASES_AS_JSON, folder=fresh, environment=environment)
                print(f"{self.name}: {job.name}, {time.monotonic() - started:.0f} s", flush=True)
        return folder


@dataclass(frozen=True)
class Job:
    """An experiment, or the study, with the content of its input files by name."""

    name: str
    kind: str
    inputs: Mapping[str, bytes]

    @classmethod
    def of(cls, folder: Path) -> Job:
        """An experiment from its folder, where files may be compressed; FileNotFoundError if one is absent."""
        packed = {name: folder / f"{name}.gz" for name in INPUTS}
        unpacked = {name: gzip.decompress(path.read_bytes()) for name, path in packed.items() if path.is_file()}
        return cls(folder.name, "recording", {n: unpacked.get(n) or (folder / n).read_bytes() for n in INPUTS})

    @property
    def key(self) -> str:
        return digest(*COMMANDS[self.kind], CASES_AS_JSON, *self.inputs.values())

    def files(self, *folders: Path) -> list[tuple[str, str]]:
        """Each file to compare that either folder holds or ought to hold, with its entry of `COMPARED`."""
        found = []
        for entry in COMPARED[self.kind]:
            names = {str(path.relative_to(folder)) for folder in folders for path in folder.glob(entry)}
            found += [(name, entry) for name in sorted(names) or [entry]]
        return found


def without(document: Any, paths: Sequence[str]) -> Any:
    """A document without some of its outermost entries."""
    return {name: value for name, value in document.items() if f"/{name}" not in paths} if paths else document


def first_difference(base: Any, head: Any, path: str = "") -> str:
    """JSON path and both values where two documents differ first; empty if they do not."""
    if type(base) is not type(head):
        return f"{path or '/'}: {_short(base)} -> {_short(head)}"
    if isinstance(base, dict):
        for name in [*base, *(name for name in head if name not in base)]:
            if name not in head or name not in base:
                return f"{path}/{name}: only in {'BASE' if name in base else 'HEAD'}"
            if found := first_difference(base[name], head[name], f"{path}/{name}"):
                return found
        return "" if list(base) == list(head) else f"{path or '/'}: the order of {_short(list(base))}"
    if isinstance(base, list):
        for number, (left, right) in enumerate(zip(base, head, strict=False)):
            if found := first_difference(left, right, f"{path}/{number}"):
                return found
        return "" if len(base) == len(head) else f"{path or '/'}: {len(base)} -> {len(head)} entries"
    return "" if repr(base) == repr(head) else f"{path or '/'}: {_short(base)} -> {_short(head)}"


def _short(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else text[:57] + "..."


def compare(base: Path, head: Path, exempt: Sequence[str] = ()) -> str:
    """How two files differ, but for exempt JSON paths; empty if they are equal byte for byte."""
    there = [name for name, path in (("BASE", base), ("HEAD", head)) if path.is_file()]
    if len(there) < 2:
        return f"/: only in {there[0]}" if there else "/: in neither"
    contents = base.read_bytes(), head.read_bytes()
    if contents[0] == contents[1]:
        return ""
    documents = [json.loads(content, parse_float=str) for content in contents]  # numbers as they are written
    if found := first_difference(*(without(document, exempt) for document in documents)):
        return found
    return "" if first_difference(*documents) else "/: the same values, written otherwise"


def jobs_of(recordings: Path, only: Sequence[str]) -> tuple[list[Job], dict[str, str]]:
    """The jobs to run, the longest first, and why others are not."""
    folders = {path.name: path for path in sorted(recordings.iterdir()) if path.is_dir()}
    if unknown := sorted(set(only) - {STUDY, *folders}):
        raise SystemExit(f"--only: there is no {', '.join(unknown)} (there are: {', '.join((STUDY, *folders))})")
    wanted, skipped = [], {}
    if not only or STUDY in only:
        wanted.append(Job(STUDY, STUDY, {}))
    for name, folder in folders.items():
        try:
            if not only or name in only:
                wanted.append(Job.of(folder))
        except FileNotFoundError as error:
            skipped[name] = f"{Path(error.filename).name} is absent"
    return wanted, skipped


def report(job: Job, base: Path, head: Path) -> bool:
    """Print a row for each file of a job; say whether all are equal."""
    equal = True
    for name, entry in job.files(base, head):
        found = compare(base / name, head / name, list(EXEMPT.get(entry, ())))
        equal &= not found
        print(f"{job.name:<26} {Path(name).name:<38} {f'differs at {found}' if found else 'equal'}", flush=True)
    return equal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run both commits and compare; 0 if every file is equal."""
    place = Path(tempfile.gettempdir()) / f"deatwin-oracle-{os.getuid()}"
    apart = [f"  {file} {path}: {why}" for file, paths in EXEMPT.items() for path, why in paths.items()]
    parser = argparse.ArgumentParser(
        description=__doc__,
        epilog="\n".join(["may differ, all else may not:", *apart]),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("base", metavar="BASE", help="commit before the change")
    parser.add_argument("head", metavar="HEAD", help="commit after it")
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help=f"experiments, or {STUDY}")
    parser.add_argument("--repository", type=Path, default=ROOT, help="where the commits are")
    parser.add_argument("--recordings", type=Path, default=RECORDINGS, help="folder with one folder an experiment")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="how many run side by side")
    parser.add_argument("--cache", type=Path, default=place, help=f"where results are kept (default {place})")
    given = parser.parse_args(arguments)
    given.cache.mkdir(mode=0o700, parents=True, exist_ok=True)
    started = time.monotonic()
    wanted, skipped = jobs_of(given.recordings, given.only)
    equal = True
    try:
        commits = [Commit.of(name, given.repository, given.cache.resolve()) for name in (given.base, given.head)]
        for commit in commits:
            commit.installed()
    except RunError as error:
        print(error)
        return 1
    if commits[0].key == commits[1].key:
        print("both commits have the same product: it is run once")
        del commits[1]
    with ThreadPoolExecutor(given.jobs) as pool:
        runs = [(job, [pool.submit(commit.results, job) for commit in commits]) for job in wanted]
        for job, results in runs:
            try:
                folders = [result.result() for result in results]
                equal &= report(job, folders[0], folders[-1])
            except RunError as error:
                equal = False
                print(f"{job.name:<26} failed: {error}")
    for name, reason in skipped.items():
        print(f"{name:<26} skipped: {reason}")
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = f"{(time.monotonic() - started) / 60:.1f} min, {(used.ru_utime + used.ru_stime) / 60:.1f} of processor time"
    print(f"{'equal' if equal else 'NOT equal'}; {spent}")
    return 0 if equal else 1


if __name__ == "__main__":
    sys.exit(main())
