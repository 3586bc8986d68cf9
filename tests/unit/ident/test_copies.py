"""Copies and pickles of all public estimators, and of what they return, as joblib and worker processes need them."""

import copy
import importlib
import inspect
import pickle
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from functools import cache

import numpy as np
import pytest
from made_coupons import made_tests
from public import PUBLIC

from deatwin.ident.frequency import design_excitation, gfrf, nofrf
from deatwin.ident.greybox import calibrate
from deatwin.ident.look import best_linear_approximation, look_at
from deatwin.ident.materials import calibrate_material
from deatwin.ident.narx import Fixed, ThetaPosterior, excitation, free_run_band, validate
from deatwin.ident.narx.preprocess import choose_sampling, estimate_dead_time
from deatwin.plant import CalibratedPlant, Planar, Plant, Recording, actuation_curve

AGAIN = {"copy": copy.deepcopy, "pickle": lambda one: pickle.loads(pickle.dumps(one))}
TERMS = ["y(k-1)", "u(k-1)"]
PLANT = Plant(rig=Planar())
NEEDED = {
    **{key: {"terms": TERMS} for key in ("Fixed", "Rls", "ThetaSmoother")},
    **{key: {"states": 1} for key in ("Pnlss", "Cascade")},
    "Narmax": {"process": Fixed(terms=TERMS), "noise_terms": ["e(k-1)"]},
    "Grow": {"max_terms": 2},
}


def recorded() -> Recording:
    rng = np.random.default_rng(0)
    u, y = np.tile(rng.uniform(-1.0, 1.0, 50), 6), np.zeros(300)
    for k in range(1, 300):
        y[k] = 0.6 * y[k - 1] + 0.4 * u[k - 1] + 0.05 * u[k - 1] ** 2
    return Recording.from_arrays(u, y + 0.01 * rng.normal(size=300), 0.01)


def public_estimators() -> dict[str, type]:
    """Those that can be fitted: bases, which other estimators derive from, are left out."""
    exported = [getattr(module, name) for module in map(importlib.import_module, PUBLIC) for name in module.__all__]
    found = {one for one in exported if inspect.isclass(one) and callable(getattr(one, "fit", None))}
    bases = {base for one in found for base in one.__mro__[1:]}
    return {one.__name__: one for one in sorted(found - bases, key=lambda one: one.__name__)}


@cache
def fitted(name: str):
    return public_estimators()[name](**NEEDED.get(name, {})).fit([recorded()])


@pytest.mark.parametrize("again", AGAIN.values(), ids=AGAIN)
@pytest.mark.parametrize("name", public_estimators())
def test_a_fitted_estimator_and_what_it_learned_can_be_copied(name, again):
    one = fitted(name)
    other = again(one)
    assert vars(other).keys() == vars(one).keys()
    if hasattr(one, "model_"):
        simulated, same = (each.model_.simulate(recorded()) for each in (one, other))
        np.testing.assert_array_equal(again(simulated).outputs, same.outputs)
        np.testing.assert_array_equal(other.model_.theta_cov, one.model_.theta_cov)
        assert not other.model_.theta_cov.flags.writeable
        assert dict(other.model_.provenance) == dict(one.model_.provenance)


def results():
    """What functions of the public border return for a recording and a model."""
    record, model, rng = recorded(), fitted("Fixed").model_, np.random.default_rng(1)
    signal = design_excitation((1.0, 5.0), 0.01, amplitude=0.5)
    driven = Recording.from_arrays(2.0 + record.inputs[0], record.outputs[0], 0.02)
    return {
        "look": look_at(record),
        "best linear approximation": best_linear_approximation(record),
        "validation": validate(model, [record]),
        "band": free_run_band(model, record, rng, n_draws=20),
        "band of a state space": fitted("Pnlss").model_.free_run_band(record),
        "posterior": ThetaPosterior(model=model),
        "trajectory": fitted("ThetaSmoother").trajectory_,
        "dead time": estimate_dead_time([record])[0],
        "sampling": choose_sampling([record]),
        "recording": replace(record, extras={"temperature": record.outputs[0]}),
        "simulation": model.simulate(record),
        "response": gfrf(model, 1, [1.0, 2.0]),
        "test signal": signal,
        "orders": nofrf(model, signal, 1),
        "excitation": excitation(record),
        "path": fitted("Lasso").path_,
        "pruning": fitted("SvbNarx").path_[0],
        "simulated plant": PLANT.simulate(driven),
        "curve": actuation_curve(PLANT, np.linspace(0.0, 2.0, 5)),
        "calibration": calibrate(PLANT, PLANT.record(driven, rng), names=["permittivity"], starts=1),
        "material": calibrate_material(made_tests(rng), {"energy": "gent"}),
        "prediction": CalibratedPlant(plant=PLANT, noise=1e-6, model_error=0.0).predict(driven),
    }


def read_only(one, at: str = "") -> dict[str, bool]:
    """Tell of every array in an object, at any depth, whether it is read-only."""
    if isinstance(one, np.ndarray):
        return {at: not one.flags.writeable}
    if is_dataclass(one):
        parts = {field.name: getattr(one, field.name) for field in fields(one)}
    elif isinstance(one, Mapping | tuple | list):
        parts = one if isinstance(one, Mapping) else dict(enumerate(one))
    else:
        return {}
    return {place: found for key, part in parts.items() for place, found in read_only(part, f"{at}.{key}").items()}


@pytest.mark.parametrize("again", AGAIN.values(), ids=AGAIN)
def test_results_can_be_copied(again):
    for name, result in results().items():
        other = again(result)
        assert type(other) is type(result) and vars(other).keys() >= {field.name for field in fields(result)}, name
        assert "__str__" not in vars(type(result)) or str(other) == str(result), name
        for one in (result, other):
            found = read_only(one)
            assert all(found.values()), f"{name}: {[at for at, holds in found.items() if not holds]}"
        assert found.keys() == read_only(result).keys(), name
