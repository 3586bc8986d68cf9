"""Inspect recordings, and choose sections, dead times, sampling time and orders before a NARX model is fitted.

Only `decimate` makes new samples; all other functions state what they find or choose, and why.
"""

from deatwin.ident.narx.preprocess.dead_time import DeadTime, DeadTimeStatus, estimate_dead_time, lags_after
from deatwin.ident.narx.preprocess.decimation import SamplingChoice, SamplingStatus, choose_sampling
from deatwin.ident.narx.preprocess.findings import Finding, FindingKind, inspect_recordings
from deatwin.ident.narx.preprocess.orders import OrderChoice, OrderTrial, TrialStatus, choose_orders
from deatwin.ident.narx.preprocess.sections import Sections, SectionStatus, StationarityTest, Stretch, choose_sections
from deatwin.plant.decimation import decimate, removed_share

__all__ = [
    "DeadTime",
    "DeadTimeStatus",
    "Finding",
    "FindingKind",
    "OrderChoice",
    "OrderTrial",
    "SamplingChoice",
    "SamplingStatus",
    "SectionStatus",
    "Sections",
    "StationarityTest",
    "Stretch",
    "TrialStatus",
    "choose_orders",
    "choose_sampling",
    "choose_sections",
    "decimate",
    "estimate_dead_time",
    "inspect_recordings",
    "lags_after",
    "removed_share",
]
