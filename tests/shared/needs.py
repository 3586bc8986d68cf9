"""What some tests need that a machine may not have."""

import pytest

from deatwin.plant.integrator.compiled import compiler

COMPILED = pytest.mark.skipif(
    compiler() is None, reason="much to simulate: without a C compiler it takes ten times as long"
)
