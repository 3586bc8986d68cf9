"""Speed of `SvbNarx` on E1 of the thesis, in processor time: ``python tests/benchmarks/bench_svb.py``.

1000 samples, lags 4, degree 4, 495 candidates; the time includes the regressors and the whole pruning. Each is the best
of a few runs. No test depends on these figures.
"""

from __future__ import annotations

import numpy as np
from stopwatch import timed

from deatwin.ident.narx import SvbNarx
from deatwin.ident.narx.systems import SYSTEMS

DRAWS = 3

if __name__ == "__main__":
    system = SYSTEMS["E1"]
    svb = SvbNarx(output_lags=system.output_lags, input_lags=system.input_lags, degree=system.degree)
    for seed in range(DRAWS):
        recording = system.draw(np.random.default_rng(seed)).recording
        seconds = timed(lambda recording=recording: svb.fit(recording), 3)
        print(f"draw {seed}: {seconds:.3f} s for {len(svb.path_)} steps")
