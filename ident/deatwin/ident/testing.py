"""Test whether a user's estimator keeps the contract on which deatwin's tools rely.

>>> from deatwin.ident.narx import Frols
>>> check_identifier(Frols())
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from deatwin.ident.arguments import whole_number
from deatwin.plant.arguments import kind_of
from deatwin.plant.errors import DeatwinError
from deatwin.plant.recording import Experiment, Recording

# Share of the output by which predictions may differ that should agree up to rounding, or up to the end of an
# iteration; one lag taken from another recording moves them by a hundred times as much.
_SAME = 1e-4
_INTERRUPTS = 4  # places at which a fit is interrupted


class ContractError(DeatwinError, AssertionError):
    """Raised by `check_identifier` if an estimator breaks the contract; the message names the rule that is broken."""


def check_identifier(identifier: Any, *, recordings: Sequence[Recording] | None = None) -> None:
    """Raise an error unless an estimator fulfils the contract of deatwin's identifiers.

    The contract:

    - Arguments are stored untouched, and nothing else is set before a fit.
    - ``get_params``, ``set_params``, `sklearn.base.clone` and `sklearn.utils.get_tags` work. ``score`` ranks fits in a
      scikit-learn search over recordings.
    - ``fit`` returns the estimator and leaves arguments and recordings unchanged. Learned attributes have names that
      end in ``_``; ``model_`` and ``status_`` are among them.
    - A second fit does not depend on the first, and equal data give identical model files.
    - Several recordings, given as a list or as experiments, are not joined: each starts from its own first samples.
    - A fit to an output that is zero throughout raises an error.
    - ``predict`` and ``simulate`` of the model return outputs of the recording's shape.
    - Progress is reported. An interrupt either reaches the caller, or leaves a model and a status that reports the
      interrupt.

    Parameters
    ----------
    identifier : object
        Estimator that has not been fitted; it is not changed.
    recordings : sequence of Recording, optional
        Two or more recordings, with a common sample time and clock, to which the estimator can be fitted; defaults to
        `example_recordings`.

    Raises
    ------
    ContractError
        If the estimator breaks the contract; the message names the first rule that is broken.
    """
    if not hasattr(type(identifier), "get_params"):
        raise ContractError(f"identifier must be an estimator, as Frols(); got {kind_of(identifier)}")
    data = tuple(example_recordings() if recordings is None else recordings)
    for check in CHECKS.values():
        check(identifier, data)


def example_recordings(n_samples: int = 150) -> tuple[Recording, Recording]:
    """Return two recordings of y(k) = 0.5 y(k-1) + 0.8 u(k-2) - 0.3 y(k-1)u(k-1) + e(k) with zero initial values.

    The input u is white. The mean of u is -0.6 in the first recording and 0.6 in the second.

    Parameters
    ----------
    n_samples : int
        Number of simulated samples, at least 21. The recordings omit the first 20 of them.
    """
    whole_number(n_samples, "n_samples", 21)
    rng = np.random.default_rng(20090810)
    made = []
    for number, level in enumerate((-0.6, 0.6)):
        u, e, y = level + rng.uniform(-1, 1, n_samples), 0.01 * rng.standard_normal(n_samples), np.zeros(n_samples)
        for k in range(2, n_samples):
            y[k] = 0.5 * y[k - 1] + 0.8 * u[k - 2] - 0.3 * y[k - 1] * u[k - 1] + e[k]
        made.append(Recording.from_arrays(u[20:], y[20:], 0.1, start=100.0 * number))
    return made[0], made[1]


def _require(condition: bool, says: str) -> None:
    if not condition:
        raise ContractError(says)


def _fresh(identifier: Any) -> Any:
    """Return an unfitted estimator with the same arguments."""
    from sklearn.base import clone

    try:
        return clone(identifier)
    except Exception as error:
        raise ContractError(f"sklearn.base.clone fails: {error}") from error


def _learned(identifier: Any) -> set[str]:
    return set(vars(identifier)) - set(identifier.get_params(deep=False))


def _bytes(identifier: Any) -> bytes:
    """Return the content of the model's file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.json"
        identifier.model_.save(path)
        return path.read_bytes()


def _predictions(identifier: Any, data: Sequence[Recording]) -> np.ndarray:
    return np.concatenate([identifier.model_.predict(record).outputs for record in data], axis=1)


def _apart(one: Any, other: Any, data: Sequence[Recording]) -> float:
    """Return the largest difference between two models' predictions, relative to the outputs."""
    outputs = np.concatenate([record.outputs for record in data], axis=1)
    return float(np.abs(_predictions(one, data) - _predictions(other, data)).max() / outputs.std())


