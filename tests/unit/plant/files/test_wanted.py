"""Units in which columns are wanted, and what is said of others."""

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from deatwin.plant.errors import DataError
from deatwin.plant.files import read_recording
from deatwin.plant.files.headers import said_unit, split_unit
from deatwin.plant.files.units import UNITS

SI = sorted({unit.si for unit in UNITS.values()} - {"", "1", "s"})


def written(folder: Path, header: str) -> Path:
    path = folder / "r.csv"
    path.write_text(f"time_s,command_V,{header}\n0,0,1\n0.1,1,2\n0.2,0,-3\n", encoding="utf-8")
    return path


def read(path: Path, header: str, unit: str | None = None) -> tuple[str, str, list[float]]:
    found = read_recording(path, output_column=header, output_unit=unit)
    return found.output_names[0], found.output_units[0], found.outputs[0].tolist()


@pytest.mark.parametrize(
    ("header", "wanted", "values"),
    [
        ("speed (rad/s)", "rad/s", [1.0, 2.0, -3.0]),
        ("speed (rpm)", "rad/s", [np.pi / 30, np.pi / 15, -np.pi / 10]),
        ("speed (rpm)", "rpm", [1.0, 2.0, -3.0]),
        ("speed (rad/s)", "rpm", [30 / np.pi, 60 / np.pi, -90 / np.pi]),
        ("speed (widgets/h)", "widgets/h", [1.0, 2.0, -3.0]),
        ("speed_widgets/h", "widgets/h", [1.0, 2.0, -3.0]),
        ("speed (C)", "C", [1.0, 2.0, -3.0]),  # coulombs, if the plant says so
        ("speed (K)", "degC", [-272.15, -271.15, -276.15]),
        ("speed (bar)", "kPa", [100.0, 200.0, -300.0]),
        ("speed (N·m)", "Nm", [1.0, 2.0, -3.0]),
        ("speed (rad/s)", "1", [1.0, 2.0, -3.0]),  # the same numbers either way
        ("speed (%)", "1", [0.01, 0.02, -0.03]),
        ("speed (1/s)", "Hz", [1.0, 2.0, -3.0]),
    ],
)
def test_a_column_is_brought_into_the_unit_that_is_wanted(
    tmp_path: Path, header: str, wanted: str, values: list[float]
) -> None:
    name, unit, found = read(written(tmp_path, header), header, wanted)
    assert name == "speed"
    assert unit == wanted
    np.testing.assert_allclose(found, values, rtol=1e-14)


@pytest.mark.parametrize("header", ["speed", "speed_dps", "speed_krpm", "speed_1"])
def test_a_reading_without_a_known_unit_is_refused_where_one_is_wanted(tmp_path: Path, header: str) -> None:
    path = written(tmp_path, header)
    with pytest.raises(DataError, match=f'"{header}" has no unit, but the model needs it in rad/s: .*"{header}=rad/s"'):
        read(path, header, "rad/s")
    assert read(path, f"{header}=rad/s", "rad/s")[1:] == ("rad/s", [1.0, 2.0, -3.0])
    assert read(path, header)[1] == ""


@pytest.mark.parametrize(
    ("said", "count", "factor"),
    [(unit, "rpm", np.pi / 30) for unit in ("1/min", "min-1", "min^-1", "/min")]
    + [("u/min", "rpm", np.pi / 30), ("1/s", "rev/s", 2 * np.pi), ("Hz", "rev/s", 2 * np.pi), ("1/s", "rad/s", 1.0)],
)
def test_what_a_number_a_minute_counts_can_be_stated(tmp_path: Path, said: str, count: str, factor: float) -> None:
    path = written(tmp_path, f"speed ({said})")
    with pytest.raises(DataError) as error:
        read(path, "#3", "rad/s")
    assert "did you mean" not in str(error.value)
    assert said == "u/min" or f'({said})={count}"' in str(error.value)
    np.testing.assert_allclose(read(path, f"#3={count}", "rad/s")[2], factor * np.array([1.0, 2.0, -3.0]), rtol=1e-14)


