"""Sweeps: many cases on one core, all cores or a cluster, each written when it is through.

A sweep is sealed before its first case, can be killed and gone on with at any time, and refuses to mix cases that were
run under different conditions. Which backend runs it is said by ``joblib.parallel_config``.
"""

from deatwin.studies.sweep.results import Study, open_study
from deatwin.studies.sweep.run import run_sweep
from deatwin.studies.sweep.seal import SweepSeal, digest, sources_digest
from deatwin.studies.sweep.store import CaseStore
from deatwin.studies.sweep.study import grid, run_study

__all__ = [
    "CaseStore",
    "Study",
    "SweepSeal",
    "digest",
    "grid",
    "open_study",
    "run_study",
    "run_sweep",
    "sources_digest",
]
