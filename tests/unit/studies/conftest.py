"""What the tests of studies share."""

import pytest


@pytest.fixture(scope="session")
def files():
    """``files(store)``: the bytes of each case that a store holds, by the name of its file."""
    return lambda store: {path.name: path.read_bytes() for path in store.cases.rglob("*.nc")}