@pytest.mark.parametrize(("said", "other"), [("1/min", "rev/s"), ("1/s", "rpm"), ("1/s", "deg/s"), ("1/s", "m")])
def test_a_number_a_minute_counts_nothing_of_another_size(tmp_path: Path, said: str, other: str) -> None:
    with pytest.raises(DataError, match=f"is in {said}, but is said to be in {other}"):
        read(written(tmp_path, f"speed ({said})"), f"#3={other}", "rad/s")


def test_the_unit_below_the_name_counts_too(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text("t,u,speed\n(s),(V),(widgets/h)\n0,0,1\n0.1,1,2\n", encoding="utf-8")
    found = read_recording(path, input_column="u", output_column="speed", output_unit="widgets/h")
    assert found.output_units == ("widgets/h",)


def test_a_unit_where_none_is_taken_is_refused_with_a_header_that_works(tmp_path: Path) -> None:
    with pytest.raises(DataError) as error:
        read(written(tmp_path, "speed (mm)"), "speed (mm)", "1")
    better = re.findall('"([^"]*)"', str(error.value))[-1]
    assert read(written(tmp_path, better), better, "1") == ("speed", "1", [1.0, 2.0, -3.0])


@pytest.mark.parametrize(
    ("header", "wanted", "fits"),
    [("temp_C", "m", "pos_mm"), ("speed (Hz)", "rad/s", "turns (rpm)"), ("light [lux]", "m", "pos (um)")],
)
def test_another_quantity_is_refused_with_a_column_that_works(
    tmp_path: Path, header: str, wanted: str, fits: str
) -> None:
    """Nothing makes degrees of a metre: neither a unit like C, as cm is, nor the name of a unit behind the column."""
    path = written(tmp_path, header)
    rows = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([f"{rows[0]},{fits}", *(f"{row},1" for row in rows[1:])]), encoding="utf-8")
    with pytest.raises(DataError) as error:
        read(path, header, wanted)
    assert "did you mean" not in str(error.value) and f"={wanted}" not in str(error.value)
    assert f'such as "{fits}"' in str(error.value) and read(path, fits, wanted)[1] == wanted


@pytest.mark.parametrize("column", ["level (C)", "#3"])
def test_a_c_that_may_be_either_is_asked_for(tmp_path: Path, column: str) -> None:
    path = written(tmp_path, "level (C)")
    with pytest.raises(DataError, match=r'degrees Celsius or coulombs.*"level \(C\)=degC" or "level \(C\)=coulomb"'):
        read(path, column)
    assert read(path, f"{column}=degC") == ("level", "K", [274.15, 275.15, 270.15])
    assert read(path, f"{column}=coulomb") == ("level", "C", [1.0, 2.0, -3.0])


def test_a_charge_is_in_coulombs_and_a_temperature_in_degrees(tmp_path: Path) -> None:
    assert read(written(tmp_path, "charge (C)"), "charge (C)") == ("charge", "C", [1.0, 2.0, -3.0])
    assert read(written(tmp_path, "film_temp_C"), "film_temp_C")[1:] == ("K", [274.15, 275.15, 270.15])


@settings(
    deadline=None, max_examples=200, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    said=st.text("mMkKuUnNcCrRaAdDsSpPbBiIgGhHzZVvVoeElL%/2 ", min_size=1, max_size=6),
    wanted=st.none() | st.sampled_from(SI),
)
def test_what_is_offered_works(tmp_path: Path, said: str, wanted: str | None) -> None:
    header = f"x ({said})"
    try:
        read(written(tmp_path, header), header, wanted)
    except DataError as error:
        offered = [f"x ({text})" for text in re.findall('did you mean "([^"]*)"', str(error))]
        offered += re.findall('as in "([^"]*)"', str(error))
        listed = re.findall(
            r"(?:one of|known are) (.*?)(?: must stand| after the name|\)$|, such as|; or state|$)", str(error)
        )
        offered += [f"x ({unit})" for text in listed for unit in text.split(", ")]
        offered += [f"x ({unit})" for unit in re.findall('="?(degC|coulomb)"', str(error))]
        offered += [f"x ({unit})" for unit in re.findall('state it: "[^"]*=([^"=]*)"', str(error))]  # of a monitor
        assert offered
        for better in offered:
            unit = read(written(tmp_path, better), better, wanted)[1]
            assert unit == wanted if wanted else unit


