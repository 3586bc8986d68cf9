"""Recordings that one model is identified from measure the same signals."""

from dataclasses import replace

import numpy as np
import pytest

from deatwin.ident.narx import Fixed, Frols, NarxModel, assess_reliance, robust
from deatwin.ident.narx.linear import Arx
from deatwin.ident.narx.preprocess import estimate_dead_time
from deatwin.ident.nss import Pnlss
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording


def record(unit: str, sample_time: float = 0.1) -> Recording:
    rng = np.random.default_rng(0)
    command = rng.standard_normal(400)
    made = Recording.from_arrays(command, np.convolve(command, [0.0, 0.5, 0.2])[:400], sample_time)
    return replace(made, output_units=(unit,), provenance={"file": f"in_{unit}_{sample_time:g}.csv"})


@pytest.mark.parametrize("find", [Frols().fit, estimate_dead_time], ids=["fit", "dead time"])
@pytest.mark.parametrize(
    ("other", "said"),
    [
        (record("rad/s"), r"in_m_0\.1\.csv and in_rad/s_0\.1\.csv: .* in m and in rad/s"),
        (record("m", 0.2), r"in_m_0\.1\.csv and in_m_0\.2\.csv: sample times of 0\.1 s and 0\.2 s"),
    ],
)
def test_recordings_that_differ_are_refused_by_name(find, other, said) -> None:
    with pytest.raises(ModelError, match=said):
        find([record("m"), other])


def test_a_unit_that_nobody_stated_contradicts_none() -> None:
    assert Frols().fit([record("m"), record("1")]).model_.terms


SIGNALS = np.random.default_rng(0).standard_normal((4, 300))


def turned(inputs: tuple[str, str], outputs: tuple[str, str]) -> Recording:
    return Recording.from_arrays(SIGNALS[:2], SIGNALS[2:], 0.1, input_names=inputs, output_names=outputs)


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (turned(("heat", "volts"), ("left", "right")), "inputs are heat, volts, .*volts, heat"),
        (turned(("volts", "heat"), ("right", "left")), "outputs are right, left, .*left, right"),
        (turned(("new", "volts"), ("left", "right")), "inputs are new, volts, .*volts, heat"),
    ],
)
def test_signals_in_another_order_are_refused(other, said) -> None:
    first = turned(("volts", "heat"), ("left", "right"))
    model = Frols(degree=1).fit(first).model_
    for use in (Frols().fit, Pnlss(degrees=[]).fit):
        with pytest.raises(ModelError, match=said):
            use([first, other])
    for use in (model.predict, model.simulate):
        with pytest.raises(ModelError, match=said):
            use(other)


@pytest.mark.parametrize(
    ("use", "says"),
    [
        (lambda first, other: Fixed(terms=fitted(first)).fit(other), "; give them in the model's order"),
        (lambda first, other: robust(fitted(first), other), "; give them in the model's order"),
        (lambda first, other: assess_reliance(fitted(first), [other]), "; give them in the model's order"),
        (lambda first, other: Arx().fit([first, other]), ""),
    ],
    ids=["fixed", "robust", "reliance", "arx"],
)
def test_what_fits_the_terms_of_a_model_or_a_linear_one_takes_inputs_in_one_order(use, says) -> None:
    first, other = (
        Recording.from_arrays(SIGNALS[:2], SIGNALS[2], 0.1, input_names=names) for names in (("a", "b"), ("b", "a"))
    )
    with pytest.raises(ModelError, match=f"inputs are b, a, in another order than a, b{says}"):
        use(first, other)


def fitted(recording: Recording) -> NarxModel:
    return Fixed(terms=["y(k-1)", "a(k-1)", "b(k-2)"]).fit(recording).model_


def test_other_names_are_taken_by_position() -> None:
    first = turned(("volts", "heat"), ("left", "right"))
    assert Frols(degree=1).fit([first, turned(("a", "b"), ("c", "d"))]).model_.input_names == ("volts", "heat")
