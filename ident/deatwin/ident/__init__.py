"""Identify models and frequency responses from recordings, and diagnose a plant that disagrees with a recording."""

from deatwin.ident.parallel import run_jobs, spawn_generators
from deatwin.ident.testing import ContractError, check_identifier, example_recordings

__all__ = [
    "ContractError",
    "check_identifier",
    "example_recordings",
    "run_jobs",
    "spawn_generators",
]