@pytest.mark.parametrize(("wanted", "offered"), [("rad/s", "speed (rpm)"), ("m", "sped (mm)"), ("1", "speedy (V)")])
def test_a_misspelt_column_is_offered_in_the_unit_that_is_wanted(tmp_path: Path, wanted: str, offered: str) -> None:
    path = written(tmp_path, "speed (rpm),sped (mm),speedy (V)")
    rows = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join([rows[0], *(f"{row},1,1" for row in rows[1:])]), encoding="utf-8")
    with pytest.raises(DataError, match=re.escape(f'did you mean "{offered}"?')):
        read(path, "spee (rpm)", wanted)
    assert read(path, offered, wanted)[1] == wanted


@pytest.mark.parametrize(
    ("header", "unit"),
    [("speed [lines/min]", "lines/min"), ("speed (widgets/h)", "widgets/h"), ("speed / (mm³/rev)", "mm³/rev")],
)
def test_what_stands_in_brackets_is_the_unit_known_or_not(tmp_path: Path, header: str, unit: str) -> None:
    for asked in ("speed", header, "#3"):
        assert read(written(tmp_path, header), asked) == ("speed", unit, [1.0, 2.0, -3.0])
    with pytest.raises(DataError, match=re.escape(f"is in {unit}, but the model needs it in m")):
        read(written(tmp_path, header), "speed", "m")
    assert read(written(tmp_path, header), "speed=mm", "m") == ("speed", "m", [0.001, 0.002, -0.003])


def test_an_unknown_unit_below_the_names_is_carried(tmp_path: Path) -> None:
    path = tmp_path / "r.csv"
    path.write_text("t;u;flow\ns;V;drops/min\n0;0;1\n0,1;1;2\n", encoding="utf-8")
    found = read_recording(path, input_column="u", output_column="flow")
    assert (found.input_units, found.output_names, found.output_units) == (("V",), ("flow",), ("drops/min",))


@pytest.mark.parametrize("asked", ["speed=mm", "#3=mm"])
def test_a_unit_is_stated_behind_the_column(tmp_path: Path, asked: str) -> None:
    assert read(written(tmp_path, "speed"), asked) == ("speed", "m", [0.001, 0.002, -0.003])
    assert read(written(tmp_path, "speed"), asked, "mm") == ("speed", "mm", [1.0, 2.0, -3.0])
    with pytest.raises(DataError, match=r"is in V, but is said to be in mm; remove \"=mm\""):
        read(written(tmp_path, "speed_V"), asked.replace("speed", "speed_V"))
    with pytest.raises(DataError, match='is in "MM", which is not a known unit; did you mean "mm"'):
        read(written(tmp_path, "speed"), asked.upper().replace("SPEED", "speed"))
    assert read(written(tmp_path, "speed"), asked.replace("mm", "widgets/h"))[1] == "widgets/h"


def test_a_name_with_an_equals_sign_wins(tmp_path: Path) -> None:
    path = written(tmp_path, "x=mm")
    assert read(path, "x=mm") == ("x=mm", "", [1.0, 2.0, -3.0])
    assert read(path, "x=mm=um") == ("x=mm", "m", [1e-6, 2e-6, -3e-6])
    with pytest.raises(DataError, match='no column "y"'):
        read(path, "y=um")


@pytest.mark.parametrize(
    "header",
    [
        "HV (V/kV)",
        "HV [1 V/kV]",
        "HV (1V/kV)",
        "HV (1 V = 1 kV)",
        "HV (V per kV)",
        "HV (mV/kV)",
        "HV (kV/V)",
        "HV (A/kV)",
    ],
)
def test_the_scale_of_a_monitor_is_no_unit(tmp_path: Path, header: str) -> None:
    """Nobody knows whether the numbers are those of the monitor or have been scaled."""
    rows = [f"{0.02 * k:.2f},{k % 7},{k % 5}" for k in range(40)]
    (tmp_path / "r.csv").write_text("\n".join([f"time_s,{header},displacement_mm", *rows, ""]), encoding="utf-8")
    with pytest.raises(DataError, match=r'scale of a monitor, of which 1 stands for 1 kV, state it: "HV .*=kV"'):
        read_recording(tmp_path / "r.csv", input_column=header, input_unit="V")
    assert read_recording(tmp_path / "r.csv", input_column=f"{header}=kV", input_unit="V").inputs[0, 6] == 6e3
    found = read_recording(tmp_path / "r.csv", input_column=header)  # a NARX model takes any numbers
    assert found.inputs[0, 6] == 6.0 and found.input_units[0] not in ("V", "1")


