"""What the tests of studies share."""

from collections.abc import Callable

import pytest

from deatwin.studies.sweep.store import CaseStore


@pytest.fixture(scope="session")
def files() -> Callable[[CaseStore], dict[str, bytes]]:
    """``files(store)``: the bytes of each case that a store holds, by the name of its file."""
    return lambda store: {path.name: path.read_bytes() for path in store.cases.rglob("*.nc")}
