"""Frols against SysIdentPy's FROLS on the same regressors: terms, order, error reduction ratios and parameters.

SysIdentPy's results are stored beside this file, so that the comparison runs without it; where it is installed it is
also asked anew. ``python tests/validation/test_sysidentpy.py`` writes the stored results. They hold no recording:
those of the systems are drawn again from their seeds, and those of the buck converter are read where they are.

The recordings of the systems begin at sample 4. From rest, where outputs are exactly zero, the two may part: see
`test_where_they_part_the_exact_ratios_decide`.
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
extended = pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no extended precision on this computer")
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


def recording(name, seed, first=AFTER_REST):
    if name == "buck":
        columns = np.loadtxt(DATA / "buck_id.csv", delimiter=",", skiprows=1)
        return Recording.from_arrays(columns[:, 1], columns[:, 2], 1e-5)
    drawn = SYSTEMS[name].draw(np.random.default_rng(seed)).recording
    return drawn.section(first, drawn.n_samples)


def ours(record, output_lags, input_lags, degree, terms=TERMS):
    """What `Frols` does, on the signals as they are: it would count signals far from zero from their means."""
    data = Regression.of(record, output_lags=output_lags, input_lags=input_lags, degree=degree)
    rows, target = data.matrix()
    steps = list(forward_selection(rows.copy(), target, terms))
    chosen = [step.candidate for step in steps]
    theta = least_squares(rows[chosen], target).theta * data.term_scales[chosen]
    names = [str(data.table.terms[i]) for i in chosen]
    return {"terms": names, "err": [step.err for step in steps], "theta": theta.tolist()}


def theirs(record, output_lags, input_lags, degree, terms=TERMS):
    """SysIdentPy's answer, its terms written as ours."""
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    peer = FROLS(
        ylag=output_lags,
        xlag=input_lags,
        n_terms=terms,
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
    return {"terms": names, "err": peer.err[:terms].tolist(), "theta": peer.theta.ravel().tolist()}


def exact_ratios(record, output_lags, input_lags, degree, chosen):
    """Error reduction ratios of all candidates after some chosen terms, by projection in extended precision."""
    data = Regression.of(record, output_lags=output_lags, input_lags=input_lags, degree=degree)
    names = [str(term) for term in data.table.terms]
    rows, target = (values.astype(np.longdouble) for values in data.matrix())
    left = rows.copy()
    for name in chosen:
        for _ in range(2):
            direction = left[names.index(name)]
            direction = direction / np.sqrt(direction @ direction)
            left -= np.outer(left @ direction, direction)
            left[names.index(name)] = direction  # its own part would vanish
        left[names.index(name)] = 0
    norms = np.einsum("ij,ij->i", left, left)
    usable = norms > 1e-25 * np.einsum("ij,ij->i", rows, rows)
    ratios = np.where(usable, (left @ target) ** 2 / np.where(usable, norms, 1), 0) / (target @ target)
    return dict(zip(names, ratios.astype(float), strict=True))


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


@extended
def test_where_they_part_the_exact_ratios_decide():
    """Recordings from rest, y = 0 at first: SysIdentPy's Householder vector takes the sign of the first element of the
    chosen regressor, which is 0 there, so that its reflection leaves the regressor in the others.

    Every draw of the stored list is gone through: ours explains more, at the first step at which they part, and the
    ratio that SysIdentPy tells is not that of its own term.
    """
    parted = stored()["disagreements"]
    assert len(parted) >= 5
    for entry in parted:
        lags = [entry[key] for key in ("output_lags", "input_lags", "degree")]
        record = recording(entry["name"], entry["seed"], first=0)
        step = entry["step"]
        found = ours(record, *lags, terms=step)
        assert found["terms"][:-1] == entry["before"] and found["terms"][-1] == entry["ours"] != entry["theirs"]
        exact = exact_ratios(record, *lags, entry["before"])
        assert exact[entry["ours"]] == max(exact.values()) > exact[entry["theirs"]]
        assert found["err"][-1] == pytest.approx(exact[entry["ours"]], rel=1e-10)
        assert abs(entry["their_err"] - exact[entry["theirs"]]) > 1e-3
        for key, who in (("our_exact_err", "ours"), ("their_exact_err", "theirs")):
            assert entry[key] == pytest.approx(exact[entry[who]], rel=1e-10)
        zero = Regression.of(record, output_lags=lags[0], input_lags=lags[1], degree=lags[2])
        first = [str(term) for term in zero.table.terms].index(entry["before"][0])
        assert zero.matrix()[0][first, 0] == 0.0


@extended
@pytest.mark.parametrize("offset", [0.0, 5.0, 50.0])
def test_no_digits_are_lost_to_it(offset):
    """Signals on an offset make powers nearly collinear: condition numbers of 5, 1e3 and 1e5 of the chosen terms."""
    pytest.importorskip("sysidentpy", reason="SysIdentPy is not installed (extra compare)")
    drawn = recording("S4", 1)
    record = Recording.from_arrays(drawn.inputs + offset, drawn.outputs + offset, 1.0)
    errors = {}
    for who, answer in (("ours", ours(record, 4, 4, 3)), ("theirs", theirs(record, 4, 4, 3))):
        exact = [exact_ratios(record, 4, 4, 3, answer["terms"][:k])[term] for k, term in enumerate(answer["terms"])]
        errors[who] = np.abs(np.array(answer["err"]) / exact - 1).max()
    assert errors["ours"] < max(errors["theirs"], 1e-14)


def write():
    """Ask SysIdentPy and store its answers, with 17 significant digits."""
    from importlib.metadata import version

    agreements, disagreements = [], []
    for case in CASES:
        entry = dict(zip(CASE, case.values, strict=True))
        lags = entry["output_lags"], entry["input_lags"], entry["degree"]
        agreements.append(entry | theirs(recording(entry["name"], entry["seed"]), *lags))
        if entry["name"] == "buck":
            continue
        record = recording(entry["name"], entry["seed"], first=0)
        mine, peer = ours(record, *lags), theirs(record, *lags)
        step = next((k for k in range(TERMS) if mine["terms"][k] != peer["terms"][k]), None)
        if step is not None:
            exact = exact_ratios(record, *lags, mine["terms"][:step])
            disagreements.append(
                entry
                | {
                    "step": step + 1,
                    "before": mine["terms"][:step],
                    "ours": mine["terms"][step],
                    "our_exact_err": exact[mine["terms"][step]],
                    "theirs": peer["terms"][step],
                    "their_err": peer["err"][step],
                    "their_exact_err": exact[peer["terms"][step]],
                }
            )
    head = {
        "what": "results of SysIdentPy's FROLS; error reduction ratios and parameters with 17 significant digits",
        "made_by": "python tests/validation/test_sysidentpy.py",
        "versions": {name: version(name) for name in ("sysidentpy", "numpy")},
        "systems": f"deatwin.ident.narx.systems, numpy.random.default_rng(seed), from sample {AFTER_REST} on",
        "disagreements": "the same from sample 0 on, from rest; the exact ratios are of extended precision",
    }
    lines = ",\n".join("    " + json.dumps(entry) for entry in agreements)
    parted = ",\n".join("    " + json.dumps(entry) for entry in disagreements)
    STORED.write_text(
        f'{{\n  "head": {json.dumps(head, indent=4)},\n  "agreements": [\n{lines}\n  ],\n'
        f'  "disagreements": [\n{parted}\n  ]\n}}\n',
        encoding="utf-8",
    )


if __name__ == "__main__":
    write()
