"""What identifiers refuse to be fitted with, and to, and with what words."""

import dataclasses

import numpy as np
import pandas
import pytest

from deatwin.ident.frequency import gfrf
from deatwin.ident.narx import (
    Bayesian,
    Frols,
    Grow,
    Narmax,
    NarxModel,
    Ridge,
    Rls,
    Semp,
    SvbNarx,
    ThetaPosterior,
    ThetaSmoother,
    excitation,
    free_run_band,
    hold_out,
    refine,
    robust,
    validate,
)
from deatwin.ident.narx.fixed import Fixed
from deatwin.ident.narx.lasso import Lasso
from deatwin.ident.narx.linear import Arx, OutputError
from deatwin.ident.narx.preprocess import (
    choose_orders,
    choose_sampling,
    choose_sections,
    decimate,
    estimate_dead_time,
    inspect_recordings,
)
from deatwin.ident.nss import Pnlss
from deatwin.ident.testing import example_recordings
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.recording import Recording

RECORD = example_recordings(420)[0]  # of 400 samples
SHORT = RECORD.section(0, 20)
LINE, ONES = np.arange(50.0), np.ones(50)


def _model():
    return Fixed(terms=["y(k-1)", "u(k-1)"]).fit(RECORD).model_


def made(terms, **details) -> NarxModel:
    return NarxModel.from_terms(terms, sample_time=RECORD.sample_time, **details)


def of(inputs: np.ndarray, outputs: np.ndarray) -> Recording:
    return Recording.from_arrays(inputs, outputs, 1.0)


ARGUMENTS = [
    (Frols(criterion="bik"), 'did you mean "bic"'),
    (Frols(held_out=1.0), "held_out"),
    (Frols(criterion="free_run", held_out=0.001), "too short"),
    (Frols(estimator="ridge"), "Ridge"),
    (Frols(estimator=Ridge), r"estimator = Ridge; give an object, as Ridge\(\)"),
    (Fixed(terms=["y(k-1)"], estimator=Ridge), r"estimator = Ridge; give an object, as Ridge\(\)"),
    (Frols(max_terms=2.5), "max_terms = 2.5; it must be an integer of at least 1"),
    (Frols(held_out=None), "held_out must be real numbers"),
    (Lasso(max_terms="3"), "max_terms = '3'; it must be an integer of at least 1"),
    (Semp(threshold=np.nan), "threshold is nan"),
    (Semp(max_exchanges=np.inf), "max_exchanges = inf; it must be an integer of at least 0"),
    (SvbNarx(tolerance=-1.0), "tolerance = -1.0; it must be positive and finite"),
    (SvbNarx(resolution=np.nan), "resolution = nan; it must be positive and finite"),
    (SvbNarx(max_iterations=9.0), "max_iterations = 9.0; it must be an integer"),
    (Narmax(Frols(), noise_degree=1.5), "noise_degree = 1.5; it must be an integer of at least 1"),
    (Narmax(Frols(), tolerance=None), "tolerance must be real numbers"),
    (Rls(terms=["y(k-1)"], forgetting=None), "forgetting must be real numbers"),
    (Frols(degree=0), "degree"),
    (Frols(max_terms=500, output_lags=8, input_lags=8, degree=3), "too few"),
    (Frols(output_lags=600, degree=1), "samples"),
    (Lasso(max_terms=400, output_lags=6, input_lags=6, degree=3), "too few"),
    (SvbNarx(clean_up="evidnce"), 'did you mean "evidence"'),
    (SvbNarx(b0=0.0), "b0"),
    (Semp(level=0.0), "level"),
    (Semp(significance=1.0), "significance"),
    (Grow(parts=1.5), "parts = 1.5; it must be an integer of at least 1"),
    (Grow(rule=lambda term: term.degree == 2), r"begins with a linear model.*allow y\(k-1\) and u\(k-1\)"),
    (Pnlss(degrees=2), r"degrees = 2; give a list, as \(2, 3\)"),
    (Pnlss(terms="x1^2"), "terms = 'x1\\^2'; give a list"),
    *(
        (make(wrong), rf"{name} = .*; give a list of terms, as")
        for wrong in (iter(["y(k-1)"]), 1.0, [1.0], {"y": [None]}, [["y(k-1)"]], RECORD)
        for make, name in (
            (lambda terms: Fixed(terms=terms), "terms"),
            (lambda terms: Rls(terms=terms), "terms"),
            (lambda terms: Frols(functions=terms), "functions"),
            (lambda terms: Narmax(Frols(), noise_terms=terms), "noise_terms"),
        )
    ),
    (Fixed(terms=["y(k-1)^0"]), r"cannot read the term 'y\(k-1\)\^0' from '\^0' on"),
    (Fixed(terms=["|u(k-1)|^0"]), "cannot read the term"),
    (Fixed(terms=["y(k-1)", "y(k-1)"]), "only once"),
    (Fixed(terms=["e(k-1)"]), "Narmax"),
    (Fixed(terms=["u2(k-1)"]), "use 2 inputs"),
    (Fixed(terms=["y(k)"]), "at least 1"),
    (Fixed(terms=["y(k-1)"], estimator=None), "estimator"),
    (Fixed(terms=["u(k-1)", "u(k-1)^2", "y(k-400)"]), "at least 401"),
    (Narmax("frols"), "give an identifier"),
    (Narmax(Frols(max_terms=0)), "max_terms"),
    (Narmax(Frols(), noise_lags=0), "no lag"),
    (Narmax(Frols(), noise_lags=[0]), "at least 1"),
    (Narmax(Frols(), criterion="press"), "known are ebic"),
    (Narmax(Frols(), noise_terms="e(k-1)"), "list of terms"),
    (Narmax(Frols(), noise_terms=["u(k-1)"]), "its own output"),
    (Narmax(Frols(), noise_terms=["e2(k-1)"]), "its own output"),
    (Narmax(Frols(), noise_terms=["e(k-1)", "e(k-1)"]), "only once"),
    (Narmax(Frols(), noise_terms=["u2(k-1)e(k-1)"]), "2 inputs"),
    (Arx(na=-1), "na = -1"),
    (Arx(nb=0), "nb = 0"),
    (OutputError(nb=(1, 2)), r"nb = \(1, 2\)"),
    (OutputError(nf=1.5), "nf = 1.5"),
    (Arx(na=800), "recording 1 has 400 samples"),
    (Arx(na=150, nb=150), "too few for 301 unknowns"),
]
DATA = [
    (Frols(), of(ONES, np.zeros(50)), "constantly zero"),
    (Frols(output_lags=0, rule=lambda t: t.degree > 0), of(np.zeros(50), LINE), "every candidate is zero"),
    (Frols(), of(LINE, ONES), r"constantly 1\.0"),
    (Frols(), of(np.zeros((0, 50)), LINE), "take input_lags=0"),
    (Frols(), [], "at least one"),
    (Frols(), [RECORD, of(ONES, ONES)], "sample time"),
    *((Frols(), wrong, "recordings and experiments are needed.*Recording.from_arrays") for wrong in (None, 3.0, LINE)),
    (Frols(), "recording.csv", "not a str: read a Recording from a file with read_recording"),
    (Frols(), {"u": [1.0], "y": [2.0]}, "not a dict: make a Recording of arrays with Recording.from_arrays"),
    (Frols(), pandas.DataFrame({"u": LINE, "y": LINE}), "not a DataFrame: make a Recording of arrays"),
    (Lasso(), of(ONES, ONES), "constant"),
    (Semp(output_lags=2, input_lags=2, max_terms=10), SHORT.section(0, 12), "too few"),
    (Grow(), SHORT, "too few"),
    (Arx(), of(ONES, np.ones((2, 50))), "2 outputs"),
    (Arx(), of(np.ones((0, 50)), ONES), "no input"),
    (Arx(), of(np.stack([LINE, 2.0 * ONES]), LINE), '"input_2" is constant'),
]


