"""Which unit a header names."""

from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy import constants

from deatwin.plant import read_recording
from deatwin.plant.files.headers import said_unit, split_unit
from deatwin.plant.files.units import UNITS, find_unit


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("displacement_mm", "displacement", "mm"),
        ("U (in kV)", "U", "kV"),
        ("HV (kV).1", "HV.1", "kV"),
        ("HV [kV]#2", "HV#2", "kV"),
        ("x(mm)2", "x2", "mm"),
        ("Model/HV[kV]/Value", "Model/HV/Value", "kV"),
        ("F (N)/m", "F (N)/m", ""),
        ("V(in)_1", "V(in)_1", ""),
        ("HV (kV)/1000", "HV/1000", ""),
        ("U [in Volts]", "U", "V"),
        ("p (in Hg)", "p", "inHg"),
        ("torque (in lbf)", "torque", "inch lbf"),
        ("p {mbar}", "p", "mbar"),
        ("p <mbar>", "p", "mbar"),
        ("x【mm】", "x", "mm"),
        ("101 <HV>", "101 <HV>", ""),
        ("HV kV", "HV", "kV"),
        ("Weg µm", "Weg", "um"),
        ("Temperatur °C", "Temperatur", "°C"),
        ("Film 0.5 mm", "Film 0.5 mm", ""),
        ("HV1 kV", "HV1", "kV"),
        ("disp_10 Hz", "disp_10 Hz", ""),
        ("disp f=10 Hz", "disp f=10 Hz", ""),
        ("x-5 kV", "x-5 kV", ""),
        ("Phase V", "Phase V", ""),
        ("Pos min", "Pos min", ""),
        ("Flow meter", "Flow meter", ""),
        ("U (kVolt)", "U", "kV"),
        ("I (mAmps)", "I", "mA"),
        ("acc (mg)", "acc", "mgn"),
        ("Force [N]", "Force", "N"),
        ("U (kV)", "U", "kV"),
        ("U_cmd (kV)", "U_cmd", "kV"),
        ("x_pos_2[µm]", "x_pos_2", "um"),
        ("t_rel (ms)", "t_rel", "ms"),
        ("x_mm (V)", "x_mm", "V"),
        ("film_voltage", "film_voltage", ""),
        ("command_MV", "command_MV", ""),
        ("x_left (left)", "x_left", ""),
        ("gain (V)_mm", "gain (V)", "mm"),
        ("mm", "mm", ""),
        ("U/mV", "U", "mV"),
        ("U_cmd / kV", "U_cmd", "kV"),
        ("t/s", "t", "s"),
        ("Zeit/s", "Zeit", "s"),
        ("s/mm", "s", "mm"),  # a way, because seconds per millimetre are no quantity
        ("F/mN", "F", "mN"),
        ("h / µm", "h", "um"),
        ("C/pF", "C", "pF"),
        ("m/V", "m/V", ""),
        ("K/W", "K/W", ""),
        ("Zeit / ms", "Zeit", "ms"),
        ("Temps/s", "Temps", "s"),
        ("mm/s", "mm/s", ""),
        ("x/s", "x/s", ""),
        ("N/m", "N/m", ""),
        ("rad/m", "rad/m", ""),
        ("v_m/s", "v", "m/s"),
        ("U in mV", "U", "mV"),
        ("Weg 2 in µm", "Weg 2", "um"),
        ("U (Volt)", "U", "V"),
        ("U [Kilovolts]", "U", "kV"),
        ("Weg in Millimeter", "Weg", "mm"),
        ("t (seconds)", "t", "s"),
        ("gap [micron]", "gap", "um"),
        ("T (Celsius)", "T", "°C"),
        ("charge (C)", "charge", "coulomb"),
        ("Q_C", "Q", "coulomb"),
        ("q1 in C", "q1", "coulomb"),
        ("electric charge [C]", "electric charge", "coulomb"),
        ("charge air temperature (C)", "charge air temperature", "°C"),
        ("temp_C", "temp", "°C"),
        ("T_film (C)", "T_film", "°C"),
        ("Tamb/C", "Tamb", "°C"),
        ("film (C)", "film", "°C"),
        ("x (C)", "x", "C"),
        ("repair (C)", "repair", "C"),
        ("x (degC)", "x", "°C"),
        ("x (Coulomb)", "x", "coulomb"),
        ("x_millimeters", "x", "mm"),
        ("run in air", "run in air", ""),
        ("m/s/s", "m/s/s", ""),
        ("1/m", "1/m", ""),
        ("field_kV_mm", "field", "kV/mm"),
        ("field_V_per_um", "field", "V/um"),
        ("flow_ml_min", "flow", "ml/min"),
        ("force_N_m", "force_N_m", ""),
        ("load_F", "load_F", ""),
        ("Position (L)", "Position", ""),
        ("temperature (F)", "temperature", "°F"),
        ("charge (µC)", "charge", "uC"),
        ("Extension (in)", "Extension", "inch"),
        ("gap [mils]", "gap", "mil"),
        ("v_in_per_s", "v", "inch/s"),
        ("v [in/s]", "v", "inch/s"),
        ("u_in", "u_in", ""),
        ("time_in_s", "time_in", "s"),
        ("disp_mm_in", "disp_mm_in", ""),
        ("gain_kp", "gain_kp", ""),
        ("left_foot", "left_foot", ""),
        ("n_turns", "n_turns", ""),
        ("Pos, in mm", "Pos", "mm"),
        ("strain (mm/mm)", "strain", "mm/mm"),
        ("c_Ns/m", "c", "N s/m"),
        ("impulse_Ns", "impulse", "N s"),
        ("Timestamp_Ns", "Timestamp", "ns"),
        ("pos_min", "pos_min", ""),
        ("pos_h", "pos_h", ""),
        ("t_min", "t", "min"),
        ("Elapsed hours", "Elapsed", "h"),
        ("Timestamp/min", "Timestamp", "min"),
        ("Messzeit/s", "Messzeit", "s"),
        ("events/s", "events/s", ""),
        ("run time min", "run time", "min"),
        ("timeline", "timeline", ""),
        ("[s]", "[s]", "s"),
        ("in s", "in s", "s"),
        ("in air", "in air", ""),
        ("HV - kV", "HV", "kV"),
        ("HV-kV", "HV", "kV"),
        ("laser.um", "laser", "um"),
        ("laser@µm", "laser", "um"),
        ("phase-A", "phase-A", ""),
        ("node.V", "node.V", ""),
        ("sensor 5-mm", "sensor 5-mm", ""),
        ("U..kV.", "U", "kV"),
        ("Laser.dist..mm.", "Laser.dist", "mm"),
        ("U_kV_", "U", "kV"),
        ("HV_mon_mV_", "HV_mon", "mV"),
        ("x__m_", "x__m_", ""),
        ("y_min_", "y_min_", ""),
        ("[kV] HV", "HV", "kV"),
        ("(µm) Weg 2", "Weg 2", "um"),
        ("(A) Weg", "(A) Weg", ""),
        ("(in) Druck", "(in) Druck", ""),
        ("kV set", "set", "kV"),
        ("mm Hg", "mm Hg", ""),
        ("kV monitor", "kV monitor", ""),
        ("mV per step", "mV per step", ""),
        ("Напряжение, кВ", "Напряжение", "kV"),
        ("Перемещение (мкм)", "Перемещение", "um"),
        ("P [МПа]", "P", "MPa"),
        ("位移（毫米）", "位移", "mm"),
        ("电压/千伏", "电压", "kV"),
        ("変位(マイクロメートル)", "変位", "um"),
        ("Vib [ pm ]", "Vib", "pm"),
        ("Vf (V vs. Ref.)", "Vf", "V"),
        ("y (Âµm)", "y", "um"),
        ("y (Î¼m)", "y", "um"),
        ("y (µ\u200bm)", "y", "um"),
        ("y (_m)", "y", ""),
        (r"$U$ / \si{\kilo\volt}", "U", "kV"),
        (r"x in \unit{\um}", "x", "um"),
        (r"x [$\mu$m]", "x", "um"),
        (r"T / \si{\degreeCelsius}", "T", "°C"),
        (r"a (\si{\milli\metre\per\second\squared})", "a", "mm/s2"),
        (r"E [\si{\kilo\volt\per\milli\metre}]", "E", "kV/mm"),
        ("<I>/mA", "<I>", "mA"),
        ("|Z|/ohm", "|Z|", "ohm"),
        ("U_kV_set", "U_set", "kV"),
        ("laser_mm_2", "laser_2", "mm"),
        ("kV_set", "set", "kV"),
        ("x_10_mm_left", "x_10_mm_left", ""),
        ("x_mm_rate", "x_mm_rate", ""),
        ("mm_rate", "mm_rate", ""),
        ("U_kV_pp", "U_kV_pp", ""),
        ("mV_per_kV_1", "mV_per_kV_1", ""),
        ("psi_ref", "psi_ref", ""),
        ("MV_Temp", "MV_Temp", ""),
        ("U_kVpp", "U_kVpp", ""),
        ("CH1mV", "CH1", "mV"),
        ("Ch 2mm", "Ch 2", "mm"),
        ("x10mm", "x10mm", ""),
        ("y_mm(:,2)", "y(:,2)", "mm"),
        ("U(:,2)", "U(:,2)", ""),
        ("Voltage kilovolts", "Voltage", "kV"),
        ("Laser distance microns", "Laser distance", "um"),
        ("wheel turns", "wheel turns", ""),
        ("U кВ", "U", "kV"),
        ("x мкм", "x", "um"),
        ("HV〔kV〕", "HV", "kV"),
        ("Disp. [µm] (laser 1)", "Disp. (laser 1)", "um"),
        ("U (V) (Dev1/ai0)", "U (Dev1/ai0)", "V"),
        ("U (V) (x10)", "U (V)", ""),
        ("U (V) (gain 10)", "U (V)", ""),
        ("U (V) gain 1000", "U gain 1000", ""),
        ("disp_mm_div10", "disp_div10", ""),
    ],
)
def test_the_unit_is_read_off_the_usual_forms(header: str, name: str, unit: str) -> None:
    assert split_unit(header) == (name, unit)


