"""Controllers of every kind, by their names."""

from types import SimpleNamespace

import pytest
from made_controllers import made_controllers


class Made(SimpleNamespace):
    """What the tests ask for by name."""

    def __getitem__(self, name: str):
        return getattr(self, name)


@pytest.fixture(scope="session")
def made() -> Made:
    return Made(**made_controllers())
