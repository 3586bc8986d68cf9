"""Data sheets, rounding, and what the chain makes of commands and readings."""

import json
from dataclasses import asdict, fields, replace

import numpy as np
import pytest

from deatwin.plant.chain import MeasuringChain
from deatwin.plant.datasheets import ANALOGUE_INPUT, HV_AMPLIFIER, LK_G152, NI_9264, quantise
from deatwin.plant.errors import DataError
from deatwin.plant.rigs.diaphragm import Diaphragm

CHAIN = MeasuringChain()
PROMPT = replace(CHAIN, laser=replace(LK_G152, scan_time=0.0))
"""Without lag, so that what is recorded can be compared sample by sample."""


class TestQuantise:
    def test_nearest_multiple(self) -> None:
        np.testing.assert_allclose(quantise([0.14, -0.14, 0.16, 7.0], 0.1), [0.1, -0.1, 0.2, 7.0], rtol=1e-15)

    def test_no_step_changes_nothing_and_nan_stays(self) -> None:
        np.testing.assert_array_equal(quantise([0.123, np.nan], 0.0), [0.123, np.nan])
        np.testing.assert_array_equal(quantise([np.nan], 0.1), [np.nan])


class TestDataSheets:
    def test_values_and_what_they_imply(self) -> None:
        assert NI_9264.step == pytest.approx(21.0 / 65536)  # nominal ±10.5 V in 16 bits
        assert HV_AMPLIFIER.gain == pytest.approx(800.0)  # 12 kV for 15 V
        assert Diaphragm().gain == pytest.approx(HV_AMPLIFIER.gain)  # the rig of the thesis has the same amplifier
        assert LK_G152.lag == pytest.approx(1.6e-3)  # half of sixteen exposures of 200 µs
        assert CHAIN.reading_step == pytest.approx(80e-3 / 65536)  # ±40 mm in 16 bits
        assert CHAIN.command_limit == 10.0 > 3.75

    @pytest.mark.parametrize("part", [NI_9264, HV_AMPLIFIER, LK_G152, ANALOGUE_INPUT], ids=lambda p: p.name)
    def test_each_part_names_its_source_and_what_is_unconfirmed(self, part: object) -> None:
        assert part.source
        assert set(part.unconfirmed) <= {f.name for f in fields(part)}

    @pytest.mark.parametrize(
        ("part", "fault", "message"),
        [
            (NI_9264, {"bits": 0}, "NI-9264: 0 bits"),
            (NI_9264, {"limit": 11.0}, "limit <= full scale"),
            (NI_9264, {"noise": -1.0}, "noise >= 0"),
            (HV_AMPLIFIER, {"input_full_scale": 0.0}, "both must be above 0"),
            (LK_G152, {"reach": 0.0}, "reach and output must be above 0"),
            (LK_G152, {"noise": np.nan}, "at least 0"),
            (LK_G152, {"averages": 0}, "0 averages"),
            (LK_G152, {"averages": 2.5}, "averages is 2.5; it must be a whole number"),
            (LK_G152, {"reach": "far"}, "reach is 'far'; it must be a number"),
            (HV_AMPLIFIER, {"output_full_scale": None}, "output_full_scale is None; it must be a number"),
            (NI_9264, {"bits": True}, "bits is True; it must be a whole number"),
            (NI_9264, {"noise": np.inf}, "noise >= 0"),
            (NI_9264, {"name": 3}, "name is 3; it must be text"),
        ],
    )
    def test_faults(self, part: object, fault: dict[str, float], message: str) -> None:
        with pytest.raises(DataError, match=message):
            replace(part, **fault)

    def test_survives_a_file(self) -> None:
        chain = replace(CHAIN, laser=replace(LK_G152, noise=1e-6))
        assert MeasuringChain.from_dict(json.loads(json.dumps(asdict(chain)))) == chain

    @pytest.mark.parametrize("lost", ["laser", "amplifier"])
    def test_a_file_without_a_part_is_refused(self, lost: str) -> None:
        data = asdict(CHAIN)
        del data[lost]
        with pytest.raises(DataError, match="malformed measuring chain"):
            MeasuringChain.from_dict(data)


