"""Fuzz the readers of files with atheris: random bytes choose a sound file and how it is spoilt, or are the file.

``python tests/fuzz/fuzz.py recordings --seconds 300``; a file that breaks a reader is left as ``find.*``.
"""

import argparse
import atexit
import importlib.util
import sys
import tempfile
from pathlib import Path

READERS = (
    "deatwin.control.checking.result",
    "deatwin.control.loop.closed_loop",
    "deatwin.ident.mismatch.diagnosis",
    "deatwin.ident.narx.covariance",
    "deatwin.ident.narx.document",
    "deatwin.ident.narx.linear",
    "deatwin.ident.narx.model",
    "deatwin.ident.narx.terms",
    "deatwin.ident.narx.trajectory",
    "deatwin.ident.narx.validate",
    "deatwin.ident.narx.variables",
    "deatwin.ident.nss",
    "deatwin.plant.calibrated",
    "deatwin.plant.documents",
    "deatwin.plant.files",
    "deatwin.plant.parameters",
    "deatwin.plant.recording",
    "deatwin.plant.records",
    "deatwin.plant.rigs",
    "deatwin.plant.safe_read",
    "deatwin.plant.documents",
)
"""How the names of modules begin that read files; instrumenting the other 600 takes longer than the fuzzing."""


def not_readers() -> list[str]:
    """Names of the package's other modules: of what to instrument, atheris regards the name before the first dot only."""
    spec = importlib.util.find_spec("deatwin")
    assert spec is not None
    found = {
        ".".join(["deatwin", *file.relative_to(root).with_suffix("").parts]).removesuffix(".__init__")
        for root in spec.submodule_search_locations or ()
        for file in Path(root).rglob("*.py")
    }
    return sorted(name for name in found if not name.startswith(READERS))


def main() -> None:
    """Fuzz the readers of some kinds of files for a while."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", choices=("recordings", "rigs", "documents"))
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--runs", type=int, default=-1, help="at most so many; nearly the same with PYTHONHASHSEED")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", help="only this one")
    parser.add_argument("--finds", default=".", help="folder for files that break a reader")
    given = parser.parse_args()

    import atheris

    with atheris.instrument_imports(include=["deatwin", "tomllib", "json"], exclude=not_readers()):
        import mutations
        import readers

    chosen = getattr(readers, given.kinds.upper())
    chosen = {given.kind: chosen[given.kind]} if given.kind else chosen
    names = list(chosen)

    def one(data: bytes) -> None:
        provider = atheris.FuzzedDataProvider(data)
        kind = chosen[names[provider.ConsumeIntInRange(0, len(names) - 1)]]
        seeds = kind.seeds()
        way = provider.ConsumeIntInRange(0, 9)
        if way == 0:
            content = provider.ConsumeBytes(provider.remaining_bytes())
        else:
            seed = seeds[provider.ConsumeIntInRange(0, len(seeds) - 1)]
            content = mutations.mutated(seed, provider.ConsumeIntInRange)
        try:
            readers.probe(kind, content)
        except BaseException:
            (Path(given.finds) / f"find{kind.ending}").write_bytes(content)
            raise

    with tempfile.TemporaryDirectory() as corpus:  # so that the first inputs are not empty
        for number in range(64):
            (Path(corpus) / str(number)).write_bytes(bytes((number * k * 37 + k) % 256 for k in range(200)))
        atexit.register(sys.stdout.flush)
        atheris.Setup(
            [
                sys.argv[0],
                f"-max_total_time={given.seconds}",
                f"-runs={given.runs}",
                f"-seed={given.seed}",
                "-max_len=4096",
                "-timeout=60",
                "-rss_limit_mb=3000",
                f"-artifact_prefix={given.finds}/",
                "-print_final_stats=1",
                corpus,
            ],
            one,
        )
        atheris.Fuzz()


if __name__ == "__main__":
    main()
