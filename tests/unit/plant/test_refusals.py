"""What excitations, recordings, experiments and parameters refuse, and with what words."""

from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas
import pytest

from deatwin.plant import (
    BlockedPlanar,
    BowTie,
    CalibratedPlant,
    Cone,
    Coupon,
    Creep,
    DeatwinError,
    Diaphragm,
    Disc,
    Experiment,
    Material,
    MeasuringChain,
    Parameter,
    ParameterSet,
    Planar,
    Plant,
    Pressure,
    Reading,
    Recording,
    RigError,
    Roll,
    Scale,
    Sizes,
    Stack,
    Supply,
    actuation_curve,
    draw_rig,
    effect_named,
    fleet,
    load_material,
    load_plant,
    quantise,
    read_experiment,
    read_recording,
    read_rig,
    resample,
)
from deatwin.plant.checks import require_excitation
from deatwin.plant.decimation import decimate
from deatwin.plant.errors import DataError, ModelError
from deatwin.plant.excitation import (
    band_limited_noise,
    linear_chirp,
    logarithmic_chirp,
    random_holds,
    random_odd_harmonics,
    random_phase_multisine,
    share_above_band,
    staircase,
    triangles,
    with_alternating_polarity,
)
from deatwin.plant.export import export_model_exchange, plant_source
from deatwin.plant.files import read_commands, write_csv, write_recording, write_text_atomic
from deatwin.plant.laws import Formula

H = 0.02
RNG = np.random.default_rng(0)
FILMS = (BlockedPlanar, BowTie, Cone, Coupon, Diaphragm, Disc, Planar, Pressure, Roll, Stack)
MASS = Parameter(name="mass", value=3e-3, unit="kg", lower=1e-6, upper=1.0, known=True)
MODULUS = Parameter(name="shear_modulus", value=25e3, unit="Pa", lower=5e3, upper=200e3)
PLANT = Plant(rig=Diaphragm())
arrays = Recording.from_arrays


def noise(duration: float = 10.0, sample_time: float = H, **options: float) -> np.ndarray:
    return band_limited_noise(RNG, duration, sample_time, **options)


def multisine(harmonics: object = np.arange(1, 81, 2), rms: float = 0.25, **options: object) -> np.ndarray:
    return random_phase_multisine(RNG, 40.0, H, harmonics, rms, **options)


def still(start: float = 0.0, level: float = 2.4) -> Recording:
    return arrays(np.full(100, level), np.linspace(0.0, 1e-4, 100), H, start=start)


def ramp(start: float = 0.0, sample_time: float = H, **names: object) -> Recording:
    return arrays(np.linspace(1.0, 2.0, 100), np.linspace(0.0, 1e-4, 100), sample_time, start=start, **names)


