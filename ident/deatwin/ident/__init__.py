"""Identification: recordings -> models -> frequency responses; recordings against a plant -> diagnosis."""

from deatwin.ident.parallel import run_jobs, spawn_generators
from deatwin.ident.testing import ContractError, check_identifier, example_recordings

__all__ = [
    "ContractError",
    "check_identifier",
    "example_recordings",
    "run_jobs",
    "spawn_generators",
]
