"""C sources compiled as strictly as a compiler can, and run."""

import ctypes
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from deatwin.plant.export.sampled import SampledSource

Array = NDArray[np.float64]
RunC = Callable[..., tuple[Array, NDArray[np.int32]]]

STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-Wno-unused-function")
HARNESS = """
void run(int n, const double *u, double *y, int *status)
{{
    int i, k;
    {name}_state state;
    {name}_real in[{N}_INPUTS], out[{N}_OUTPUTS];
    {name}_init(&state);{clock}
    for (k = 0; k < n; k++) {{
        for (i = 0; i < {N}_INPUTS; i++) in[i] = ({name}_real)u[k * {N}_INPUTS + i];
        status[k] = {name}_step(&state, in, out);
        for (i = 0; i < {N}_OUTPUTS; i++) y[k * {N}_OUTPUTS + i] = out[i];
    }}
}}
"""


@pytest.fixture
def run_c(c_compiler: str, tmp_path: Path) -> RunC:
    """Compiles a source and runs it from rest, at a clock time if one is given: outputs (n, n_outputs) and what each step returned."""

    def run(
        source: SampledSource, inputs: ArrayLike, *flags: str, start: float | None = None
    ) -> tuple[Array, NDArray[np.int32]]:
        clock = "" if start is None else f" state.start = {start!r};"
        harness = HARNESS.format(name=source.name, N=source.name.upper(), clock=clock)
        (tmp_path / "tried.c").write_text(source.text + harness, encoding="utf-8")
        command = [c_compiler, *(flags or STRICT), "-O1", "-fPIC", "-shared", "tried.c", "-o", "tried.so", "-lm"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        u = np.ascontiguousarray(inputs, dtype=np.float64)
        y, status = np.empty((len(u), len(source.outputs))), np.empty(len(u), dtype=np.int32)
        ctypes.CDLL(str(tmp_path / "tried.so")).run(
            len(u), *(array.ctypes.data_as(ctypes.c_void_p) for array in (u, y, status))
        )
        return y, status

    return run
