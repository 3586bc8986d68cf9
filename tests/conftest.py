"""What holds for all tests: their order, and the examples that property tests draw.

Long ones are handed to workers first, so that no worker is left alone with them.
"""

from __future__ import annotations

import gc
import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from deatwin.studies.stories import Setting

os.environ.setdefault("MPLBACKEND", "Agg")  # no test opens a window

# What a property test draws follows from its code alone: every run sees the same examples.
settings.register_profile("fixed", derandomize=True, database=None)
settings.load_profile("fixed")

TESTS = Path(__file__).parent
LONG = (
    "validation/test_recordings.py",
    "unit/app/test_documented_commands.py",
    "unit/app/test_diagnose.py",
    "unit/app/test_interrupted.py",
    "unit/ident/mismatch",
    "validation",
    "unit/plant/effects",
)
"""Files and folders with whole diagnoses, studies or many plants to compile, the longest first."""


def pytest_configure(config: pytest.Config) -> None:
    if hasattr(config.option, "loadscopereorder"):  # pytest-xdist would begin with the modules of most tests
        config.option.loadscopereorder = False


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Without searches for garbage, which are a quarter of the time of collecting: what is collected lives to the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    long = [TESTS / name for name in LONG]

    @cache
    def place(path: Path) -> int:
        return next((k for k, at in enumerate(long) if at in (path, *path.parents)), len(long))

    items.sort(key=lambda item: place(item.path))
    for item in items:
        if item.path.suffix == ".ipynb":  # which has no place for a mark
            item.add_marker("extras")


@pytest.fixture(autouse=True)
def as_loud_as_ever() -> Iterator[None]:
    """A command that a test or a fixture of a whole session ran with --quiet or --json leaves the logger quiet."""
    logger = logging.getLogger("deatwin")
    logger.setLevel(logging.NOTSET)
    yield
    logger.setLevel(logging.NOTSET)


@pytest.fixture(autouse=True)
def no_figure_outlives_its_test() -> Iterator[None]:
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plants run in CasADi's own machine: small ones are done before they would be compiled."""
    monkeypatch.setenv("DEATWIN_COMPILER", "")


@pytest.fixture
def in_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """No process of its own tries a file first, as in a program of one file: tests/unit/plant/files/test_apart.py."""
    monkeypatch.setattr(sys, "frozen", True, raising=False)


@pytest.fixture
def setting(tmp_path: Path) -> Setting:
    """Give a story a temporary folder, seed 0 and one process."""
    from deatwin.studies.folder import ResultFolder
    from deatwin.studies.stories import Setting

    return Setting(
        folder=ResultFolder(tmp_path), data=None, command=["test"], jobs=1, seed=0, progress=lambda share, text: None
    )


@pytest.fixture
def heard() -> Iterator[None]:
    """Ctrl-C is heard, also in a shell's background, where it is ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def mistaken(heard: None) -> Iterator[Callable[..., Any]]:
    """What CasADi makes of Ctrl-C, as a function: the interrupt is gone, and an error comes in its place."""
    from deatwin.studies.interrupts import forward_signals

    def interrupted(*_: object, **__: object) -> Any:
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise SystemError("DM.__array__ returned a result with an exception set")

    with forward_signals():
        yield interrupted
