"""The choice of sampling time, orders and sections as xarray datasets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from deatwin.plant.datasets import columns, dataset, squared

if TYPE_CHECKING:
    from deatwin.ident.narx.preprocess.decimation import SamplingChoice
    from deatwin.ident.narx.preprocess.orders import OrderChoice
    from deatwin.ident.narx.preprocess.sections import Sections


def sampling_dataset(choice: SamplingChoice) -> Any:
    """Both correlation functions over the lag. returns The coordinate ``lag`` counts samples, ``lag_time`` seconds."""
    lags = np.arange(choice.linear.size)
    return dataset(
        {
            "linear": ("lag", choice.linear, "", "correlation of the output with itself"),
            "nonlinear": ("lag", choice.nonlinear, "", "correlation of the squared output with itself"),
        },
        {"lag": ("lag", lags, "samples"), "lag_time": ("lag", lags * choice.sample_time, "s")},
        {
            "linear_band": choice.linear_band,
            "nonlinear_band": choice.nonlinear_band,
            "linear_minimum": choice.linear_minimum,
            "nonlinear_minimum": choice.nonlinear_minimum,
            "sample_time": choice.sample_time,
            "factor": choice.factor,
            "status": choice.status.name,
            "advice": choice.status.value,
        },
    )


def orders_dataset(choice: OrderChoice) -> Any:
    """All points of the grid along ``trial``."""
    chosen = choice.chosen if choice.done else None
    given = {
        name: ("trial", np.array([str(getattr(trial, name)) for trial in choice.trials], dtype=str))
        for name in ("output_lags", "input_lags")
    }
    return dataset(
        {
            **given,
            "degree": ("trial", [trial.degree for trial in choice.trials]),
            "n_terms": ("trial", [trial.n_terms for trial in choice.trials]),
            "n_input_terms": ("trial", [trial.n_input_terms for trial in choice.trials]),
            "error": ("trial", [t.error for t in choice.trials], choice.unit, "RMS of the free run, held-out data"),
            "mean_square": ("trial", [trial.mean_square for trial in choice.trials], squared(choice.unit)),
            "standard_error": (
                "trial",
                [t.standard_error for t in choice.trials],
                squared(choice.unit),
                "standard error of mean_square",
            ),
            "status": ("trial", np.array([trial.status.name for trial in choice.trials], dtype=str)),
            "reason": ("trial", np.array([trial.reason for trial in choice.trials], dtype=str)),
            "chosen": ("trial", np.array([trial is chosen for trial in choice.trials], dtype=bool)),
        },
        {},
        {"n_done": len(choice.done)},
    )


def sections_dataset(found: Sections) -> Any:
    """The two sections, the stretches that passed, and the tests of each recording."""
    sections = (found.training, found.validation)
    stretches = [{"record": s.record, "first": s.first, "last": s.last, "p_value": s.p_value} for s in found.stretches]
    tests = [
        {"record": number, "signal": t.signal, "statistic": t.statistic, "kind": t.test, "p_value": t.p_value}
        for number, each in enumerate(found.tests)
        for t in each
    ]
    return dataset(
        {
            "section_start": ("section", [one.start for one in sections], "s"),
            "section_end": ("section", [one.end for one in sections], "s"),
            "section_n_samples": ("section", [one.n_samples for one in sections]),
            **columns("stretch", stretches, {"first": "samples", "last": "samples"}),
            **columns("test", tests),
            "segment": ("record", list(found.segment_s), "s", "length of a segment"),
            "correlation_time": ("record", list(found.correlation_time_s), "s", "longest within the segments"),
            "record_start": ("record", [one.start for one in found.recordings], "s"),
            "record_end": ("record", [one.end for one in found.recordings], "s"),
        },
        {"section": ("section", ["training", "validation"])},
        {
            "level": found.level,
            "segments_are_long": found.segments_are_long,
            "status": found.status.name,
            "advice": found.status.value,
        },
    )