@pytest.mark.parametrize("form", ["{}_{}", "{} ({})", "{}[{}]", "{} in {}"])
def test_any_name_keeps_its_unit(form: str) -> None:
    # Forces and lengths end in F and l, gains in kp, demands in dm, wanted values in yd, and Greek letters in ksi;
    # behind an underscore, minima end in min, and heights in h.
    ends_names = {*"F l dm ft yd kp dyn kip ksi".split()} if form in ("{}_{}", "{} in {}") else set()
    ends_names |= {"min", "h"} if form == "{}_{}" else set()
    for name, unit in product(["U", "U_cmd", "Weg 2", "a_b_c", "电压_x"], set(UNITS) - {""} - ends_names):
        assert split_unit(form.format(name, unit)) == (name, unit)


@pytest.mark.parametrize(
    ("unit", "si", "value"),
    [
        ("bar", "Pa", constants.bar),
        ("mbar", "Pa", constants.bar / 1e3),
        ("psi", "Pa", constants.psi),
        ("kPa", "Pa", constants.kilo),
        ("hPa", "Pa", constants.hecto),
        ("lbf", "N", constants.lbf),
        ("deg", "rad", constants.degree),
        ("rpm", "rad/s", 2 * constants.pi / constants.minute),
        ("rev/s", "rad/s", 2 * constants.pi),
        ("deg/s", "rad/s", constants.degree),
        ("gn", "m/s2", constants.g),
        ("km/h", "m/s", constants.kmh),
        ("g", "kg", constants.gram),
        ("kHz", "Hz", constants.kilo),
        ("mN m", "N m", constants.milli),
        ("uA", "A", constants.micro),
        ("kV", "V", constants.kilo),
        ("kV/mm", "V/m", constants.mega),
        ("1/min", "1/s", 1 / constants.minute),
        ("%", "1", 0.01),
        ("uC", "C", constants.micro),
        ("pC", "C", constants.pico),
        ("mA h", "C", constants.milli * constants.hour),
        ("nF", "F", constants.nano),
        ("Gohm", "ohm", constants.giga),
        ("mgf", "N", constants.milli * constants.gram * constants.g),
        ("kgf", "N", constants.kgf),
        ("Torr", "Pa", constants.torr),
        ("atm", "Pa", constants.atm),
        ("mmHg", "Pa", 13595.1 * constants.g * constants.milli),
        ("inHg", "Pa", 13595.1 * constants.g * constants.inch),
        ("cmH2O", "Pa", 1000 * constants.g * constants.centi),
        ("kgf/cm2", "Pa", constants.kgf / constants.centi**2),
        ("N/mm2", "Pa", constants.mega),
        ("MV/m", "V/m", constants.mega),
        ("V/um", "V/m", constants.mega),
        ("kV/cm", "V/m", constants.kilo / constants.centi),
        ("ml/min", "m3/s", constants.milli * constants.liter / constants.minute),
        ("uC/cm2", "C/m2", constants.micro / constants.centi**2),
        ("um/m", "1", constants.micro),
        ("inch", "m", constants.inch),
        ("uinch", "m", constants.inch / 1e6),
        ("mil", "m", constants.mil),
        ("ft", "m", constants.foot),
        ("yd", "m", constants.yard),
        ("angstrom", "m", constants.angstrom),
        ("dm", "m", constants.deci),
        ("arcmin", "rad", constants.arcmin),
        ("arcsec", "rad", constants.arcsec),
        ("kp", "N", constants.kgf),
        ("dyn", "N", constants.dyn),
        ("ozf", "N", constants.lbf / 16),
        ("kip", "N", constants.kilo * constants.lbf),
        ("ksi", "Pa", constants.kilo * constants.psi),
        ("mph", "m/s", constants.mph),
        ("lbf/inch", "N/m", constants.lbf / constants.inch),
        ("inch lbf", "N m", constants.lbf * constants.inch),
        ("mW h", "J", constants.milli * constants.hour),
    ],
)
def test_factors_are_those_of_scipy(unit: str, si: str, value: float) -> None:
    assert UNITS[unit].si == si
    np.testing.assert_allclose(UNITS[unit].to_si(np.array(1.0)), value, rtol=1e-14)