CASES = [(identifier, RECORD, says) for identifier, says in ARGUMENTS] + DATA


@pytest.mark.parametrize(("identifier", "data", "says"), CASES, ids=lambda part: repr(part)[:30])
def test_arguments_that_make_no_sense_and_data_that_nothing_can_be_learned_from(identifier, data, says):
    with pytest.raises(ModelError, match=says):
        identifier.fit(data)


@pytest.mark.parametrize("identifier", [Frols(), ThetaSmoother(terms=["y(k-1)"]), Arx(), Pnlss(states=1)], ids=repr)
def test_outputs_beside_the_recordings(identifier):
    with pytest.raises(ModelError, match=r"no y.*Recording\.from_arrays"):
        identifier.fit(LINE, ONES)


@pytest.mark.parametrize(
    "identifier", [Fixed(terms=["y(k-1)", "u(k-1)"]), Arx(), Pnlss(states=1, degrees=[])], ids=repr
)
def test_a_fitted_model_refuses_what_it_cannot_take(identifier):
    metres = dataclasses.replace(RECORD, output_units=("m",), output_names=("way",))
    model = identifier.fit(metres).model_
    for wrong, says in (
        (LINE, "a ndarray is not a recording"),
        ([metres], "a list is not a recording"),
        (dataclasses.replace(metres, output_units=("mm",)), "way in m and in mm"),
        (dataclasses.replace(metres, input_units=("kV",), input_names=("volts",)), f"volts in {RECORD.input_units[0]}"),
    ):
        with pytest.raises(ModelError, match=says):
            model.free_run_band(wrong) if isinstance(identifier, Pnlss) else model.predict(wrong)
    unstated = Recording.from_arrays(RECORD.inputs, RECORD.outputs, RECORD.sample_time)
    assert model.simulate(unstated).status.ok


def test_an_estimator_says_where_to_find_what_its_model_has():
    with pytest.raises(AttributeError, match="no attribute 'predict'; fit makes its model_"):
        Frols().predict  # noqa: B018
    fitted = Frols().fit(RECORD)
    with pytest.raises(AttributeError, match=r"its fitted model has: model_\.predict"):
        fitted.predict  # noqa: B018
    with pytest.raises(AttributeError, match=r"no attribute 'coef_'$"):
        fitted.coef_  # noqa: B018
    for use, given in ((gfrf, (1, [1.0])), (validate, (RECORD,)), (refine, (RECORD,)), (robust, (RECORD,))):
        with pytest.raises(ModelError, match="a Frols is not a NarxModel; its model_"):
            use(fitted, *given)


