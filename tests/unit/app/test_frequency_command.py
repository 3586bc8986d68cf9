"""`deatwin frequency` on systems whose responses can be written down."""

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_narx import trained_on
from numpy.typing import NDArray

from deatwin.app import frequency_report
from deatwin.app.cli import main
from deatwin.app.frequency_report import write_responses
from deatwin.app.frequency_responses import respond
from deatwin.ident.frequency import gfrf
from deatwin.ident.frequency.output_responses.result import NofrfStatus
from deatwin.ident.narx import NarxModel, Reliance, ValidationStatus
from deatwin.studies.folder import ResultFolder

STEP = 0.1
PICTURES = ("frequency", "gfrf2", "gfrf3", "nofrf", "test_signal")
TABLES = ("frequency", "gfrf2", "gfrf3", "nofrf1", "nofrf2", "nofrf3", "test_signal")
FILES = {
    "report.html",
    "run.json",
    *(f"figures/{name}.svg" for name in PICTURES),
    *(f"figures/{name}.csv" for name in TABLES),
}


def model_of(equation: Mapping[str, float], centre: float = 0.0, **more: Any) -> NarxModel:
    """A model with a covariance of 1 % of each parameter, trained on inputs from -1 to 1 about a centre."""
    found = NarxModel.from_terms(equation, sample_time=STEP)
    trained = trained_on((centre - 1, centre + 1), (-9, 9), input_centre=centre)
    return replace(
        found,
        theta_cov=np.diag((0.01 * found.theta) ** 2),
        operating=trained,
        input_units=("V",),
        output_units=("m",),
        **more,
    )


SQUARE = {"y(k-1)": 0.6, "u(k)": 0.4, "u(k)^2": 0.1}
"""H_1 = 0.4 / A and H_2 = 0.1 / A at the sum of the frequencies, with A = 1 - 0.6 e^(-jwT); no third order."""


def one_by_a(frequency_Hz: NDArray[np.float64]) -> NDArray[np.complex128]:
    return np.asarray(1 / (1 - 0.6 * np.exp(-2j * np.pi * frequency_Hz * STEP)))


@pytest.fixture
def square(tmp_path, monkeypatch):
    """The model in a file, in the working folder."""
    monkeypatch.chdir(tmp_path)
    model_of(SQUARE, provenance={"excited_band_Hz": "1.0"}).save(tmp_path / "narx.json")
    return tmp_path


