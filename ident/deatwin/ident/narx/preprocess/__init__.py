"""Before a NARX model is fitted: what is in the recordings, which sections, which dead
times, which sampling time, which orders.

Nothing is altered on the way: `inspect_recordings` names what it finds, `choose_sections` and `choose_sampling`
choose and give their reasons, and only `decimate` makes new samples, when it is told to.
"""

from deatwin.ident.narx.preprocess.dead_time import DeadTime, DeadTimeStatus, estimate_dead_time, lags_after
from deatwin.ident.narx.preprocess.decimation import SamplingChoice, SamplingStatus, choose_sampling
from deatwin.ident.narx.preprocess.findings import Finding, FindingKind, inspect_recordings
from deatwin.ident.narx.preprocess.orders import OrderChoice, OrderTrial, TrialStatus, choose_orders
from deatwin.ident.narx.preprocess.sections import (
    Sections,
    SectionStatus,
    StationarityTest,
    Stretch,
    choose_sections,
)
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