@pytest.mark.parametrize(
    ("use", "says"),
    [
        (lambda: validate(Fixed(terms=["y(k-1)"]).fit(RECORD).model_, []), "no recording was given"),
        (lambda: choose_orders(Frols(), RECORD, RECORD, output_lags=2), r"output_lags = 2; give all that are tried"),
        (lambda: choose_orders(Frols(), RECORD, RECORD, output_lags=[2], degrees=1), r"degrees = 1; give all"),
        (lambda: excitation([RECORD]), "one recording is needed, not a list"),
        (lambda: Ridge(penalty=None), "penalty must be real numbers"),
        (lambda: Ridge(penalty=0.0), "positive"),
        (lambda: Ridge(penalty="gvc"), 'did you mean "gcv"'),
        (lambda: Bayesian(precision=np.inf), "precision = inf; it must be positive and finite"),
        (lambda: Bayesian(priors=1.0), r"priors = 1.0; give Priors\(\)"),
        (lambda: hold_out(RECORD, None), "share must be real numbers"),
        (lambda: decimate(RECORD, 0), "factor = 0"),
        (lambda: decimate(SHORT, 5), "too few to decimate by 5"),
        (lambda: choose_sampling(of(ONES, ONES)), "constant"),
        (lambda: choose_sampling(SHORT, n_lags=20), "n_lags = 20"),
        (lambda: choose_sampling(of(ONES, np.ones((2, 50)))), "one output"),
        (lambda: choose_sections(RECORD, n_segments=5), "at least 10 segments"),
        (lambda: choose_sections(RECORD.section(0, 100)), "at least 8 samples"),
        (lambda: choose_sections(RECORD, level=1.0), "level"),
        (lambda: choose_sections(of(np.ones(400), np.ones(400))), "constant"),
        (lambda: inspect_recordings(RECORD.section(0, 150)), "too few to look at"),
        (lambda: inspect_recordings(RECORD, level=0.0), "level"),
        (lambda: choose_orders(Frols(), RECORD, RECORD, output_lags=()), "grid is empty"),
        (lambda: choose_orders(Frols(), RECORD, SHORT, output_lags=(2, 12)), "shorter than the 32 samples"),
        (lambda: estimate_dead_time(RECORD, max_dead_time=0), "max_dead_time = 0"),
        (lambda: estimate_dead_time(RECORD, output=1), "to one of the outputs"),
        (lambda: estimate_dead_time([RECORD, of(LINE, LINE)]), "same inputs"),
        (lambda: estimate_dead_time(of(LINE, ONES)), "constant"),
        (lambda: validate(_model(), SHORT), r"19 samples after the model's lags are too few .* over 25 lags need 100"),
        (lambda: validate(_model(), RECORD).test("e(ue)"), r'did you mean "e\(eu\)"'),
        (lambda: validate(_model(), of(np.ones(300), np.ones(300))), "sample time"),
        (lambda: refine(made({"y(k-1)": 0.5, "e(k-1)": 0.2}), RECORD), "without noise terms"),
        (lambda: refine(made({"y(k-1)": 3.0, "u(k-1)": 1.0}), RECORD), "diverges at"),
        (lambda: made({"y(k-1)u(k)": 1.0, "u(k)y(k-1)": 1.0}), "only once"),
        (lambda: made({"y(k-1)": 1.0}, theta_cov=np.eye(2)), "theta_cov"),
        (lambda: made({"y(k-1)": np.nan}), "finite"),
        (lambda: made(["y(k-1)"]), "terms are given as a list; give a mapping"),
        (lambda: validate(_model(), RECORD, max_lag=2.5), "max_lag = 2.5; it must be an integer of at least 1"),
        (lambda: validate(_model(), RECORD, level="a"), "level must be real numbers; got text"),
        (lambda: refine(_model(), RECORD, max_steps=2.5), "max_steps = 2.5; it must be an integer of at least 1"),
        (lambda: refine(_model(), RECORD, tolerance=0.0), "tolerance = 0.0; it must be positive"),
        *(
            (lambda wrong=wrong: free_run_band(_model(), RECORD, np.random.default_rng(0), **wrong), says)
            for wrong, says in (
                ({"n_draws": 1e3}, "n_draws = 1000.0; it must be"),
                ({"n_draws": 1}, "n_draws = 1; it must be"),
                ({"level": 1.2}, "level = 1.2"),
                ({"output_noise": "a"}, "output_noise must be real"),
                ({"output_noise": -1}, "output_noise = -1; it must be a standard deviation of at least 0"),
            )
        ),
        (lambda: ThetaPosterior(model=_model()).interval(95), "level = 95"),
        (lambda: ThetaPosterior(model=SvbNarx()), "a SvbNarx is not a NarxModel"),
    ],
)
def test_functions_say_what_they_take(use, says):
    with pytest.raises((ModelError, DataError), match=says):
        use()