def _arguments_are_stored_untouched(identifier: Any, data: tuple[Recording, ...]) -> None:
    kind = type(identifier)
    marks = {name: object() for name in identifier.get_params(deep=False)}
    try:
        made = kind(**marks)
    except Exception as error:
        raise ContractError(
            f"{kind.__name__}.__init__ judges its arguments ({error}); it must store them, and fit must judge"
        ) from error
    for name, mark in marks.items():
        _require(
            getattr(made, name, None) is mark,
            f"{kind.__name__} does not store its argument {name!r} untouched under its name",
        )
    more = sorted(set(vars(made)) - set(marks))
    _require(not more, f"{kind.__name__}.__init__ sets {', '.join(more)} beside its arguments")


def _parameters_are_got_and_set(identifier: Any, data: tuple[Recording, ...]) -> None:
    params = identifier.get_params(deep=False)
    _require(
        all(getattr(identifier, name) is value for name, value in params.items()), "get_params returns other values"
    )
    one = _fresh(identifier)
    for name in params:
        mark = object()
        _require(one.set_params(**{name: mark}) is one, "set_params must return the estimator itself")
        _require(getattr(one, name) is mark, f"set_params does not set {name!r}")
    try:
        one.set_params(no_such_argument_=1)
    except (ValueError, TypeError):
        return
    raise ContractError("set_params accepts a name that is not an argument; it must raise ModelError")


def _clones_are_unfitted(identifier: Any, data: tuple[Recording, ...]) -> None:
    fitted = _fresh(identifier)
    fitted.fit(data)
    copy = _fresh(fitted)
    left = sorted(_learned(copy))
    _require(not left, f"a clone of a fitted estimator holds {', '.join(left)}")
    _require(repr(copy.get_params(deep=False)) == repr(fitted.get_params(deep=False)), "a clone has other arguments")


def _fit_learns_names_that_end_in_underscore(identifier: Any, data: tuple[Recording, ...]) -> None:
    one = _fresh(identifier)
    before = one.get_params(deep=False)
    written = repr(before)
    _require(one.fit(data) is one, "fit must return the estimator itself")
    after = one.get_params(deep=False)
    _require(
        all(after[name] is before[name] for name in before) and repr(after) == written,
        "fit changes the arguments; it must leave them as they were given",
    )
    wrong = sorted(name for name in _learned(one) if not name.endswith("_") or name.startswith("_"))
    _require(not wrong, f"fit sets {', '.join(wrong)}; what is learned has names that end in _")
    for name in ("model_", "status_"):
        _require(hasattr(one, name), f"fit sets no {name}")
    _require(getattr(one.status_, "ok", None) is True, f"a fit that was not interrupted has the status {one.status_!r}")


def _nested_arguments_are_got_and_set(identifier: Any, data: tuple[Recording, ...]) -> None:
    one = _fresh(identifier)
    for name, value in one.get_params(deep=False).items():
        for key in value.get_params(deep=False) if hasattr(value, "set_params") else ():
            mark = object()
            _require(f"{name}__{key}" in one.get_params(), f"get_params(deep=True) has no {name}__{key}")
            one.set_params(**{f"{name}__{key}": mark})
            _require(getattr(getattr(one, name), key) is mark, f"set_params does not set {name}__{key}")


def _searches_run_over_recordings(identifier: Any, data: tuple[Recording, ...]) -> None:
    from sklearn.model_selection import GridSearchCV
    from sklearn.utils import get_tags

    try:
        tags = get_tags(identifier)
        fitted = _fresh(identifier).fit(data)
        score = fitted.score(data)
        search = GridSearchCV(_fresh(identifier), {}, cv=2, error_score="raise").fit(list(data))
    except Exception as error:
        raise ContractError(f"scikit-learn cannot search over recordings: {error}") from error
    _require(not tags.target_tags.required, "the tags ask for a target; the outputs are in the recordings")
    _require(
        isinstance(score, float) and score <= 1,
        f"score returns {score!r}; it must be a number that is 1 for a perfect fit",
    )
    best = search.best_estimator_.score(list(data))
    _require(best == score, f"a search ends on the score {best!r}; the same fit has {score!r}")


def _recordings_are_left_alone(identifier: Any, data: tuple[Recording, ...]) -> None:
    def state() -> list[Any]:
        return [
            (
                r.inputs.tobytes(),
                r.outputs.tobytes(),
                r.inputs.flags.writeable,
                r.outputs.flags.writeable,
                repr(r.provenance),
                sorted(r.extras),
                r.start,
                r.sample_time,
            )
            for r in data
        ]

    before = state()
    _fresh(identifier).fit(data)
    _require(state() == before, "fit changes the recordings")


def _equal_data_give_equal_bytes(identifier: Any, data: tuple[Recording, ...]) -> None:
    state = repr(np.random.get_state(legacy=False))  # noqa: NPY002
    one, other = _fresh(identifier).fit(data), _fresh(identifier).fit(data)
    _require(_bytes(one) == _bytes(other), "two fits to the same data give files of different bytes")
    drawn = repr(np.random.get_state(legacy=False))  # noqa: NPY002
    _require(drawn == state, "fit draws from NumPy's global generator; take a generator or a seed")


