"""Sweeps: run many cases on one core, all cores or a cluster, and write each when it is done.

A sweep is sealed before its first case. It can be killed and resumed at any time, and it refuses to mix cases that were
run under different conditions. ``joblib.parallel_config`` chooses the backend.
"""

from deatwin.studies.sweep.study import Study, grid, open_study, run_study

__all__ = ["Study", "grid", "open_study", "run_study"]
