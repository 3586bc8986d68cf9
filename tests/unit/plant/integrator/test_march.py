"""Calls of CasADi functions through arrays."""

import casadi as ca
import numpy as np

from deatwin.plant.integrator.march import March


def test_arguments_are_read_and_results_written_in_place():
    a, b, nothing = ca.MX.sym("a", 2, 3), ca.MX.sym("b", 2), ca.MX.sym("nothing", 0)
    march = March(ca.Function("f", [a, b, nothing], [a.T @ b, ca.densify(2 * b)]))
    matrix, vector, empty = march.arguments
    assert (matrix.shape, vector.shape, empty.size) == ((3, 2), (1, 2), 0)
    matrix[:], vector[:] = [[1, 2], [3, 4], [5, 6]], [10, 1]  # columns of a
    product, double = march.advance()
    np.testing.assert_array_equal(product, [[12, 34, 56]])
    np.testing.assert_array_equal(double, [[20, 2]])
    vector[:] = [0, 1]
    march.advance()
    np.testing.assert_array_equal(product, [[2, 4, 6]])
