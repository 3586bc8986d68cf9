"""Units in which a model's parameters are readable."""

import numpy as np

from deatwin.ident.narx import NarxModel
from deatwin.ident.narx.operating import OperatingRange


def test_parameters_are_shown_in_the_prefixes_of_the_training_data() -> None:
    # y in m from u in V: 2.5 mm at (1 kV)^2 is 2.5e-9 m/V^2.
    operating = OperatingRange(
        input_min=[0.0],
        input_max=[3000.0],
        input_centre=[1500.0],
        output_min=[0.0],
        output_max=[0.02],
        output_centre=[0.01],
    )
    model = NarxModel.from_terms(
        {"y(k-1)": 0.5, "u(k-2)^2": 2.5e-9, "1": 1e-3},
        sample_time=0.1,
        operating=operating,
        input_units=("V",),
        output_units=("m",),
    )
    assert str(model) == "y(k) = 0.5 y(k-1) + 2.5 u(k-2)^2 + 1 1 + e(k)\n(y in mm, u in kV)"


def test_si_is_kept_where_it_is_readable_or_nothing_is_known_of_the_data() -> None:
    terms = {"y(k-1)": 0.5, "u(k-1)": 1e-9}
    model = NarxModel.from_terms(terms, sample_time=0.1, input_units=("V",), output_units=("m",))
    assert str(model) == "y(k) = 0.5 y(k-1) + 1e-09 u(k-1) + e(k)"
    assert np.array_equal(model.theta, [0.5, 1e-9])