EXCITATION: list[tuple[Callable[[], object], str]] = [
    (lambda: noise(band=26.0), "at most half the sample rate, 25 Hz"),
    (lambda: noise(band=0.0), "band 0 Hz"),
    (lambda: noise(mean=0.5), "lower < mean < upper"),
    (lambda: noise(variance=-1.0), "variance >= 0"),
    (lambda: noise(duration=0.5), "needs at least 1 s"),
    (lambda: noise(duration=0.0), "at least one sample"),
    (lambda: noise(duration=np.inf), "at least one sample"),
    (lambda: noise(sample_time=0.0), "at least one sample"),
    (lambda: share_above_band(np.full(5, 2.4), H, 1.0), "constant commands"),
    (lambda: share_above_band(np.arange(5.0), H, 0.0), "both must be above 0"),
    (lambda: share_above_band([[1.0, 2.0, 3.0]], H, 1.0), r"commands of shape \(1, 3\)"),
    (lambda: linear_chirp(10.0, H, last=26.0), "half the sample rate, 25 Hz"),
    (lambda: linear_chirp(10.0, H, first=0.0), "above 0"),
    (lambda: linear_chirp(10.0, H, amplitude=-0.1), "amplitude -0.1 V"),
    (lambda: linear_chirp(10.0, H, amplitude=np.inf), "amplitude inf V: both must be finite"),
    (lambda: logarithmic_chirp(10.0, H, mean=-np.inf), "mean -inf V, amplitude 0.3 V: both must be finite"),
    (lambda: random_holds(RNG, 10.0, H, -np.inf, 3.0), "levels -inf to 3 V: need lower < upper"),
    (lambda: logarithmic_chirp(10.0, H, first=2.0, last=2.0), "two that differ"),
    (lambda: logarithmic_chirp(0.0, H), "at least one sample"),
    (lambda: random_holds(RNG, 10.0, H, 3.0, 1.0), "need lower < upper"),
    (lambda: random_holds(RNG, 10.0, H, 1.0, 3.0, shortest=5.0, longest=2.0), "shortest <= longest"),
    (lambda: staircase(H, levels=1), "1 levels"),
    (lambda: staircase(H, 3.0, 1.0), "lower < upper"),
    (lambda: staircase(H, hold=0.001), r"hold 0\.001 s"),
    (lambda: triangles(H, rates=(26.0,)), "at most half the sample rate, 25 Hz"),
    (lambda: triangles(H, rates=(0.0,)), "above 0"),
    (lambda: triangles(H, rates=()), "0 rates"),
    (lambda: triangles(H, cycles=0), "0 cycles"),
    (lambda: triangles(H, upper=1.0), "lower < upper"),
    (lambda: with_alternating_polarity([1.0, np.nan], 1.0, 1.0), "one row of at least one finite number"),
    (lambda: with_alternating_polarity([1.0], 1.0, segment=0.1), r"segment 0\.1 s"),
    (lambda: random_odd_harmonics(RNG, 40.0, 2.0, group=1), "groups of 1"),
    (lambda: random_odd_harmonics(RNG, 40.0, 2.0, group=41), "groups of 41 among 40"),
    (lambda: multisine([0, 1]), "from 1 to 999"),
    (lambda: multisine([1000]), "from 1 to 999"),
    (lambda: multisine([1, 1]), "distinct whole numbers"),
    (lambda: multisine([1.5]), "distinct whole numbers"),
    (lambda: multisine([]), "distinct whole numbers"),
    (lambda: multisine(amplitudes=[1.0]), "need 40, one a harmonic"),
    (lambda: multisine(amplitudes=np.zeros(40)), "not all zero"),
    (lambda: multisine(amplitudes=-np.ones(40)), "none negative"),
    (lambda: multisine(periods=0), "need one period"),
    (lambda: multisine(rms=-0.1), "rms >= 0"),
    (lambda: multisine(mean=4.0), "lower < mean < upper"),
]
RECORDS: list[tuple[Callable[[], object], str]] = [
    *(
        (lambda ends=ends: ramp().section(*ends), "record of 100 samples; .* from 0 to 100, the larger one last")
        for ends in ((-1, 5), (5, 5), (90, 101), (0.0, 5.0), (0, None))
    ),
    (lambda: arrays([1.0, 2.0], [0.0, np.nan], 1.0), 'channel "displacement" is nan at sample 1'),
    *((lambda h=h: arrays([1.0], [1.0], h), "sample time .* must be positive") for h in (0.0, -1.0, np.inf, np.nan)),
    (lambda: arrays(np.ones(5), np.ones(4), 1.0), r"outputs have the shape \(1, 4\)"),
    (lambda: arrays(np.ones((2, 5)), np.ones(5), 1.0, input_names=["command"]), "2 inputs, 1 names"),
    (
        lambda: arrays(np.ones((2, 5)), np.ones(5), 1.0, input_names=["u", "u"]),
        'two inputs .* are named "u": give each',
    ),
    (
        lambda: arrays(np.ones(5), np.ones(5), 1.0, input_names=(1,)),
        "names and units of inputs must be texts; got 1, ''",
    ),
    (lambda: arrays(np.ones(5), np.ones(5), 1.0, output_units=(None,)), "of outputs must be texts; .*None"),
    (lambda: arrays(np.ones(5), np.ones(5), 1.0, input_names=3), "of inputs must be texts; got 3"),
    (lambda: arrays(np.ones(5), np.ones(5), 10**400), "sample_time must be one number, in s; got a int"),
    (lambda: arrays([10**400, 0], np.ones(2), 1.0), "inputs must be an array of real numbers"),
    (
        lambda: arrays(np.ones(5), np.ones(5), 1.0, extras={3: np.ones(5)}),
        "names of extra channels must be texts; got 3",
    ),
    (lambda: arrays(np.ones(5), np.ones((2, 5)), 1.0, output_names=["u", "u"]), 'two outputs .* are named "u"'),
    *(
        (
            lambda table=table: arrays(table, np.ones(5), 1.0),
            rf"shape \(5, {width}\), more rows than samples.*transpose",
        )
        for width, table in ((1, np.ones((5, 1))), (2, pandas.DataFrame({"u": np.ones(5), "v": np.ones(5)})))
    ),
    (lambda: arrays([], [], 1.0), "inputs .* no sample"),
    *(
        (lambda wrong=wrong: arrays(wrong, [1.0, 2.0], 1.0), "inputs must be an array of real numbers")
        for wrong in (["a", "b"], ["1", "2"], [1j, 2.0], [None, "b"], [[1.0], [1.0, 2.0]], np.array([1, 2], "M8[s]"))
    ),
    (lambda: arrays(np.ma.masked_equal([1.0, 7.0], 7.0), [1.0, 2.0], 1.0), '"command" is nan at sample 1'),
    *(
        (lambda h=h: arrays([1.0, 2.0], [1.0, 2.0], h), "sample_time must be one number, in s")
        for h in (np.arange(2.0), None, pandas.Timedelta("20ms"))
    ),
    (
        lambda: arrays(np.ones(5), np.ones(5), 1.0, extras={"force": np.ones(3)}),
        r'channel "force" has the shape \(3,\)',
    ),
    *(
        (lambda kind=kind: arrays(np.ones(5), np.ones(5), 1.0, **{kind: ["K"]}), f"{kind} must be a mapping of names")
        for kind in ("extras", "extra_units", "provenance")
    ),
    *(
        (lambda name=name, wrong=wrong: noise(**{name: wrong}), f"{name} is .*; it must be a number")
        for name in ("duration", "sample_time", "mean", "variance", "band", "lower")
        for wrong in (None, "a", [1.0, 2.0], 1j, True, np.nan)
    ),
    (lambda: linear_chirp(5.0, H, mean=np.nan), "mean is nan; it must be a number"),
    *(
        (lambda wrong=wrong: staircase(1.0, levels=wrong), "levels is .*; it must be an integer")
        for wrong in (2.5, None)
    ),
    (lambda: triangles(H, rates=[1j]), "rates must be an array of real numbers"),
    (lambda: resample(still(), "a"), "sample_time must be one number"),
    (lambda: resample(still(), H, timepts="a"), "timepts must be an array of real numbers"),
    (lambda: quantise([1.0], -0.1), "at least 0"),
    *(
        (lambda commands=commands: actuation_curve(Plant(rig=Planar()), commands), says)
        for says, several in (
            ("rise from 0", ([1.0, 0.5], [-1.0, 0.0])),
            ("need one row of at least one finite number", ([], 2.0, [0.0, np.nan], [0.0, np.inf], [[0.0, 1.0]])),
        )
        for commands in several
    ),
    (lambda: random_phase_multisine(RNG, 5.0, H, [1], 0.1, amplitudes=["a"]), "amplitudes must be an array of real"),
    (lambda: Experiment(recordings=(ramp(), ramp(start=1.5))), "overlap between 1.5 s and 2 s.*--experiment"),
    (lambda: Experiment(recordings=(ramp(), ramp(9.0, 0.01))), "sample times 0.02 s and 0.01 s"),
    (
        lambda: Experiment(recordings=(ramp(), ramp(9.0, output_names=["force"], output_units=["N"]))),
        "output names differ: displacement and force",
    ),
    (lambda: Experiment(recordings=()), "at least one recording"),
    (
        lambda: Experiment(recordings=np.ones(3)),
        "a float64 is not a recording: make a Recording of arrays with Recording.from_arrays",
    ),
    (lambda: Experiment(recordings=["a.csv"]), "a str is not a recording: read a Recording from a file with read_reco"),
    (lambda: read_recording("run*.csv"), "no such file; give the files one by one"),
    (lambda: read_recording("https://host.org/a.csv"), "no such file; download it first"),
    (lambda: PLANT.simulate(np.ones(3)), "a ndarray is not a recording|a float64 is not a recording"),
    (
        lambda: PLANT.simulate(ramp(input_names="command", input_units="kV")),
        "in kV, but the model needs it in V; .* 1000 times",
    ),
    (lambda: PLANT.record(arrays(np.ones((2, 5)), np.ones(5), H), RNG), "it has 2 inputs, but the plant takes one"),
    (lambda: require_excitation([still()]), "the input is constant throughout"),
    (lambda: require_excitation([still(), still(start=2.0)]), "constant throughout"),
    (lambda: require_excitation([still(), still(start=2.0, level=3.0)]), "constant"),
]
PARAMETERS: list[tuple[Callable[[], object], str]] = [
    (lambda: ParameterSet([MODULUS]).with_values({"shear_modulos": 1e4}), 'did you mean "shear_modulus"'),
    (lambda: ParameterSet([MODULUS]).with_values({"shear_modulus": 1.0}), "shear_modulus = 1 Pa is out of range"),
    (lambda: ParameterSet([MASS]).with_values({"mass": np.nan}), "mass = nan kg"),
    (lambda: replace(MASS, value=None), "value of the parameter mass is None; it must be a number"),
    (lambda: PLANT.with_values({"mass": "3 g"}), "value of the parameter mass is '3 g'; it must be a number"),
    (lambda: Roll(spring_rate=0.0), "its rate must be above 0"),
    (lambda: BowTie(sides="equal"), "sides"),
    (lambda: BowTie(waist_width=0.0), "waist_width"),
    (lambda: BowTie(sides="free", side_prestretch=3.0), "free sides contract by themselves"),
    (lambda: Disc(electrode_radius=30e-3), "does not fit"),
    (lambda: Cone(disc_radius=30e-3), "does not fit"),
    (lambda: Cone(snap_reach=0.0), "snap_reach is 0"),
    (lambda: Diaphragm(elements=0), r"rig\.elements is 0; it must be from 1 "),
    (lambda: Diaphragm(ball="bondet"), 'unknown ball .*did you mean "bonded"'),
    (lambda: Diaphragm(resolution="fines"), 'unknown resolution .*did you mean "fine"'),
    *(
        (lambda wrong=wrong: Supply(**wrong), "of the supply is")
        for wrong in ({"current_limit": 0.0}, {"series_resistance": -1.0}, {"sink_current": np.nan})
    ),
    (lambda: ParameterSet([MODULUS])["shear_modulos"], 'did you mean "shear_modulus"'),
    (
        lambda: Parameter(name="mass", value=2.0, unit="kg", lower=1e-6, upper=1.0),
        "mass = 2 kg is out of range: allowed is 1e-06 to 1 kg",
    ),
    (lambda: ParameterSet([MASS, MASS]), "mass is given twice"),
    *(
        (
            lambda name=name, wrong=wrong: replace(MASS, **{name: wrong}),
            f"{name} of the parameter .* is {wrong!r}; it must",
        )
        for name, wrong in (("name", 3), ("unit", None), ("scale", "log"), ("known", "no"))
    ),
    *(
        (
            lambda name=name, wrong=wrong: Sizes(**{name: wrong}),
            f"{name} of the sizes is .*; it must be a number above 0",
        )
        for name in ("motion", "force", "period", "command", "voltage")
        for wrong in (0.0, -1.0, np.nan, "a")
    ),
    (lambda: Sizes(command_unit=None), "command_unit of the sizes is None; it must be text"),
    (lambda: ParameterSet(["mass"]), "'mass' is not a Parameter"),
    (lambda: ParameterSet(3), "parameters is 3: give a tuple of parameters"),
    *(
        (lambda wrong=wrong: PLANT.with_effects(wrong), "is not an effect: give effects one by one")
        for wrong in ("creep", Creep, [Creep()])
    ),
    (lambda: PLANT.with_effects(Creep(), Creep(time=3.0)), "has the effect creep twice"),
    (lambda: Plant(rig=Planar(), effects=Creep()), "give a tuple of effects"),
    (lambda: Plant(rig=Planar), "Planar is not a rig: give an object"),
    *(
        (lambda chain=chain: Plant(rig=Disc(chain=chain)), "chain is .*; it must be a MeasuringChain")
        for chain in ("a", 3)
    ),
    (lambda: Plant(rig=Disc(supply=2.0)), "supply is 2.0; it must be a Supply"),
    *(
        (lambda one=one: Plant(rig=Disc(further=one)), "further is .*; it must be a tuple of Reading")
        for one in (None, "a")
    ),
    *(
        (lambda film=film, name=name, wrong=wrong: film(**{name: wrong}), f"rig.{name} is .*; it must be")
        for film, name in (
            (Disc, "frame_radius"),
            (Cone, "snap_reach"),
            (BowTie, "stations"),
            (Roll, "spring_rate"),
            (Diaphragm, "elements"),
        )
        for wrong in (None, "a", [], -1.0, 1j)
    ),
    *((lambda wrong=wrong: draw_rig(wrong), "is not a rig: give the rig of a plant") for wrong in (None, PLANT)),
    (lambda: Plant(rig=Planar(sample_time=np.nan)), "rig.sample_time is nan; it must be from 1e-06"),
    (lambda: Plant(rig=Planar(sample_time=0.0)), "rig.sample_time is 0; it must be from 1e-06"),
    (lambda: Plant(rig=Planar(noise=-1.0)), "rig.noise is -1; it must be from 0"),
    (lambda: Plant(rig=Planar(reading="start of hold")), "reading is 'start of hold'; it must be one of"),
    (
        lambda: Plant(rig=Planar(command_range=(5.0, 1.0))),
        r"command_range is \(5.0, 1.0\); it must be the lower end and then the upper one",
    ),
    (lambda: Plant(rig=Disc(start_hold=-1.0)), "rig.start_hold is -1; it must be from 0"),
    (lambda: Plant(rig=Disc(start_ramp=np.inf)), "rig.start_ramp is inf"),
    *(
        (lambda s=s: Parameter(name="x", value=1.0, unit="1", lower=0.0, upper=2.0, scale=s), "above 0")
        for s in (Scale.LOGARITHMIC, Scale.RECIPROCAL)
    ),
]


