"""Numbers that a user gives are real numbers, or the error says what they are."""

import numpy as np
import pytest

from deatwin.ident.arguments import real_numbers
from deatwin.plant.errors import ModelError


def test_masked_values_are_no_numbers():
    """Under its mask, an array keeps the values that somebody rejected."""
    with pytest.raises(ModelError, match="omega has masked values"):
        real_numbers(np.ma.masked_greater([1.0, 2.0], 1.5), "omega")
    assert real_numbers(np.ma.array([1.0, 2.0]), "omega").tolist() == [1.0, 2.0]