def test_a_division_of_a_screen_is_not_what_one_stands_for(tmp_path: Path) -> None:
    rows = [f"{0.02 * k:.2f},{k % 7},{k % 5}" for k in range(40)]
    (tmp_path / "r.csv").write_text("\n".join(["time_s,HV (kV/div),y_mm", *rows, ""]), encoding="utf-8")
    with pytest.raises(DataError, match=r'is in kV/div, but the model needs it in V; .* "HV \(kV/div\)=UNIT"$'):
        read_recording(tmp_path / "r.csv", input_column="HV (kV/div)", output_column="y_mm", input_unit="V")


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("HV (kV) monitor", "HV monitor", "kV"),
        ("Position [um] of the edge", "Position of the edge", "um"),
        ("U (kV DC)", "U", "kV"),
        ("HV [kVDC]", "HV", "kV"),
        ("bridge (mV/V)", "bridge", "mV/V"),
        ("strain (um/m)", "strain", "um/m"),
        ("speed (m) per s", "speed (m) per s", ""),
        ("U (V rms)", "U", ""),
        ("HV (1:1000)", "HV", ""),
    ],
)
def test_units_beside_words(header: str, name: str, unit: str) -> None:
    assert split_unit(header) == (name, unit)
    assert unit or not header.endswith(")") or said_unit(header)


def test_a_ratio_in_a_header_is_no_volt(tmp_path: Path) -> None:
    rows = [f"{0.02 * k:.2f},{k % 7},{k % 5}" for k in range(40)]
    (tmp_path / "r.csv").write_text("\n".join(["time_s,HV (1:1000),displacement_mm", *rows, ""]), encoding="utf-8")
    with pytest.raises(DataError, match=r'is in 1:1000, but the model needs it in V.*"HV \(1:1000\)=UNIT"'):
        read_recording(tmp_path / "r.csv", input_column="#2", input_unit="V")


@pytest.mark.parametrize(
    ("header", "said"),
    [
        ("HV x1000 (V)", "x1000 V"),
        ("HV*1000 [V]", "*1000 V"),
        ("HV_V_x1000", "x1000 V"),
        ("U(V)*1000", "*1000 V"),
        ("HV/1000 (V)", "/1000 V"),
        ("U (V) 1/1000", "1/1000 V"),
        ("HV 1:1000 (V)", "1:1000 V"),
        ("Probe 1000X [V]", "1000X V"),
        ("1e3*U (V)", "1e3* V"),
        ("Monitor 1V/kV (V)", "1V/kV"),
        ("Monitor 1V=1kV", "1V=1kV"),
        ("HV 1 V ≙ 1 kV [V]", "1 V ≙ 1 kV"),
        ("Monitor 1 V -> 1 kV (V)", "1 V -> 1 kV"),
        ("HV_1kV_pro_V [V]", "1kV pro V"),
        ("HV_mon_1kV_per_V", "1kV per V"),
        ("HV2/1000 (V)", "/1000 V"),
        ("HV2 (V)/1000", "/1000 V"),
        ("Channel 2 (V)/1000", "/1000 V"),
        ("HV/1000 (V).1", "/1000 V"),
        ("HV (x1000) (V)", "x1000 V"),
        ("HV ÷1000 (V)", "÷1000 V"),
        ("U 5×10³ (V)", "×10³ V"),
    ],
)
def test_beside_a_factor_in_its_name_the_unit_of_a_column_is_to_be_stated(
    tmp_path: Path, header: str, said: str
) -> None:
    """Nobody knows whether the factor was applied to the numbers."""
    rows = [f"{0.02 * k:.2f},{k % 7},{k % 5}" for k in range(40)]
    (tmp_path / "r.csv").write_text("\n".join([f"time_s,{header},displacement_mm", *rows, ""]), encoding="utf-8")
    with pytest.raises(DataError, match=rf"is in {re.escape(said)}, but the model needs it in V; .*state"):
        read_recording(tmp_path / "r.csv", input_column="#2", input_unit="V")
    for unit, largest in (("V", 6.0), ("kV", 6e3)):
        assert read_recording(tmp_path / "r.csv", input_column=f"#2={unit}", input_unit="V").inputs[0, 6] == largest
    found = read_recording(tmp_path / "r.csv", input_column="#2")
    assert found.inputs[0, 6] == 6.0 and found.input_units == (said,)