class TestApplied:
    def test_commands_are_codes_and_near(self) -> None:
        wished = np.random.default_rng(2).uniform(-10.0, 10.0, (1, 5000))
        applied = CHAIN.applied(wished)
        codes = applied / NI_9264.step
        assert applied.shape == wished.shape
        np.testing.assert_allclose(codes, np.rint(codes), atol=1e-9)
        assert np.abs(applied - wished).max() <= 0.5 * NI_9264.step * (1.0 + 1e-9)
        np.testing.assert_array_equal(CHAIN.applied(applied), applied)

    def test_rest_is_rest(self) -> None:
        assert CHAIN.applied([0.0])[0] == 0.0

    @pytest.mark.parametrize("wrong", [10.1, -10.1, np.nan])
    def test_what_cannot_be_given_is_refused(self, wrong: float) -> None:
        with pytest.raises(DataError, match=r"command 2: .* take -10 to 10 V"):
            CHAIN.applied([1.0, 2.0, wrong, 11.0])

    def test_a_smaller_amplifier_limits_too(self) -> None:
        chain = replace(CHAIN, amplifier=replace(HV_AMPLIFIER, input_full_scale=5.0))
        with pytest.raises(DataError, match="-5 to 5 V"):
            chain.applied([6.0])


class TestRecord:
    @pytest.mark.parametrize("laser_noise", [0.0, 0.5e-6, 2e-6])
    @pytest.mark.parametrize("input_noise", [0.0, 2e-4])
    @pytest.mark.parametrize("resolution", [0.0, 0.1e-6, 0.9e-6])
    def test_the_noise_is_what_the_property_says(
        self, laser_noise: float, input_noise: float, resolution: float
    ) -> None:
        chain = replace(
            PROMPT,
            laser=replace(PROMPT.laser, noise=laser_noise, resolution=resolution),
            analogue_input=replace(ANALOGUE_INPUT, noise=input_noise),
        )
        n = 200_000
        readings = np.random.default_rng(3).uniform(-1e-3, 1e-3, (1, n))
        error = chain.record(readings, np.random.default_rng(4), sample_time=0.02) - readings
        # A variance of n Gaussian values scatters by sqrt(2/n), of uniform ones by less: five times that. The mean
        # is that of unbiased rounding.
        assert error.var() / chain.noise**2 == pytest.approx(1.0, abs=5.0 * np.sqrt(2.0 / n))
        assert abs(error.mean()) < 5.0 * chain.noise / np.sqrt(n)

    def test_beyond_the_range_it_reads_the_end(self) -> None:
        quiet = replace(PROMPT, laser=replace(PROMPT.laser, noise=0.0))
        recorded = quiet.record(np.array([-50e-3, 50e-3, np.nan]), np.random.default_rng(6), sample_time=0.02)
        np.testing.assert_allclose(recorded, [-40e-3, 40e-3 - quiet.reading_step, np.nan], rtol=1e-12)

    @pytest.mark.parametrize("averages", [16, 100, 250])
    def test_it_lags_by_half_of_what_it_averages(self, averages: int) -> None:
        laser = replace(LK_G152, averages=averages, noise=0.0, resolution=0.0)
        chain = replace(CHAIN, laser=laser, analogue_input=replace(ANALOGUE_INPUT, bits=40))
        t = 0.02 * np.arange(100)
        recorded = chain.record(1e-3 * t, np.random.default_rng(7), sample_time=0.02)
        np.testing.assert_allclose(recorded, 1e-3 * np.maximum(t - averages * 100e-6, 0.0), atol=1e-12)

    def test_the_stated_error_of_the_interpolation(self) -> None:
        laser = replace(LK_G152, noise=0.0, resolution=0.0)
        chain = replace(CHAIN, laser=laser, analogue_input=replace(ANALOGUE_INPUT, bits=40))
        t = 0.02 * np.arange(1000)
        recorded = chain.record(1e-3 * np.sin(2 * np.pi * t), np.random.default_rng(8), sample_time=0.02)
        error = recorded - 1e-3 * np.sin(2 * np.pi * (t - 1.6e-3))
        # ω² d (T - d) / 2 of the amplitude, for a delay d in a sample T
        assert np.abs(error[1:]).max() < 1e-3 * (2 * np.pi) ** 2 * 1.6e-3 * 18.4e-3 / 2 * 1.01

    def test_depends_on_the_generator_only(self) -> None:
        readings = np.random.default_rng(9).uniform(0.0, 1e-3, (1, 100))
        kept = readings.copy()
        first, again, other = (CHAIN.record(readings, np.random.default_rng(s), sample_time=0.02) for s in (1, 1, 2))
        np.testing.assert_array_equal(first, again)
        assert (first != other).any()
        np.testing.assert_array_equal(readings, kept)

    def test_faults(self) -> None:
        for readings, sample_time in ((np.zeros(3), 0.0), (np.zeros(0), 0.02), (1.0, 0.02)):
            with pytest.raises(DataError, match="need readings and a time above 0"):
                CHAIN.record(readings, np.random.default_rng(0), sample_time=sample_time)