def files_of(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def table(path: Path) -> NDArray[Any]:
    return np.genfromtxt(path, delimiter=",", names=True)


def test_order_one_keeps_its_table(square, capsys):
    assert main(["frequency", "narx.json", "--out", "response"]) == 0
    found = table(square / "response/figures/frequency.csv")
    assert found.dtype.names is not None
    assert found.dtype.names[:7] == (
        "frequency_Hz",
        "real_m_per_V",
        "imaginary_m_per_V",
        "gain_m_per_V",
        "gain_low_m_per_V",
        "gain_high_m_per_V",
        "phase_deg",
    )
    expected = 0.4 * one_by_a(found["frequency_Hz"])
    np.testing.assert_allclose(found["real_m_per_V"] + 1j * found["imaginary_m_per_V"], expected, rtol=1e-12)
    # d ln H / d ln b = 1 and d ln H / d a = e^(-jwT) / A, each parameter known to 1 %
    turn = np.exp(-2j * np.pi * found["frequency_Hz"] * STEP)
    relative = 0.01 * np.hypot(1, (0.6 * turn * one_by_a(found["frequency_Hz"])).real)
    np.testing.assert_allclose(found["gain_high_m_per_V"] / found["gain_m_per_V"] - 1, 1.959964 * relative, rtol=1e-6)
    assert len(found) == 200 and found["frequency_Hz"][[0, -1]] == pytest.approx([0.005, 5.0])
    written = files_of(square / "response")
    assert written == {"figures/frequency.csv", "figures/frequency.svg", "report.html", "run.json"}
    assert "the operating point is stable" in capsys.readouterr().out


def test_all_orders(square, capsys, validate):
    assert main(["frequency", "narx.json", "--order", "3", "--out", "response"]) == 0
    folder = square / "response"
    assert files_of(folder) == FILES
    second, third = table(folder / "figures/gfrf2.csv"), table(folder / "figures/gfrf3.csv")
    expected = 0.1 * one_by_a(second["f1_Hz"] + second["f2_Hz"])
    np.testing.assert_allclose(second["real_m_per_V2"] + 1j * second["imaginary_m_per_V2"], expected, rtol=1e-12)
    assert second["f1_Hz"].max() == 1.0  # the band that the training data excited
    assert third["gain_m_per_V3"].max() == 0.0
    assert set(third["f3_Hz"]) == {0.5}
    # A Hammerstein system: G_n is H_n, which depends on the sum of the frequencies alone.
    for order, factor, unit in ((1, 0.4, "m_per_V"), (2, 0.1, "m_per_V2")):
        rows = table(folder / f"figures/nofrf{order}.csv")
        assert rows["frequency_Hz"].max() == pytest.approx(order) and f"truncation_{unit}" in rows.dtype.names
        found = rows[f"real_{unit}"] + 1j * rows[f"imaginary_{unit}"]
        np.testing.assert_allclose(found, factor * one_by_a(rows["frequency_Hz"]), rtol=1e-8)
    assert np.abs(table(folder / "figures/nofrf3.csv")["gain_m_per_V3"]).max() < 1e-9
    signal = table(folder / "figures/test_signal.csv")
    assert signal.dtype.names == ("time_s", "deviation_V", "input_V")
    assert signal["deviation_V"].max() == pytest.approx(1.0)  # up to the end of the training inputs
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert page.count("<figure>") == page.count("<svg ") == len(PICTURES)
    assert all(f'href="figures/{name}.csv"' in page for name in TABLES)
    assert set(validate("run", folder / "run.json")["outputs"]) == FILES
    said = capsys.readouterr().out
    assert (
        "an input from 0 to 1 Hz causes an output of order 2 only from 0 to 2 Hz" in said
        and "an input from 0 to 1 Hz causes an output of order 3 only from 0 to 3 Hz" in said
    )
    assert re.search(
        r"the NOFRFs of orders 1 to 3 come from a fit of orders 1 to \d+ to the outputs for test signals of up to 1 V \(condition "
        r"number of the fit: [\d.]+\); the test signal and its amplitudes suit the requested orders\n",
        said,
    )


@pytest.fixture
def two_inputs(tmp_path, monkeypatch):
    """H_1 = 0.4 / A and 0.2 / A, and the cross kernel 0.05 / A at the sum of the frequencies: half the product's weight."""
    monkeypatch.chdir(tmp_path)
    terms = {"y(k-1)": 0.6, "volts(k)": 0.4, "heat(k)": 0.2, "volts(k)heat(k)": 0.1}
    names = {"input_names": ("volts", "heat"), "input_units": ("V", "K"), "output_units": ("m",)}
    NarxModel.from_terms(terms, sample_time=STEP, theta_cov=1e-6 * np.eye(4), **names).save(tmp_path / "narx.json")
    return tmp_path


def test_several_inputs_have_responses_of_their_own_and_cross_kernels(two_inputs, capsys, monkeypatch):
    command = ["frequency", "narx.json", "--out", "response"]
    assert main([*command, "--order", "2"]) == 0
    tables = two_inputs / "response/figures"
    kernels = ["gfrf2_volts_volts", "gfrf2_volts_heat", "gfrf2_heat_heat"]
    stems = ["frequency_volts", "frequency_heat", *kernels]
    assert {path.name for path in tables.iterdir()} == {f"{name}.{end}" for name in stems for end in ("csv", "svg")}
    for name, gain, unit in (("volts", 0.4, "m_per_V"), ("heat", 0.2, "m_per_K")):
        found = table(tables / f"frequency_{name}.csv")
        expected = gain * one_by_a(found["frequency_Hz"])
        np.testing.assert_allclose(found[f"real_{unit}"] + 1j * found[f"imaginary_{unit}"], expected, rtol=1e-12)
    cross = table(tables / "gfrf2_volts_heat.csv")
    expected = 0.05 * one_by_a(cross["f1_Hz"] + cross["f2_Hz"])
    np.testing.assert_allclose(cross["real_m_per_V_K"] + 1j * cross["imaginary_m_per_V_K"], expected, rtol=1e-12)
    assert table(tables / "gfrf2_heat_heat.csv")["gain_m_per_K2"].max() == 0.0
    page = (two_inputs / "response/report.html").read_text(encoding="utf-8")
    assert "H₂(volts, heat)" in page and page.count("<figure>") == 5
    assert "operating input volts = 0 V, heat = 0 K" in capsys.readouterr().out
    # About other constant inputs, each product adds to the first order: 0.4 + 0.1 * 3 and 0.2 + 0.1 * 2.
    monkeypatch.setattr(frequency_report, "_drawings", lambda *_: iter(()))
    assert main([*command, "--json", "--operating-input", "2", "--operating-input", "3"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["inputs"], told["operating_input"], told["order"]) == (["volts", "heat"], [2.0, 3.0], 1)
    for response, gain in zip(told["responses"], (0.7, 0.4), strict=True):
        expected = np.abs(gain * one_by_a(np.array(response["frequency_Hz"])))
        np.testing.assert_allclose(response["gain"], expected, rtol=1e-12)
    assert not any(path.name.startswith("gfrf2") for path in tables.iterdir())


def test_a_second_run_leaves_nothing_of_the_first(square, monkeypatch):
    monkeypatch.setattr(frequency_report, "_drawings", lambda *_: iter(()))
    folder = square / "response"
    assert main(["frequency", "narx.json", "--order", "3", "--out", "response"]) == 0
    (folder / "figures/gfrf8.csv").write_text("somebody's own")  # no run has written it
    assert main(["frequency", "narx.json", "--out", "response"]) == 0
    assert files_of(folder) == {"figures/frequency.csv", "report.html", "run.json", "figures/gfrf8.csv"}


@pytest.mark.parametrize(
    ("units", "headers"),
    [
        (("V", "m"), ("gain_m_per_V", "gain_m_per_V2", "deviation_V")),
        (("1", "N"), ("gain_N", "gain_N", "deviation")),
        (("V", "1"), ("gain_per_V", "gain_per_V2", "deviation_V")),
        (("V", "m/s"), ("gain_m_per_s_per_V", "gain_m_per_s_per_V2", "deviation_V")),
        (("", ""), ("gain", "gain", "deviation")),
    ],
)
def test_headers_have_their_units(units, headers, tmp_path, monkeypatch):
    monkeypatch.setattr(frequency_report, "_drawings", lambda *_: iter(()))
    found = respond(replace(model_of(SQUARE), input_units=units[:1], output_units=units[1:]), 2, amplitude=0.1)
    write_responses(found, ResultFolder(tmp_path))
    for name, header in zip(("frequency", "gfrf2", "test_signal"), headers, strict=True):
        assert header in (tmp_path / f"figures/{name}.csv").read_text(encoding="utf-8").splitlines()[0].split(",")


def test_json_tells_all(square, capsys, monkeypatch):
    monkeypatch.setattr(frequency_report, "_drawings", lambda *_: iter(()))  # other tests draw
    options = ["--operating-input", "0.2", "--level", "0.9", "--band", "0.5", "0.8", "--out", "response", "--json"]
    assert main(["frequency", "narx.json", *options]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["unit"] == "m/V"
    assert found["operating_input"] == 0.2 and found["stable"] and found["band_Hz"] == [0.5, 0.8]
    assert found["equilibria"] == pytest.approx([(0.4 * 0.2 + 0.1 * 0.2**2) / 0.4])
    # Expanded about 0.2 V the square adds 2 * 0.1 * 0.2 to the gain; 90 % are 1.645 deviations.
    expected = 0.44 * one_by_a(np.array(found["frequency_Hz"]))
    np.testing.assert_allclose(np.array(found["real"]) + 1j * np.array(found["imaginary"]), expected, rtol=1e-12)
    first = table(square / "response/figures/frequency.csv")
    assert first["frequency_Hz"][[0, -1]] == pytest.approx([0.5, 0.8])  # the band that was asked for
    wider = gfrf(model_of(SQUARE), 1, 2 * np.pi * first["frequency_Hz"], operating_input=0.2).band(0.95)
    gain, high = first["gain_m_per_V"], first["gain_high_m_per_V"]
    np.testing.assert_allclose((high - gain) / (wider.high - gain), 1.644854 / 1.959964, rtol=1e-6)


def test_nofrfs_as_plain_data():
    found = respond(model_of(SQUARE), 2, band_Hz=(0.5, 0.8), amplitude=0.3).to_json()
    np.testing.assert_allclose(found["output_ranges_Hz"][1], [[0.0, 0.3], [1.0, 1.6]], atol=1e-12)
    nofrfs = found["nofrf"]
    assert nofrfs["status"] == "ok" and nofrfs["amplitude"] == 0.3 and nofrfs["largest_residual"] < 1e-10
    json.dumps(found, allow_nan=False)


def test_amplitude_is_lowered_where_further_orders_act():
    model = model_of({"y(k-1)": 0.8, "u(k)": 0.2, "y(k-1)u(k)": 0.3})
    lowered, asked = respond(model, 3, band_Hz=(0, 0.3)), respond(model, 3, band_Hz=(0, 0.3), amplitude=1.0)
    assert lowered.nofrfs is not None and lowered.nofrfs.status is NofrfStatus.OK
    assert lowered.signal is not None and 0.3 < lowered.signal.amplitude < 1.0
    assert asked.nofrfs is not None and asked.nofrfs.status is NofrfStatus.TRUNCATED
    assert asked.signal is not None and asked.signal.amplitude == 1.0
    assert any("orders that were not fitted act" in line for line in asked.lines)


def test_a_gain_is_drawn_in_a_unit_with_a_prefix():
    first = respond(model_of({"y(k-1)": 0.5, "u(k)": 4e-5}), 1).first
    shown, size = frequency_report._for_reading(first)
    assert (shown.unit, size) == ("µm/V", 1e-6)
    np.testing.assert_allclose(shown.gain, 1e6 * first.gain)
    np.testing.assert_allclose(shown.band().high, 1e6 * first.band().high)
    alike = replace(first, unit="m/m")
    assert frequency_report._for_reading(alike)[0].unit == "m/m"


def test_what_fails_is_said_plainly():
    unstable = {"y(k-1)": 1.2, "u(k)": 0.4, "y(k-1)^3": -0.3}  # rests at 0, and at +- sqrt(2/3), which is stable
    said = " / ".join(respond(model_of(unstable), 2).lines)
    assert "the operating point is unstable" in said
    assert "the outputs -816 mm (stable), 0 m (unstable) and 816 mm (stable); the responses hold only for the" in said
    wild = replace(model_of(SQUARE), theta_cov=np.diag([0.0, 0.04, 0.0]))  # H_1 is known to 50 %
    assert "the band of H₁ is unreliable at 100 % of the frequencies" in " / ".join(respond(wild, 1).lines)
    unknown = replace(model_of(SQUARE), operating=None)
    found = respond(unknown, 2)
    assert found.nofrfs is None and "does not state the range of its training inputs" in found.missing
    assert found.band_Hz == (0.0, 1.25)  # a quarter of half the sampling rate


def test_the_page_shows_what_fails(tmp_path, monkeypatch):
    monkeypatch.setattr(frequency_report, "_drawings", lambda *_: iter(()))
    found = respond(replace(model_of(SQUARE), theta_cov=np.diag([0.0, 0.04, 0.0])), 1)
    write_responses(replace(found, missing="for a reason"), ResultFolder(tmp_path))
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert (
        'class="verdict bad"' in page
        and "1\xa0of\xa03 goals" in page
        and "No NOFRFs were computed: for a reason." in page
    )


@pytest.mark.parametrize("known", [True, False])
def test_only_a_model_with_a_covariance_has_bands(tmp_path, known):
    model = model_of(SQUARE, provenance={"excited_band_Hz": "1.0"})
    found = respond(
        model if known else replace(model, theta_cov=np.zeros((3, 3))), 2, operating_input=1.0, amplitude=0.1
    )
    write_responses(found, ResultFolder(tmp_path))
    page = (tmp_path / "report.html").read_text(encoding="utf-8").replace("\xa0", " ")
    assert ("95 % band" in page) is ("four times" in page) is ("include the error of extrapolation" in page) is known
    assert ("no covariance" in page) is not known


def test_the_next_step_names_check_only_for_a_model_that_check_takes(two_inputs, monkeypatch):
    monkeypatch.setattr(frequency_report, "_drawings", lambda *_: iter(()))
    assert main(["frequency", "narx.json", "--out", "response"]) == 0
    page = (two_inputs / "response/report.html").read_text(encoding="utf-8")
    assert "use the responses at this operating point." in page
    single = respond(model_of(SQUARE), 1)
    write_responses(single, ResultFolder(two_inputs / "single"))
    page = (two_inputs / "single/report.html").read_text(encoding="utf-8")
    assert (
        "use the responses at this operating point, for example to design a controller (<code>deatwin check</code>)."
        in page
    )


@pytest.mark.parametrize(
    ("known", "said"),
    [
        (Reliance(status=ValidationStatus.PASSED), "none"),
        (Reliance(status=ValidationStatus.NOISE, failed=("ee",)), "1 failed test (ee)"),
        (
            Reliance(
                status=ValidationStatus.STRUCTURE,
                failed=("ee", "ue", "u2e", "u2e2"),
                gain_error=0.2,
                gain_error_half_width=0.1,
            ),
            "4 failed tests (ee, ue, u2e, u2e2), a biased gain",
        ),
        (Reliance(status=ValidationStatus.STRUCTURE), "residual tests, as stated above"),  # a file without their names
        (Reliance(status=None, samples_per_parameter=2.0), "not tested, the remarks above"),
        (Reliance(status=ValidationStatus.DIVERGED), "the free run diverged"),
    ],
)
def test_the_page_counts_the_residual_tests_that_failed(known, said):
    row = frequency_report._reliance(known)
    assert (row.reached, row.passed) == (said, said == "none")


def test_it_says_where_ellipses_do_not_describe_a_response():
    """y(k) = a y(k-1) + u(k-1) with a = 0.9 ± 0.05: near rest the gain 1/(1 - a) is far from linear in a."""
    model = NarxModel.from_terms({"y(k-1)": 0.9, "u(k-1)": 1.0}, sample_time=0.1, theta_cov=np.diag([0.05**2, 0.0]))
    assert any(line.startswith("H₁: ") and "not linear in the parameters" in line for line in respond(model, 1).lines)
    known = replace(model, theta_cov=1e-4 * model.theta_cov)
    assert not any("not linear" in line for line in respond(known, 1).lines)
