"""C code for several points at once."""

import ctypes
import subprocess

import casadi as ca
import numpy as np
import pytest

from deatwin.plant.integrator import compiled, lanes
from deatwin.plant.integrator.collocation import step_functions

COUNT = 5
CALL = "int f(const double** arg, double** res, long long* iw, double* w, int mem)"


def ordinary(x, y):
    """One of each operation that equations use."""
    positive = ca.sqrt(x**2 + 1)
    return ca.vertcat(
        x + y, x - y, x * y, x / y, -x, x**2, 2 * x, 1 / y, positive, ca.exp(x), ca.log(positive), positive**y,
        positive**2.5, ca.sin(x), ca.cos(x), ca.tan(x), ca.asin(ca.tanh(x)), ca.acos(ca.tanh(x)), ca.atan(x),
        ca.atan2(x, y), ca.sinh(x), ca.cosh(x), ca.tanh(x), ca.asinh(x), ca.acosh(positive), ca.atanh(ca.tanh(x)),
        ca.log1p(positive), ca.expm1(x), ca.hypot(x, y), ca.floor(x), ca.ceil(x), ca.fabs(x), ca.fmin(x, y),
        ca.fmax(x, y), ca.sign(x), ca.if_else(x < y, x, y), ca.if_else(x <= y, 1, 2), ca.if_else(x == y, 1, 2),
        ca.if_else(x != y, 1, 2), ca.logic_and(x, y), ca.logic_or(x, y), ca.logic_not(x), 0.1,
    )  # fmt: skip


def test_every_operation_gives_what_casadi_gives(tmp_path):
    program = compiled.compiler()
    if program is None:
        pytest.skip("there is no C compiler here")
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    function = ca.Function("f", [x, y], [ordinary(x, y)])
    body = lanes.in_lanes(function, COUNT, varying=[0])
    code, library = tmp_path / "f.c", tmp_path / "f.so"
    code.write_text(f"#include <math.h>\n{CALL} {{\n{body}\n}}\n")
    subprocess.run([program, "-O1", "-fPIC", "-shared", str(code), "-o", str(library), "-lm"], check=True)
    points, other = np.array([-1.3, -0.4, 0.0, 0.7, 2.1]), np.array([0.7])
    result = np.zeros((COUNT, function.nnz_out(0)))
    pointer = ctypes.c_void_p
    arguments = (pointer * 2)(points.ctypes.data, other.ctypes.data)
    ctypes.CDLL(str(library)).f(arguments, (pointer * 1)(result.ctypes.data), None, None, 0)
    expected = np.hstack([np.asarray(function(p, 0.7)) for p in points]).T
    np.testing.assert_allclose(result, expected, rtol=4e-16, atol=1e-300)


def test_what_it_cannot_write_it_leaves():
    x = ca.SX.sym("x")
    assert lanes.in_lanes(ca.Function("f", [x], [ca.erf(x)]), COUNT, varying=[0]) is None
    assert lanes.in_lanes(ca.Function("f", [x], [x * np.inf]), COUNT, varying=[0]) is None
    assert lanes.in_lanes(ca.Function("f", [x], [x]), lanes.LANES + 1, varying=[0]) is None


def test_the_plants_code_has_the_function_that_is_exchanged(base):
    # This holds CasADi to the layout of the code that it writes.
    step = step_functions(base.equations)
    generator = ca.CodeGenerator("plant.c")
    generator.add(step.sensitive)
    source = generator.dump()
    assert set(step.in_lanes) == {"stage_values", "stage_slopes"}
    for name, body in step.in_lanes.items():
        exchanged = lanes.replaced(source, name, body)
        assert body in exchanged
        assert source.count("\nstatic int ") == exchanged.count("\nstatic int ")
        assert lanes.replaced(source, "unknown", body) == source