@pytest.mark.parametrize(("act", "says"), [*EXCITATION, *RECORDS])
def test_data_that_make_no_sense(act: Callable[[], object], says: str) -> None:
    with pytest.raises(DataError, match=says):
        act()


@pytest.mark.parametrize(("act", "says"), PARAMETERS)
def test_parameters_that_cannot_be(act: Callable[[], object], says: str) -> None:
    with pytest.raises(RigError, match=says):
        act()


@pytest.mark.parametrize("film", FILMS)
def test_no_rig_of_a_film_has_an_impossible_size(film: type) -> None:
    names = {field.name for field in fields(film)}
    sizes = names & {"length", "width", "area", "prestretch", "side_prestretch", "hoop_prestretch", "frame_radius"}
    assert sizes
    for name in sizes:
        for value in (-1.0, 0.0, np.nan, np.inf):
            with pytest.raises(RigError):
                Plant(rig=film(**{name: value}))
    for name, value in (("direction", 0.5), ("layers", 2.5), ("stations", 2.5), ("elements", 2.5), ("gain", True)):
        if name in names:
            with pytest.raises(RigError, match=f"rig.{name} is {value}; it must be"):
                Plant(rig=film(**{name: value}))


def test_sizes_may_be_numbers_of_numpy() -> None:
    rig = Stack(layers=np.int64(30), area=np.float32(2**-12))
    assert (
        Plant(rig=rig).parameters.array().tolist()
        == Plant(rig=Stack(layers=30, area=2**-12)).parameters.array().tolist()
    )


