"""What holds for all tests."""

import pytest

from deatwin.plant.compiled import compiler


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Without a C compiler simulations take ten times as long: tests of many fits are left out, and say so."""
    if compiler() is not None:
        return
    skip = pytest.mark.skip(reason="many fits, and no C compiler was found: it would take ten times as long")
    for item in items:
        if item.get_closest_marker("many_fits"):
            item.add_marker(skip)
