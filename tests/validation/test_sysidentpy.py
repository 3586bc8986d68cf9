"""Frols against SysIdentPy's FROLS on the same regressors: terms, order, error reduction ratios and parameters.

SysIdentPy's results are stored beside this file, so that the comparison runs without it; where it is installed it is
also asked anew. ``python tests/validation/test_sysidentpy.py`` writes the stored results. They hold no recording:
those of the systems are drawn again from their seeds, and those of the buck converter are read where they are.

The recordings of the systems begin at sample 4: from rest, where the first output is exactly zero, SysIdentPy's
Householder vector takes the sign of 0, so that its reflection leaves the chosen regressor in the others.
"""

import json
import os
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from deatwin.ident.narx import Term
from deatwin.ident.narx.estimate import least_squares
from deatwin.ident.narx.forward import forward_selection
from deatwin.ident.narx.regression import Regression
from deatwin.ident.narx.systems import SYSTEMS
from deatwin.plant.recording import Recording

STORED = Path(__file__).with_name("sysidentpy_frols.json")
DATA = Path(os.environ.get("DEATWIN_DATA") or Path(__file__).parents[2].parent / "shared" / "data") / "buck_converter"
TERMS = 12
SEEDS = range(5)
AFTER_REST = 4

here = pytest.mark.skipif(
    not DATA.is_dir(), reason="the recordings buck_converter are absent: DEATWIN_DATA names the folder that holds them"
)
CASES = [
    *(
        pytest.param(name, 4, 4, 3, seed, id=f"{name}-{seed}")
        for name in ("S1", "S2", "S3", "S4", "S5", "S6")
        for seed in SEEDS
    ),
    pytest.param("buck", 2, 2, 2, None, id="buck-2-2", marks=here),
    pytest.param("buck", 4, 4, 3, None, id="buck-4-3", marks=here),
]
CASE = ("name", "output_lags", "input_lags", "degree", "seed")


def recording(name, seed):
    if name == "buck":
        columns = np.loadtxt(DATA / "buck_id.csv", delimiter=",", skiprows=1)
        return Recording.from_arrays(columns[:, 1], columns[:, 2], 1e-5)
    drawn = SYSTEMS[name].draw(np.random.default_rng(seed)).recording
    return drawn.section(AFTER_REST, drawn.n_samples)


def ours(record, output_lags, input_lags, degree):
    """What `Frols` does, on the signals as they are: it would count signals far from zero from their means."""
    data = Regression.of(record, output_lags=output_lags, input_lags=input_lags, degree=degree)
    rows, target = data.matrix()
    steps = list(forward_selection(rows.copy(), target, TERMS))
    chosen = [step.candidate for step in steps]
    theta = least_squares(rows[chosen], target).theta * data.term_scales[chosen]
    names = [str(data.table.terms[i]) for i in chosen]
    return {"terms": names, "err": [step.err for step in steps], "theta": theta.tolist()}


def theirs(record, output_lags, input_lags, degree):
    """SysIdentPy's answer, its terms written as ours."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    peer = FROLS(
        ylag=output_lags,
        xlag=input_lags,
        n_terms=TERMS,
        order_selection=False,
        basis_function=Polynomial(degree=degree),
        estimator=LeastSquares(),
    )
    peer.fit(X=record.inputs[0][:, None].copy(), y=record.outputs[0][:, None].copy())
    written = [
        "".join(f"{'y' if code // 1000 == 1 else 'u'}(k-{code % 1000})" for code in row if code) or "1"
        for row in peer.final_model
    ]
    names = [str(Term.parse(text)) for text in written]
    return {"terms": names, "err": peer.err[:TERMS].tolist(), "theta": peer.theta.ravel().tolist()}


def stored():
    return json.loads(STORED.read_text(encoding="utf-8"))


def same(ours, theirs):
    assert ours["terms"] == theirs["terms"]
    # SysIdentPy adds the rounding unit, 2.2e-16, to each ratio.
    np.testing.assert_allclose(ours["err"], theirs["err"], rtol=1e-8, atol=3e-16)
    np.testing.assert_allclose(ours["theta"], theirs["theta"], rtol=1e-8)


@pytest.mark.parametrize(CASE, CASES)
def test_same_terms_in_the_same_order_as_stored_and_as_it_answers_now(name, output_lags, input_lags, degree, seed):
    case, record = [name, output_lags, input_lags, degree, seed], recording(name, seed)
    (expected,) = (entry for entry in stored()["agreements"] if [entry[key] for key in CASE] == case)
    found = ours(record, output_lags, input_lags, degree)
    same(found, expected)
    if find_spec("sysidentpy"):  # the extra compare
        same(found, theirs(record, output_lags, input_lags, degree))


def write():
    """Ask SysIdentPy and store its answers, with 17 significant digits."""
    from importlib.metadata import version

    agreements = []
    for case in CASES:
        entry = dict(zip(CASE, case.values, strict=True))
        lags = entry["output_lags"], entry["input_lags"], entry["degree"]
        agreements.append(entry | theirs(recording(entry["name"], entry["seed"]), *lags))
    head = {
        "what": "results of SysIdentPy's FROLS; error reduction ratios and parameters with 17 significant digits",
        "made_by": "python tests/validation/test_sysidentpy.py",
        "versions": {name: version(name) for name in ("sysidentpy", "numpy")},
        "systems": f"deatwin.ident.narx.systems, numpy.random.default_rng(seed), from sample {AFTER_REST} on",
    }
    lines = ",\n".join("    " + json.dumps(entry) for entry in agreements)
    STORED.write_text(
        f'{{\n  "head": {json.dumps(head, indent=4)},\n  "agreements": [\n{lines}\n  ]\n}}\n', encoding="utf-8"
    )


if __name__ == "__main__":
    write()