def test_parameters_of_an_energy_have_the_names_of_its_arguments_in_any_order() -> None:
    """A stretch of 2 in both directions: I1 = 8 + 1/16, so that W = 3e5/2 (I1 - 3) + 5e3 (I1 - 3)^2."""
    mu = Parameter(name="mu", value=3e5, unit="Pa", lower=1e3, upper=1e6)
    c = Parameter(name="c", value=5e3, unit="Pa", lower=1e3, upper=1e6)
    made = partial(
        Material, name="mine", permittivity=Parameter(name="permittivity", value=3, unit="1", lower=1, upper=9)
    )
    formula, beyond = Formula("mu/2*(I1 - 3) + c*(I1 - 3)^2"), 5.0625
    for energy in (formula, lambda a, b, mu, c: formula(a, b, mu, c)):
        for elastic in ((mu, c), (c, mu)):
            film = made(energy=energy, elastic=elastic)
            assert float(film.energy(2.0, 2.0, *(p.value for p in film.elastic))) == pytest.approx(
                1.5e5 * beyond + 5e3 * beyond**2, rel=1e-14
            )
    for elastic, says in (((mu,), "mu$"), ((mu, c, mu), "mu, c, mu$")):
        with pytest.raises(RigError, match=f"has the parameters mu, c; elastic has {says}"):
            made(energy=formula, elastic=elastic)
    with pytest.raises(RigError, match="energy is 'gent'; give a function"):
        made(energy="gent", elastic=(mu,))