def test_temperatures_are_shifted_and_their_differences_are_not() -> None:
    celsius = np.array([-40.0, 0.0, 25.0])
    kelvin = constants.convert_temperature(celsius, "Celsius", "Kelvin")
    for header in ("T (°C)", "T_degC", "T [℃]", "air in C", "T (Celsius)"):
        np.testing.assert_allclose(UNITS[split_unit(header)[1]].to_si(celsius), kelvin, rtol=1e-14)
    fahrenheit = constants.convert_temperature(celsius, "Celsius", "Fahrenheit")
    np.testing.assert_allclose(UNITS[split_unit("T (degF)")[1]].to_si(fahrenheit), kelvin, rtol=1e-14)
    behind = (
        "T_diff_C|Tdiff_C|Tdiff (°C)|Temp diff (°C)|temp_error_C|temperature_change_C|temperature drop (degC)|T_delta_C"
    )
    alone = (
        "dT (°C)|ΔT (°C)|T (Δ°C)|temperature difference (C)|temperature rise (degC)|superheat (°C)|overtemperature (°C)"
    )
    less = "T1-T2 (°C)|T_in - T_out (°C)|T - T_ref (°C)|Tin-Tout (°C)|T_hot minus T_cold (°C)|Temp1 - Temp2 (°C)"
    more = "change in temperature (°C)|tempDiff (°C)|Temperaturdifferenz (°C)|control error (°C)|subcooling (°C)"
    for header in "|".join((behind, alone, less, more)).split("|"):
        unit = UNITS[split_unit(header)[1]]
        assert unit.si == "K"
        np.testing.assert_array_equal(unit.to_si(celsius), celsius)


