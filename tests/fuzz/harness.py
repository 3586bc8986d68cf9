"""Runs atheris on readers: random bytes choose a sound file and how it is spoilt, or are the file."""

import argparse
import atexit
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

__all__ = ["run"]

INSTRUMENTED = [
    "deatwin.plant.files",
    "deatwin.plant.documents",
    "deatwin.studies.public",
    "deatwin.studies.sweep",
    "tomllib",
    "json",
]


def run(kinds: str) -> None:
    """Fuzz the readers of some kinds for a while.

    Parameters
    ----------
    kinds : str
        Name of a mapping of `readers` or `studies`.
    """
    parser = argparse.ArgumentParser(description=f"Fuzz the readers of {kinds.lower()} with atheris.")
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--runs", type=int, default=-1, help="at most so many; nearly the same with PYTHONHASHSEED")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", help="only this one")
    parser.add_argument("--finds", default=".", help="folder for files that break a reader")
    given = parser.parse_args()

    import atheris

    with atheris.instrument_imports(include=INSTRUMENTED):
        import mutations
        import readers
        import studies

    chosen: Mapping[str, readers.Kind] = getattr(readers, kinds, None) or getattr(studies, kinds)
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
