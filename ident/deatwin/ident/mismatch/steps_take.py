"""Check the arguments of the steps of a diagnosis, and say which call returns the right ones."""

from __future__ import annotations

from deatwin.plant.arguments import as_annotated

RETURNED_BY = {
    "Calibration": "prepare returns one, as Base.chosen.calibration",
    "Candidate": "prepare returns one, as Base.chosen",
    "DataQuality": "check_quality returns one",
    "Diagnosis": "diagnose returns one, and Diagnosis.load reads one from a file",
    "DiagnosisProblem": "prepare returns one",
    "Distance": "Naming.distances has them, which name_causes returns",
    "Experiment": "Experiment(recordings=...) makes one",
    "Generator": "numpy.random.default_rng(seed) makes one",
    "LinearisedResponse": "linearised_responses returns them",
    "Plant": "Plant(rig=...) makes one",
    "ndarray": "the function readings returns them for each experiment",
}
"""For each class, where a user gets its objects."""

checks_its_arguments = as_annotated(RETURNED_BY)
"""Decorator of the steps, which raise ModelError for an argument of another class and say where to get the right one."""