@pytest.mark.parametrize(
    "name",
    "T-Tank|T-1|T_air|room-temp|phase change material|diffuser temperature|superheated steam|overtemperature limit|"
    "heat exchanger temp|raindrop temp|T_sunrise|temp_device|temp_mirror|air-temperature|drop tube temperature".split(
        "|"
    ),
)
def test_a_temperature_whose_name_is_like_that_of_a_difference_is_shifted(name: str) -> None:
    assert split_unit(f"{name} (°C)") == (name, "°C")


@pytest.mark.parametrize(
    ("spelt", "unit"),
    [
        (spelt, unit)
        for unit, spellings in {
            "N m": "Nm N·m N*m N.m N-m N⋅m Newton-meter",
            "mN m": "mNm mN·m mN*m",
            "m/s2": "m/s^2 m/s² m/s**2 m/s/s m·s⁻²",
            "rad/s": "rad/sec rad·s⁻¹ rad*s^-1 rads/s",
            "deg/s": "°/s deg/sec",
            "rpm": "RPM rev/min r/min",
            "1/s": "s⁻¹ s^-1 /s",
            "um": "Mikrometer micromètres ㎛ µm μm",
            "uA": "µA μA",
            "ms": "Millisekunden millisecondes milisegundos ミリ秒 毫秒 ㎳",
            "kV": "ｋＶ ㎸",
            "°C": "°C ºC ℃ degC degree_Celsius Celsius",
            "Δ°C": "delta_degC Δ°C",
            "coulomb": "Coulomb coulombs",
            "ohm": "Ω Ohm",
            "kohm": "kΩ",
            "Hz": "hz Hertz",
            "uC": "µC microcoulomb microCoulombs",
            "mA h": "mAh mA·h",
            "Gohm": "GΩ GOhm",
            "mmHg": "mm-Hg",
            "inHg": "in-Hg",
            "inch": "in in. Inches",
            "mil": "mils thou",
            "ft": "foot feet FT",
            "angstrom": "Å \u212b",
            "uinch": "uin µin",
            "psi": "PSI psig",
            "rev": "turns revs",
            "l/min": "L/min liters/min l·min⁻¹",
            "V/um": "V/µm volt/micron V·µm⁻¹",
            "N/mm2": "N/mm² N·mm^-2",
            "V": "VDC Volts",
            "h": "hrs Hours Stunden",
            "s": "sec. Sek. Sekunden secondes segundos 秒",
            "": "L V/A x/y counts l/l/V sqm",
        }.items()
        for spelt in spellings.split()
    ],
)
def test_spellings(spelt: str, unit: str) -> None:
    assert find_unit(spelt) == find_unit(f"({spelt})") == unit


