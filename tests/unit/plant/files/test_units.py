"""Which unit a header names."""

import pytest

from deatwin.plant.files.units import UNITS, split_unit


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("displacement_mm", "displacement", "mm"), ("Force [N]", "Force", "N"), ("U (kV)", "U", "kV"),
        ("U_cmd (kV)", "U_cmd", "kV"), ("x_pos_2[µm]", "x_pos_2", "um"), ("t_rel (ms)", "t_rel", "ms"),
        ("x_mm (V)", "x_mm", "V"), ("film_voltage", "film_voltage", ""), ("x_left (left)", "x_left (left)", ""),
        ("gain (V)_mm", "gain (V)", "mm"), ("mm", "mm", ""), ("U/mV", "U", "mV"), ("U_cmd / kV", "U_cmd", "kV"),
        ("t/s", "t", "s"), ("mm/s", "mm/s", ""), ("x/s", "x/s", ""), ("N/m", "N/m", ""), ("rad/m", "rad/m", ""),
        ("v_m/s", "v", "m/s"), ("U in mV", "U", "mV"), ("Weg 2 in µm", "Weg 2", "um"),
        ("U (Volt)", "U", "V"), ("U [Kilovolts]", "U", "kV"), ("Weg in Millimeter", "Weg", "mm"),
        ("t (seconds)", "t", "s"), ("gap [micron]", "gap", "um"), ("T (Celsius)", "T", "C"),
        ("x_millimeters", "x", "mm"),
        ("run in air", "run in air", ""), ("m/s/s", "m/s/s", ""), ("1/m", "1/m", ""),
    ],
)  # fmt: skip
def test_the_unit_is_read_off_the_usual_forms(header: str, name: str, unit: str) -> None:
    assert split_unit(header) == (name, unit)


@pytest.mark.parametrize("unit", [unit for unit in UNITS if unit])
@pytest.mark.parametrize("name", ["U", "U_cmd", "Weg 2", "a_b_c", "电压_x"])
@pytest.mark.parametrize("form", ["{}_{}", "{} ({})", "{}[{}]", "{} in {}"])
def test_any_name_keeps_its_unit(name: str, unit: str, form: str) -> None:
    assert split_unit(form.format(name, unit)) == (name, unit)
