"""Where the fit of a set of effects begins, and when it begins again."""

from types import SimpleNamespace

import numpy as np
import pytest

from deatwin.ident.greybox import Calibration, FitStatus
from deatwin.ident.mismatch.naming import trial
from deatwin.ident.mismatch.naming.trial import Trial, _otherwise, _tried, run_trials
from deatwin.plant import Creep, CubicStiffness, Diaphragm, Plant

PLANT = Plant(rig=Diaphragm()).with_effects(Creep())


def fit_of(rms: float) -> SimpleNamespace:
    return SimpleNamespace(status=FitStatus.SETTLED, rms=rms, given_up=False)


@pytest.mark.parametrize(
    "share, ended",
    [
        (0.0, 3.3),  # better than without the effect, and no more was promised
        (0.7, 3.3),  # 6.4 sqrt(0.3) = 3.5: kept
        (0.9, 2.1),  # 2.0 was promised: the search lost its way, and the bent plant is nearer
    ],
)
def test_a_search_that_does_not_keep_what_the_score_promises_is_made_from_the_bent_plant(monkeypatch, share, ended):
    monkeypatch.setattr(trial, "search", lambda *_: fit_of(3.3))
    monkeypatch.setattr(trial, "calibrate", lambda *_, **__: fit_of(2.1))
    monkeypatch.setattr(trial, "at_its_time", lambda fit, *_: fit)
    task = Trial(start=PLANT, bent=PLANT, without=fit_of(6.4), share=share)
    assert _tried(SimpleNamespace(fitted=()), task, float("inf")).rms == ended


@pytest.mark.parametrize("rms, ended", [(4.0, 2.1), (5.0, 5.0)])  # 4.0^2 is less than half of 6.4^2, 5.0^2 more
def test_a_fit_that_already_takes_most_of_the_mismatch_is_not_given_up(monkeypatch, rms, ended):
    """As that of a lag whose size is off by a factor of twenty, and whose linearised minimum says little."""
    given_up = SimpleNamespace(status=FitStatus.GIVEN_UP, rms=rms, given_up=True, plant=None)
    monkeypatch.setattr(trial, "search", lambda *_: given_up)
    monkeypatch.setattr(trial, "roughly", lambda *_: fit_of(2.1))
    monkeypatch.setattr(trial, "at_its_time", lambda fit, *_: fit)
    monkeypatch.setattr(trial, "calibrate", lambda *_, **__: fit_of(9.0))  # from the bent plant
    task = Trial(start=PLANT, bent=PLANT, without=fit_of(6.4), share=0.1)
    assert _tried(SimpleNamespace(fitted=()), task, 3.0).rms == ended


def test_what_is_explained_to_first_order_is_promised():
    assert Trial(start=None, bent=None, without=fit_of(5.0), share=0.64).promised == pytest.approx(3.0)


def rough(rms: float, linearised: float, status: FitStatus) -> Calibration:
    """A fit whose linear model would leave so much, by one more step of its only parameter."""
    along, across = np.tile([1.0, 1.0], 50), np.tile([1.0, -1.0], 50)
    return Calibration(
        plant=SimpleNamespace(rig=SimpleNamespace(model_error=0.1)), names=("a",), covariance=np.eye(1),
        residuals=linearised * across + float(np.sqrt(rms**2 - linearised**2)) * along, jacobian=along[:, None],
        status=status, at_bound=(), evaluations=10,
    )  # fmt: skip


def test_what_ran_out_of_simulations_on_its_way_to_the_best_is_carried_to_the_end(monkeypatch):
    """The place of a stop is found step by step; a rough fit of it may leave more than a wrong effect does at best."""
    settled, stopped = FitStatus.SETTLED, FitStatus.STOPPED
    fits = {
        "best": rough(2.0, 2.0, settled),
        "at its own end": rough(3.0, 2.1, settled),  # its linear model errs: it has ended there
        "on its way": rough(3.0, 2.19, stopped),  # 1.1 x 2.0 is 2.2
        "on its way elsewhere": rough(3.0, 2.21, stopped),
        "beside": rough(2.19, 2.19, settled),
    }
    finished: list[Calibration] = []
    monkeypatch.setattr(trial, "_tried", lambda bench, fit, hopeless: fit)
    monkeypatch.setattr(trial, "_finished", lambda bench, fit: finished.append(fit) or fit)
    monkeypatch.setattr(trial, "judge", lambda bench, fit, noise: fit)
    assert run_trials(SimpleNamespace(jobs=1), list(fits.values()), 0.5) == list(fits.values())
    assert finished == [fits["best"], fits["on its way"], fits["beside"]]


def test_a_fit_begins_with_an_effect_the_other_way_or_weaker_where_it_must():
    plant = Plant(rig=Diaphragm()).with_effects(Creep(), CubicStiffness(stiffness=-2e7))
    assert [p.parameters["cubic_stiffness.stiffness"].value for p in _otherwise(plant)] == [2e7, -2e6, -2e4]
    one_sided = Plant(rig=Diaphragm()).with_effects(Creep(modulus=1e5))  # negative moduli are out of range
    assert [p.parameters["creep.modulus"].value for p in _otherwise(one_sided)] == pytest.approx([1e4, 1e2])