@pytest.mark.parametrize("means", ["displacement", ["current"]])
@pytest.mark.parametrize("act", [partial(resample, sample_time=2 * H), partial(decimate, factor=2)])
def test_readings_that_are_means_are_listed_by_names_that_exist(act: Callable[..., object], means: object) -> None:
    """A text is a collection of its letters, and a missing name would leave the reading half a sample late."""
    with pytest.raises(
        DataError, match=r"give a list of names of outputs and further channels, which are displacement$"
    ):
        act(still(), means=means)


GENERATOR = r"rng = .*; it must be a numpy\.random\.Generator"
SEED = "it must be an integer of at least 0"
WRONG_KINDS = [
    (lambda value: read_recording(value), "path must be a str or a PathLike"),
    (lambda value: read_commands(value, input_column="u"), "path must be a str or a PathLike"),
    (lambda value: read_commands("a.csv", input_column=value), "input_column must be a str"),
    (lambda value: read_recording("a.csv", output_column=value), "output_column must be a str"),
    (lambda value: read_experiment(value), "paths must be an Iterable or a PathLike"),
    (lambda value: read_experiment([value]), "path must be a str or a PathLike"),
    (lambda value: read_rig(value), "path must be a str or a PathLike"),
    (lambda value: load_plant(value), "source must be a str"),
    (lambda value: load_material(value), "path must be a str or a PathLike"),
    (lambda value: write_csv(value, {}), "path must be a str or a PathLike"),
    (lambda value: write_csv("a.csv", value), "columns must be a Mapping"),
    (lambda value: write_recording("a.csv", value), "recording must be a Recording"),
    (lambda value: write_text_atomic("a.txt", value), "text must be a str"),
    (lambda value: resample(value, 0.1), "recording must be a Recording"),
    (lambda value: decimate(value, 2), "recording must be a Recording"),
    (lambda value: resample(still(), H, means=value), "means = .*; give a list of names"),
    (lambda value: decimate(still(), 2, means=value), "means = .*; give a list of names"),
    (lambda value: Formula(value), "it is not a text"),
    (lambda value: CalibratedPlant.load(value), "path must be a str or a PathLike"),
    (lambda value: CalibratedPlant.nominal(PLANT).save(value), "path must be a str or a PathLike"),
    (lambda value: effect_named(value), "name must be a str"),
    (lambda value: Plant(rig=Planar(), values=value), "values must be a Mapping from names to numbers"),
    (lambda value: PLANT.with_values(value), "values must be a Mapping from names to numbers"),
    (lambda value: CalibratedPlant(plant=value, noise=0.0, model_error=0.0), "plant must be a Plant"),
    (lambda value: Reading(name="current", noise=1.0, column=value), "column must be a str"),
    (lambda value: quantise([1.0], [value]), "step"),
    (lambda value: plant_source(PLANT, name=value), "cannot be a prefix of C names"),
    (lambda value: export_model_exchange(PLANT, value), "path must be a str or a PathLike"),
    (lambda value: actuation_curve(value, [1.0]), "needs a Plant, not a "),
    (lambda value: plant_source(value), "needs a Plant, not a "),
    (lambda value: PLANT.record(ramp(), value), GENERATOR),
    (lambda value: fleet()[0].record(ramp(), value), GENERATOR),
    (lambda value: MeasuringChain().record([0.0], value, sample_time=H), GENERATOR),
    (lambda value: band_limited_noise(value, 10.0, H), GENERATOR),
    (lambda value: random_holds(value, 10.0, H, 1.0, 3.0), GENERATOR),
    (lambda value: random_odd_harmonics(value, 40.0, 2.0), GENERATOR),
    (lambda value: fleet(value), SEED),
]