def _a_fit_forgets_the_one_before(identifier: Any, data: tuple[Recording, ...]) -> None:
    whole = _bytes(_fresh(identifier).fit(data))
    one = _fresh(identifier).fit(data[:1])
    one.fit(data)
    _require(_bytes(one) == whole, "a fit depends on the fit before it")
    one.fit(data)
    _require(_bytes(one) == whole, "fitting twice to the same data gives another model")


def _each_recording_has_its_own_lags(identifier: Any, data: tuple[Recording, ...]) -> None:
    together = _fresh(identifier).fit(list(data))
    experiment = _fresh(identifier).fit(Experiment(recordings=data))
    _require(_apart(together, experiment, data) < _SAME, "a list of recordings and an Experiment of them differ")
    first = _fresh(identifier).fit(data[0])
    _require(_apart(together, first, data) > 0, "of several recordings only the first one is fitted")
    turned = _fresh(identifier).fit(data[::-1])
    _require(
        _apart(together, turned, data) < _SAME,
        "the model depends on the order of the recordings: lags must not reach from one into the one before it",
    )


def _a_zero_output_is_refused(identifier: Any, data: tuple[Recording, ...]) -> None:
    record = data[0]
    silent = Recording.from_arrays(record.inputs, np.zeros(record.outputs.shape), record.sample_time)
    try:
        _fresh(identifier).fit(silent)
    except DeatwinError:
        return
    except Exception as error:
        raise ContractError(f"a constantly zero output raises {error!r}; it must be a ModelError") from error
    raise ContractError("a constantly zero output is fitted; it must raise a ModelError: there is nothing to identify")


def _models_predict_and_simulate(identifier: Any, data: tuple[Recording, ...]) -> None:
    model = _fresh(identifier).fit(data).model_
    for name in ("predict", "simulate"):
        for record in data:
            outputs = np.asarray(getattr(model, name)(record).outputs)
            _require(
                outputs.shape == record.outputs.shape,
                f"model_.{name} returns outputs of shape {outputs.shape}; the recording's is {record.outputs.shape}",
            )
            _require(bool(np.all(np.isfinite(outputs))), f"model_.{name} returns outputs that are not finite")


def _progress_is_told(identifier: Any, data: tuple[Recording, ...]) -> None:
    told = _told(identifier, data)
    _require(bool(told), "fit never calls progress")
    shares = np.array([share for share, _ in told], dtype=np.float64)
    _require(
        bool(np.all((shares >= 0) & (shares <= 1 + 1e-12)) and np.all(np.diff(shares) >= -1e-12)),
        "the first argument of progress is the finished share of the work; it must rise within 0 to 1",
    )
    _require(all(isinstance(doing, str) for _, doing in told), "progress takes what is being done as a text")


def _told(identifier: Any, data: tuple[Recording, ...]) -> list[tuple[float, str]]:
    """Return everything that a fit reports of its progress."""
    told: list[tuple[float, str]] = []
    _fresh(identifier).fit(data, progress=lambda share, doing: told.append((share, doing)))
    return told


def _an_interrupt_is_kept_or_passed_on(identifier: Any, data: tuple[Recording, ...]) -> None:
    whole = _bytes(_fresh(identifier).fit(data))
    calls = len(_told(identifier, data))
    for place in sorted({round(x) for x in np.linspace(1, calls, _INTERRUPTS)}) if calls else ():
        one, count = _fresh(identifier), 0

        def interrupt(share: float, doing: str, place: int = place) -> None:
            nonlocal count
            count += 1
            if count == place:
                raise KeyboardInterrupt

        try:
            one.fit(data, progress=interrupt)
        except KeyboardInterrupt:
            pass
        else:
            _require(not one.status_.ok, f"an interrupt is swallowed: status_ is {one.status_!r}")
            one.model_.predict(data[0])
        _require(_bytes(one.fit(data)) == whole, "a fit after an interrupted one gives another model")


CHECKS: Mapping[str, Callable[[Any, tuple[Recording, ...]], None]] = MappingProxyType(
    {
        check.__name__.strip("_"): check
        for check in (
            _arguments_are_stored_untouched,
            _parameters_are_got_and_set,
            _nested_arguments_are_got_and_set,
            _recordings_are_left_alone,
            _fit_learns_names_that_end_in_underscore,
            _clones_are_unfitted,
            _models_predict_and_simulate,
            _equal_data_give_equal_bytes,
            _a_fit_forgets_the_one_before,
            _each_recording_has_its_own_lags,
            _a_zero_output_is_refused,
            _searches_run_over_recordings,
            _progress_is_told,
            _an_interrupt_is_kept_or_passed_on,
        )
    }
)
"""Parts of the contract by name, for tests of one part at a time; each takes an identifier and recordings."""
