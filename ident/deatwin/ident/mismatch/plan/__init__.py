"""Before anything is recorded: which effects an input would show, and which it could not tell apart."""

from deatwin.ident.mismatch.plan.plan import plan_experiment
from deatwin.ident.mismatch.plan.result import ExperimentPlan, Foreseen

__all__ = ["ExperimentPlan", "Foreseen", "plan_experiment"]
