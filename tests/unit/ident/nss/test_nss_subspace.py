"""Subspace identification against systems that are known."""

import numpy as np
import pytest
from scipy.signal import dlsim

from deatwin.ident.nss.subspace import from_lines, from_samples, stabilised

POLES = np.array([0.75 + 0.45j, 0.75 - 0.45j, 0.9])
A = np.array([[1.5, -0.765, 0.0], [1.0, 0.0, 0.0], [0.2, 0.0, 0.9]])
B = np.array([[1.0, 0.2], [0.0, -1.0], [0.3, 0.5]])
C = np.array([[1.0, 0.5, 0.2], [0.0, 1.0, -0.5]])
D = np.array([[0.1, 0.0], [0.3, -0.2]])


def sorted_poles(a):
    return np.sort_complex(np.linalg.eigvals(a))


@pytest.mark.parametrize("inputs", [1, 2])
def test_poles_are_exact_without_noise(inputs):
    rng = np.random.default_rng(inputs)
    b, d = B[:, :inputs], D[:, :inputs]
    angles = np.sort(rng.uniform(0.02, 3.1, 40))  # lines need not lie evenly
    response = np.array([C @ np.linalg.solve(np.exp(1j * w) * np.eye(3) - A, b) + d for w in angles])
    a, c = from_lines(response, angles, rng.uniform(0.5, 2.0, 40), 3, 6)
    np.testing.assert_allclose(sorted_poles(a), np.sort_complex(POLES), atol=1e-8)
    u = rng.normal(size=(400, inputs))
    y = dlsim((A, b, C, d, 1.0), u, x0=rng.normal(size=3))[1]  # from a state that is no rest
    a, c = from_samples([(u[:200].T, y[:200].T), (u[200:].T, y[200:].T)], 3, 6)
    np.testing.assert_allclose(sorted_poles(a), np.sort_complex(POLES), atol=1e-8)
    assert c.shape == (2, 3)


def test_noise_on_the_outputs_is_no_bias():
    # The past is the instrument: with twenty times the samples the error of the poles falls by about their root.
    errors = []
    for n in (1000, 20_000):
        rng = np.random.default_rng(7)
        u = rng.normal(size=(n, 1))
        y = dlsim((A, B[:, :1], C[:1], D[:1, :1], 1.0), u)[1]
        y += 0.3 * y.std() * rng.normal(size=y.shape)
        errors.append(np.abs(sorted_poles(from_samples([(u.T, y.T)], 3, 10)[0]) - np.sort_complex(POLES)).max())
    assert errors[1] < 0.02 and errors[1] < 0.5 * errors[0]


def test_unstable_poles_are_mirrored():
    a = stabilised(np.diag([0.5, 1.25]))
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(a)), [0.5, 0.8])
