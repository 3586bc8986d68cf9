"""Structure selection on published benchmark systems, as `deatwin.ident.narx.systems` tables them; seeds are fixed.

How often SVB and SEMP find S2 to S4, and how well intervals cover, is in test_hit_rates.py. Here: E1 of W. R. Jacobs'
thesis, section 6.5.1, by the plain variational algorithm, and FROLS, of which the literature says what comes first.
"""

import numpy as np
import pytest

from deatwin.ident.narx import Frols, SvbNarx
from deatwin.ident.narx.systems import SYSTEMS
from deatwin.plant.recording import Recording

RUNS = 30


def drawn(name: str, count: int) -> list[Recording]:
    """Recordings of a system."""
    return [SYSTEMS[name].draw(np.random.default_rng(seed)).recording for seed in range(count)]


def test_svb_on_the_thesis_example():
    """Every true term is kept in every run, and half are exact: one false term can raise the lower bound."""
    truth = set(SYSTEMS["E1"].terms)
    runs = [SvbNarx(output_lags=4, input_lags=4, degree=4, clean_up="none").fit(one) for one in drawn("E1", 4)]
    assert len(runs[0].path_[0].terms) == 495
    assert all(truth <= set(run.terms_) for run in runs)
    assert sum(truth == set(run.terms_) for run in runs) >= 2
    # b0 = 1e-4 adds 4e-7 in scaled units, less than a per cent; 1000 samples scatter by sqrt(2 / 1000).
    variance = np.median([run.model_.noise_variance for run in runs])
    assert variance == pytest.approx(SYSTEMS["E1"].noise_std ** 2, rel=0.1)


@pytest.mark.parametrize("name", ["S2", "S6"])
def test_frols_finds_the_true_terms_first_where_the_literature_says_so(name):
    """Published: FROLS is right on S2 and S6, the number of terms being known. Demanded: 90 % of runs on S2.

    S6 is at the limit of what 500 samples tell (published rates of randomised methods are 66 to 100 %); its
    two linear terms must come first in every run.
    """
    truth = set(SYSTEMS[name].terms)
    frols = Frols(output_lags=4, input_lags=4, degree=3, max_terms=len(truth), criterion="none")
    paths = [frols.fit(one).path_ for one in drawn(name, RUNS)]
    if name == "S2":
        assert sum(set(path) == truth for path in paths) >= 0.9 * RUNS
    else:
        assert all({str(term) for term in path[:2]} == {"y(k-2)", "u(k-1)"} for path in paths)