def test_the_voltage_of_a_node_is_in_no_inches() -> None:
    """Names of circuit simulators, where brackets hold a node or a part."""
    for header in ("V(in)", "v(m)", "I(s)", "i(l)"):
        assert split_unit(header) == (header, "") and said_unit(header) == ""
    assert split_unit("V(mV)") == ("V", "mV") and split_unit("I(A)") == ("I", "A")
    assert split_unit("V (ml)") == ("V", "ml") and split_unit("Vin(in)") == ("Vin", "inch")


@pytest.mark.parametrize(
    ("written", "unit"),
    [
        *((one, "mm") for one in ("10^-3 m", "10^{-3} m", "10^(-3)·m", "10**-3 m", "10⁻³ m", "10−3 m", "×10^-3 m")),
        ("10^3 V", "kV"),
        ("10³V", "kV"),
        ("10^-6 m/s", "um/s"),
        ("10^-2 m", "cm"),
        ("10^-5 m", ""),  # without a prefix
        ("10^-3 in", ""),  # no minute
        ("10^-3 m^2", ""),  # (mm)² would be a millionth
        ("10^-3 °C", ""),
        ("10^-3 counts", ""),
        ("10 m", ""),
    ],
)
def test_a_power_of_ten_is_a_prefix(written: str, unit: str) -> None:
    assert find_unit(written) == find_unit(f"[{written}]") == unit
    if unit:
        assert split_unit(f"Weg [{written}]") == ("Weg", unit)


def test_a_reading_with_its_unit_is_no_power_of_ten() -> None:
    assert (find_unit("1e-3 m"), find_unit("(1e-3 m)"), find_unit("(1E-3 m)")) == ("", "mm", "mm")


def test_a_column_in_a_power_of_ten_is_converted(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "time (s),command (V),displacement (10^-3 m)\n" + "".join(f"{k / 10},{k % 3},{k % 5}\n" for k in range(30))
    )
    record = read_recording(tmp_path / "a.csv")
    assert record.output_units == ("m",) and record.output_names == ("displacement",)
    assert record.outputs[0, :5].tolist() == [0.0, 0.001, 0.002, 0.003, 0.004]


def test_a_scale_is_no_unit() -> None:
    assert find_unit("1 V/mm") == find_unit("(1 N)") == ""
    assert find_unit("1/mm") == "1/mm"


@pytest.mark.parametrize(
    "cell",
    [
        "10^3" + " " * 20_000 + "5",
        "(10^" + "9" * 5000 + " m)",
        "(" + "10^1x" * 2000 + " m)",
        "(10⁻" + "³" * 5000 + " m)",
    ],
    ids=["blanks", "digits", "powers", "superscripts"],
)
def test_a_long_cell_with_a_power_of_ten_names_no_unit(cell: str) -> None:
    assert find_unit(cell) == ""


@pytest.mark.parametrize(
    ("said", "unit"),
    [
        *(("barg", "bar"), ("bara", "bar"), ("mbar(g)", "mbar"), ("kPa abs", "kPa"), ("kPag", "kPa"), ("PSIA", "psi")),
        *(("psi gauge", "psi"), ("bar (a)", "bar"), ("[bar abs]", "bar"), ("deg. C", "°C"), ("bag", ""), ("mV a", "")),
    ],
)
def test_pressures_above_a_vacuum_or_above_the_air(said: str, unit: str) -> None:
    """The letter says from where a pressure counts, not its size."""
    assert find_unit(said) == unit
