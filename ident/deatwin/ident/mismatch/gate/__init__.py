"""Are the recordings sound, and how loud is their sensor?"""

from deatwin.ident.mismatch.gate.gate import Gate, Soundness, confirm, gate, split
from deatwin.ident.mismatch.gate.noise import NoiseFloor, noise_level
from deatwin.ident.mismatch.gate.repeats import Repeatability, Repeats, find_repeats, repeatability

__all__ = [
    "Gate",
    "NoiseFloor",
    "Repeatability",
    "Repeats",
    "Soundness",
    "confirm",
    "find_repeats",
    "gate",
    "noise_level",
    "repeatability",
    "split",
]
