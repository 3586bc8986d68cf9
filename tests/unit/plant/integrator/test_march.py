"""Calls of CasADi functions through arrays."""

import casadi as ca
import numpy as np

from deatwin.plant.integrator.march import March, repeated


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


def test_steps_are_tried_until_one_is_not_solved():
    x, z, more = ca.MX.sym("x", 2), ca.MX.sym("z"), ca.MX.sym("more")
    error = ca.if_else(x[0] < 3.5, 0.0, 1.0)
    march = March(repeated(ca.Function("step", [x, z, more], [x + more, z + 1, x[0], error]), "steps", 2))
    march.arguments[0][:], march.arguments[2][:] = 0.0, 1.0
    states, _, readings, errors = march.advance()
    np.testing.assert_array_equal(states[:4, 0], [1, 2, 3, 4])
    np.testing.assert_array_equal(readings[:5].ravel(), [0, 1, 2, 3, 4])
    np.testing.assert_array_equal(errors[:5].ravel(), [0, 0, 0, 0, 1])
    # Not tried: of those that come after it nothing is known, of their readings neither.
    assert np.isnan(readings[5:]).all() and np.isnan(errors[5:]).all()
