"""Systems of several stages, against the formula written out in full matrices."""

import casadi as ca
import numpy as np
import pytest

from deatwin.plant.integrator.stages import coupled

COUPLINGS = {
    "one stage": [[1.0]],
    "a complex eigenvalue": [[2.0, -3.0], [3.0, 2.0]],
    "a stage that does not feel the other": [[1.5, 0.0], [-0.5, 4.0]],
}


@pytest.mark.parametrize("coupling", COUPLINGS.values(), ids=COUPLINGS)
@pytest.mark.parametrize("n_x", [0, 2, 5])
def test_the_blocks_are_those_of_the_formula(coupling, n_x):
    rng, n, h = np.random.default_rng(n_x), 5, 0.3
    c = np.array(coupling)
    pattern = ca.DM(rng.random((n, n)) < 0.4).sparsity()  # some diagonal entries are there, some are not
    entries, mass = rng.normal(size=(pattern.nnz(), len(c))), rng.normal(size=n_x)
    step, inertia = np.ones(n), np.zeros(n)
    step[:n_x], inertia[:n_x] = h, mass
    expected = np.kron(c, np.diag(inertia))
    for i in range(len(c)):
        block = slice(i * n, (i + 1) * n)
        expected[block, block] -= step[:, None] * ca.DM(pattern, entries[:, i]).full()
    found = coupled(pattern, n_x, c)(entries, mass, h)
    np.testing.assert_allclose(found.full(), expected, rtol=1e-15, atol=1e-15)
    inert = n_x * np.count_nonzero(c)
    assert found.nnz() <= len(c) * pattern.nnz() + inert  # nothing is held that is zero by its structure