def test_what_holds_a_plant_is_told_from_what_names_its_file() -> None:
    for given, says in (
        (CalibratedPlant.nominal(PLANT), "not a CalibratedPlant: give its attribute plant"),
        ("rig.toml", r"needs a Plant, not a str: load_plant\(path\)\.plant is the one of a file"),
    ):
        with pytest.raises(ModelError, match=says):
            plant_source(given)


@pytest.mark.parametrize("seed", [None, -1, True, RNG])
def test_a_seed_is_an_integer_of_at_least_zero(seed: object) -> None:
    with pytest.raises(ModelError, match=SEED):
        fleet(seed)


@pytest.mark.parametrize("value", [0.5, object()], ids=["number", "object"])
@pytest.mark.parametrize(("act", "says"), WRONG_KINDS)
def test_an_argument_of_another_kind_is_named(act: Callable[[object], object], says: str, value: object) -> None:
    with pytest.raises(DeatwinError, match=says):
        act(value)


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"noise": "a"}, "noise is 'a'; it must be a number of at least 0"),
        ({"model_error": -1.0}, "model_error is -1.0; it must be a number of at least 0"),
        ({"names": (3,)}, r"names\[0\] must be a str; got an int"),
        ({"names": 3}, "names must be a list or a tuple; got an int"),
        ({"covariance": [[1.0], [1.0, 2.0]]}, "covariance must be an array of real numbers"),
        ({"covariance": np.eye(1)}, r"covariance has the shape \(1, 1\), for 0 names"),
    ],
)
def test_a_calibrated_plant_of_wrong_fields_is_refused(wrong: dict[str, object], says: str) -> None:
    with pytest.raises(DeatwinError, match=says):
        CalibratedPlant(**{"plant": PLANT, "noise": 1e-6, "model_error": 0.0, **wrong})


def test_values_and_steps_to_quantise_are_real_numbers() -> None:
    for values, step, says in (("a", 0.1, "values"), (1j, 0.1, "values"), ([[1.0], [1.0, 2.0]], 0.1, "values")):
        with pytest.raises(DataError, match=f"{says} must be an array of real numbers"):
            quantise(values, step)
    for step in (None, "a", 1j, [0.1, 0.2], -1.0, np.inf):
        with pytest.raises(DataError, match="step"):
            quantise(1.0, step)


def test_one_file_is_an_experiment_of_one_file(tmp_path: Path) -> None:
    write_recording(tmp_path / "a.csv", still())
    for path in (tmp_path / "a.csv", str(tmp_path / "a.csv")):
        assert read_experiment(path).recordings[0].n_samples == 100
