"""The order in which tests are handed to workers: long ones first, so that no worker is left alone with them."""

from __future__ import annotations

from pathlib import Path

import pytest

LONG = Path(__file__).parent / "validation"
"""Few tests a module, but whole diagnoses and studies."""


def pytest_configure(config: pytest.Config) -> None:
    if hasattr(config.option, "loadscopereorder"):   # pytest-xdist would begin with the modules of most tests
        config.option.loadscopereorder = False


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: LONG not in item.path.parents)
