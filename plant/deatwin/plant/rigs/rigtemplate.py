"""A rig file to be filled in: each key with its unit, its meaning and whether it may be omitted."""

from collections.abc import Mapping
from types import MappingProxyType

from deatwin.plant.laws.energies import ENERGIES
from deatwin.plant.material import MATERIALS
from deatwin.plant.prefixes import prefixed
from deatwin.plant.readings import ELECTRICAL_UNITS
from deatwin.plant.rigs.rigkeys import NumberKey, TextKey
from deatwin.plant.rigs.rigkinds import KINDS
from deatwin.plant.rigs.rigreadings import READING_KEYS

_HEAD = """\
# {about}
# Lines that begin with "# " explain. A line "#key = value" is an example: take its # away and put your value there. One with ## is an alternative.
# Until the required keys have their values, every command that is given this file lists those that are missing.
kind = "{kind}"
"""
AT_MOST = "the recording shows at most this: put the data sheet's value here if you have it"
"""Remark of the template on a noise that was estimated from a recording."""
_OWN_MATERIAL = f"""\
##[material]  # a film of your own, instead of the key material in [film]
# energy: one of {", ".join(ENERGIES)}, or a formula in I1 and I2
##energy = "neo_hookean"
##permittivity = 2.8
##[material.parameters]  # of the energy, moduli in Pa; a fit starts from these values
##shear_modulus = 300e3
# gent has also stretch_limit: J_m, the value of I1 - 3 at which the film locks
##[[material.branches]]  # a film that relaxes: one for each relaxation
##modulus_Pa = 40e3
##time_s = 8.0
"""
_SECTIONS = {
    "film": "the membrane",
    "load": "what the film moves",
    "drive": "what gives the commands, and how the film came to the first one",
    "sensor": "what takes the readings",
}
_EXAMPLES: Mapping[str, float | str] = {
    "material": "VHB 4905",
    "thickness_mm": 0.5,
    "prestretch": 3.5,
    "frame_diameter_mm": 80.0,
    "electrode_diameter_mm": 35.0,
    "mass_g": 0.0,
    "force_N": 0.0,
    "input": "film voltage",
    "start": "unknown",
    "gain": 800.0,
    "start_ramp_s": 2.0,
    "start_hold_s": 3.0,
    "command_min_V": 0.0,
    "command_max_V": 3.75,
    "current_limit_uA": 200.0,
    "sink_current_uA": 200.0,
    "series_resistance_Mohm": 0.1,
    "bleed_resistance_Mohm": 1000.0,
    "parallel_capacitance_pF": 0.0,
    "sample_rate_Hz": 50.0,
    "noise_um": 2.0,
    "noise_mN": 1.0,
    "resolution_mN": 0.1,
    "resolution_um": 0.5,
    "model_error_um": 5.0,
    "model_error_mN": 0.5,
    "zero": "displacement at zero volts",
    "direction": "along the motion",
    "reading": "end of hold",
}


def rig_template(
    known: Mapping[str, tuple[float | str, str]],
    kind: str = "diaphragm",
    noises: Mapping[str, float] = MappingProxyType({}),
) -> str:
    """Write a rig file to be filled in, with `known` values and their origin; `noises` in SI."""
    parts, described = [_HEAD.format(about=KINDS[kind].about, kind=kind)], KINDS[kind]
    for section, keys in described.sections.items():
        lines = [f"[{section}]  # {_SECTIONS[section]}"]
        for name, key in keys.items():
            lines += _entry(name, key, known.get(name), {**_EXAMPLES, **described.examples}[name])
        parts.append("\n".join(lines) + "\n")
        if "material" in keys:
            parts.append(_OWN_MATERIAL)
    for name, noise in noises.items() if "load" in described.sections else ():  # a coupon has no electrodes
        size, unit = prefixed(noise, ELECTRICAL_UNITS[name])
        lines = [
            f"[readings.{name}]  # a further reading, as recorded; without this section it does not count",
            f'unit = "{unit}"',
            f"# noise: {READING_KEYS['noise'].about}; {AT_MOST}",
            f"noise = {float(f'{noise / size:.3g}')!r}",
        ]
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)


def _entry(
    name: str, key: NumberKey | TextKey, known: tuple[float | str, str] | None, example: float | str
) -> list[str]:
    """Write the lines of a key: its meaning, and its value or an example."""
    allowed = f"one of {', '.join(MATERIALS)}" if name == "material" else key.allowed
    said = [f"# {name}: {key.about}; {allowed}", "" if key.required else "may be left out"]
    if known is not None:
        said.append(known[1])
    value = known[0] if known is not None else example
    written = f'"{value}"' if isinstance(value, str) else repr(float(f"{value:.6g}"))
    # An alternative to a required key stays an example even if the others are filled in.
    mark = "" if known is not None else "##" if isinstance(key, TextKey) and name in ("input", "start") else "#"
    return ["; ".join(filter(None, said)), f"{mark}{name} = {written}"]