@pytest.mark.parametrize(
    ("header", "unit"),
    [
        ("x10 (mm)", "mm"),
        ("pos x2 (mm)", "mm"),
        ("F at 5 mm/min (N)", "N"),
        ("C at 3 kV/mm (pF)", "pF"),
        ("CH1/2 (V)", "V"),
        ("T 10:15 (K)", "K"),
        ("2*pi*f (rad/s)", "rad/s"),
        ("sensor_100_mm", "mm"),
        ("Dev1/ai10 (V)", "V"),
        ("10kHz noise (V)", "V"),
        ("film 3×3 (mm)", "mm"),
        ("film 10 × 10 (N)", "N"),
        ("max100 (N)", "N"),
        ("pos_x (mm) 10", "mm"),
        ("1/10/2024 x (mm)", "mm"),
        ("12:10:1 (V)", "V"),
        ("sine 1/10 Hz (mm)", "mm"),
        ("ramp 500 V/s (mm)", "mm"),
        ("E = 60 V/µm (mm)", "mm"),
    ],
)
def test_not_every_number_in_a_name_is_a_factor(header: str, unit: str) -> None:
    assert split_unit(header)[1] == unit


@pytest.mark.parametrize(
    ("header", "unit", "newtons"),
    [("Force (g)", "gf", 9.80665e-3), ("Load [kg]", "kgf", 9.80665)],
)
def test_a_mass_may_be_said_to_be_its_weight(tmp_path: Path, header: str, unit: str, newtons: float) -> None:
    path = written(tmp_path, header)
    with pytest.raises(DataError, match=rf'state the unit that is meant: "{re.escape(header)}={unit}"'):
        read(path, header, "N")
    np.testing.assert_allclose(read(path, f"#3={unit}", "N")[2], newtons * np.array([1.0, 2.0, -3.0]), rtol=1e-14)
    with pytest.raises(DataError, match='is said to be in lbf; remove "=lbf"'):
        read(path, "#3=lbf", "N")


def test_a_sensitivity_gives_way_to_the_unit_that_a_user_states(tmp_path: Path) -> None:
    rows = [f"{0.02 * k:.2f},{k % 7},{k % 5}" for k in range(40)]
    (tmp_path / "r.csv").write_text("\n".join(["time_s,command_V,laser (mm/V)", *rows, ""]), encoding="utf-8")
    with pytest.raises(DataError, match=r'scale of a monitor, of which 1 stands for 1 mm, state it: .*=mm"'):
        read_recording(tmp_path / "r.csv", output_column="#3", output_unit="m")
    assert read_recording(tmp_path / "r.csv", output_column="#3=mm", output_unit="m").outputs[0, 4] == 4e-3


@pytest.mark.parametrize("header", ["DAC counts", "U_LSB", "pwm", "AO codes", "duty_cycle"])
def test_a_command_in_counts_is_no_voltage(tmp_path: Path, header: str) -> None:
    """A command without a unit is taken as it is, but not where its name says that it is no voltage."""
    rows = [f"{0.02 * k:.2f},{k % 7},{k % 5}" for k in range(40)]
    (tmp_path / "r.csv").write_text("\n".join([f"time_s,{header},displacement_mm", *rows, ""]), encoding="utf-8")
    with pytest.raises(DataError, match=f'multiply the numbers .* already, state it: "{header}=V"'):
        read_recording(tmp_path / "r.csv", input_column=header, input_unit="V")
    assert read_recording(tmp_path / "r.csv", input_column=f"{header}=V", input_unit="V").inputs[0, 4] == 4.0
    assert read_recording(tmp_path / "r.csv", input_column=header, input_unit="1").inputs[0, 4] == 4.0
