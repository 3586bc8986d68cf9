"""A result of a diagnosis as its file holds it."""

from typing import Any

DIAGNOSIS: dict[str, Any] = {
    "schema": "deatwin/diagnosis/2",
    "output": {"name": "displacement", "unit": "um"},
    "verdict": "named",
    "noise": 2.0,
    "model_error": 0.9,
    "detect": {"p_value": 0.0, "excess": 4.1, "smallest_detectable": {"creep": 0.4}},
    "locate": {"time": [], "frequency": [], "region": [], "place": []},
    "causes": [
        {
            "effect": "creep",
            "family": "film",
            "probability": 0.98,
            "share_explained": 0.97,
            "parameters": {"time": {"value": 54.0, "low": 50.0, "high": 59.0, "unit": "s"}},
        }
    ],
    "set": ["creep"],
    "indistinguishable": [],
    "next_experiment": None,
    "free_form": None,
    "sentence": "The film <keeps> creeping.",
    "fit": {"fitted": {"before": 9.8, "after": 2.05}, "unseen": {"before": 10.2, "after": 2.1, "gain_low": 7.4}},
    "warnings": [],
}
