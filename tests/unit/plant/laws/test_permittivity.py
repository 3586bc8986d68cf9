"""Laws of the permittivity."""

import numpy as np
import pytest

from deatwin.plant.laws.permittivity import relaxing, stretched


@pytest.mark.parametrize(("stretch", "measured"), [(1.0, 4.68), (3.0, 3.71), (4.0, 3.34), (5.0, 2.62)])
def test_the_quoted_fit_meets_the_quoted_measurements(stretch, measured):
    # Wissler & Mazza's values as later papers quote them; a straight line meets them within 5 %.
    assert stretched(stretch, stretch, 4.68, -0.053) == pytest.approx(measured, rel=0.05)


def test_relaxation_goes_from_one_value_to_the_other():
    assert float(relaxing(-5.0, 4.5, -0.1, 300.0)) == 4.5
    assert float(relaxing(0.0, 4.5, -0.1, 300.0)) == 4.5
    assert float(relaxing(300.0 * np.log(2), 4.5, -0.1, 300.0)) == pytest.approx(4.5 * 0.95, rel=1e-12)
    assert float(relaxing(1e6, 4.5, -0.1, 300.0)) == pytest.approx(4.05, rel=1e-12)
