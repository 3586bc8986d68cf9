"""Arguments of a wrong kind are one clear error of deatwin, whatever they are."""

import inspect
from dataclasses import fields, replace
from functools import partial

import numpy as np
import pytest
from made_narx import trained_on, trajectory_of

import deatwin.control as control
from deatwin.control import ControlError
from deatwin.control.arguments import each, finite, instance, not_negative, number, pair, positive, row, taking, whole
from deatwin.ident.narx import NarxModel, Residual
from deatwin.plant import Diaphragm, Plant, Recording
from deatwin.plant.errors import DeatwinError
from deatwin.plant.rigs.base import ReadingTime

TRAINED = trained_on((0.2, 1.0), (0.0, 1.0))
TERMS = {"y(k-1)": 1.5, "y(k-2)": -0.55, "u(k-1)": 0.04, "u(k-1)^2": 0.01}
MODEL = replace(NarxModel.from_terms(TERMS, sample_time=0.1), operating=TRAINED)
LINEAR = control.linearise(MODEL, 0.5)
LIMITS = (0.0, 1.2)
TUNED = control.lambda_tuning(LINEAR, command_limits=LIMITS)
CURVE = control.static_curve(MODEL, (0.2, 1.0))
INVERSE = control.with_inverse(LINEAR, CURVE, control.lambda_tuning, command_limits=(0.2, 1.0))
COMMON = {
    "sample_time": 0.1,
    "operating_input": 0.5,
    "operating_output": 0.5,
    "command_min": 0.0,
    "command_max": 1.0,
    "closed_loop_time": 1.0,
}
TOP, BOTTOM = TUNED.law.feedback
RNG = np.random.default_rng(0)
PLANT = Plant(rig=Diaphragm(sample_time=0.1))
RECORDING = Recording.from_arrays(0.2 + np.arange(80) % 7 / 10, np.linspace(0.0, 1.0, 80), 0.1)
LEFT = Residual(rms=1e-3, correlation_time=0.5)
TRAJECTORY = trajectory_of(MODEL, [0.0, 1.0], np.tile(MODEL.theta[:, None], 2))
RUN = {"controller": TUNED, "reference": [0.5] * 5, "rng": RNG}
WRONG = {
    "nothing": None,
    "text": "0.5",
    "texts": ["a", "b"],
    "object": object(),
    "mapping": {"a": 1},
    "complex": 1j,
    "ragged": [[1.0], [1.0, 2.0]],
    "endless": (1.2, np.inf),
    "matrix": np.ones((2, 2)),
    "model": MODEL,
    "nan": np.nan,
    "infinite": np.inf,
    "empty": [],
}
SETTINGS = {"linear": LINEAR, "command_limits": LIMITS}
TIMED = {**SETTINGS, "closed_loop_time": 1.0, "band_Hz": 1.0}
SHAPED = {**SETTINGS, "crossover_Hz": 0.2, "phase_margin_deg": 60.0, "max_sensitivity": 1.4}
GIVEN = {
    "lambda_tuning": TIMED,
    "lambda_tuning_pid": TIMED,
    "lqg": {**TIMED, "noise": 1.0, "drift": 0.1},
    "loop_shaping": SHAPED,
    "loop_shaping_pid": SHAPED,
    "hinf": {**SETTINGS, "bandwidth_Hz": 0.2, "max_sensitivity": 1.5, "effort": 2.0},
    "pid": {**SETTINGS, "gains": control.PidGains(proportional=0.5, integral=0.5), "closed_loop_time": 1.0},
    "scheduled": {
        "models": [control.linearise(MODEL, point) for point in (0.4, 0.6)],
        "design": control.lambda_tuning,
        "command_limits": LIMITS,
        "operating_input": 0.4,
    },
    "with_inverse": {**SETTINGS, "curve": CURVE, "design": control.lambda_tuning},
    "with_dynamics": {"controller": INVERSE, "filter": control.inverse_filter(LINEAR, 1.0)},
    "inverse_filter": {"linear": LINEAR, "band_Hz": 1.0},
    "static_curve": {"command_range": (0.2, 1.0), "count": 9},
    "PidGains": {"proportional": 0.5, "integral": 0.5, "derivative": 0.1, "filter_time": 0.1},
    "Law": {"a": TUNED.law.a, "b": TUNED.law.b, "c": TUNED.law.c, "d": TUNED.law.d},
    "LinearController": {**COMMON, "law": TUNED.law, "windup": TUNED.windup},
    "InverseController": {**COMMON, "feedback": INVERSE.feedback, "curve": CURVE},
    "ScheduledController": {**COMMON, "points": [0.4, 0.6], "laws": (TUNED.law,) * 2, "windup": TUNED.windup},
    "StaticCurve": {"inputs": CURVE.inputs, "outputs": CURVE.outputs},
    "controller_to_dict": {"controller": TUNED},
    "controller_from_dict": {"data": control.controller_to_dict(TUNED)},
    "LinearModel": {
        "numerator": LINEAR.numerator,
        "denominator": LINEAR.denominator,
        "covariance": LINEAR.covariance,
        "sample_time": 0.1,
    },
    "linearise_many": {"model": MODEL, "operating_inputs": [0.5]},
    "linearise_plant": {"plant": PLANT, "operating_input": 0.5, "values": PLANT.free_values, "time": 0.0},
    "gain_schedule": {"operating_inputs": [0.4], "rng": RNG, "samples": 2},
    "linear_frd": {"linear": LINEAR, "omega": [0.1]},
    "past_state": {"model": MODEL, "inputs": [0.5] * 4, "outputs": [0.5] * 4},
    "band_margins": {"linear": LINEAR, "feedback_numerator": TOP, "feedback_denominator": BOTTOM, "level": 0.9},
    "margins": {"numerators": 2.0 * LINEAR.numerator, "denominators": LINEAR.denominator, "sample_time": 0.1},
    "limit_cycles": {
        "loop_numerator": TOP,
        "loop_denominator": BOTTOM,
        "sample_time": 0.1,
        "describing_function": lambda amplitude, omega: 1.0 / amplitude + 0j * omega,
        "amplitudes": [1.0, 2.0],
        "omegas": [1.0, 2.0],
    },
    "check": {
        "model": MODEL,
        "plant": PLANT,
        "rng": RNG,
        "design": None,
        "operating_input": 0.5,
        "operating_inputs": [0.5],
        "command_limits": LIMITS,
        "closed_loop_time": 1.0,
        "recording": RECORDING,
        "specification": control.Specification(),
        "others": {"other": PLANT},
        "trajectory": TRAJECTORY,
        "samples": 2,
        "progress": lambda share: None,
    },
    "Limit": {"good": 2.0, "poor": 1.0},
    "Specification": {field.name: field.default for field in fields(control.Specification)},
    "closed_loop": {"plant": PLANT, **RUN, "settle": 0.1, "progress": lambda share: None},
    "predict_loop": {
        "model": MODEL,
        **RUN,
        "reading": ReadingTime.END_OF_HOLD,
        "residual": LEFT,
        "noise": 1e-3,
        "draws": 2,
        "progress": lambda share: None,
    },
    "sine_response": {
        "plant": PLANT,
        "operating_input": 0.5,
        "amplitudes": [0.1, 0.2],
        "omega": [10.0, 20.0],
        "progress": lambda share: None,
    },
    "SineResponse": {"amplitudes": [0.1, 0.2], "omega": [10.0, 20.0, 30.0], "values": np.full((2, 3), 1j)},
    "step_reference": {"centre": 0.5, "amplitude": 0.1, "plateau": 9, "rise": 2},
    "sine_reference": {"centre": 0.5, "amplitude": 0.1, "frequency_Hz": 0.2, "sample_time": 0.1, "periods": 3},
    "tone_reference": {
        "centre": 0.5,
        "amplitude": 0.1,
        "frequencies_Hz": [0.2, 0.3],
        "sample_time": 0.1,
        "count": 90,
        "rng": RNG,
    },
}
NAMING = {
    "check",
    "Specification",
    "closed_loop",
    "predict_loop",
    "sine_response",
    "SineResponse",
    "step_reference",
    "sine_reference",
    "tone_reference",
}
"""Those whose errors all hold the argument's name, so that it is known which one they are of."""
FIRST = {"static_curve": (MODEL,), "gain_schedule": (MODEL,)}  # by which the function is chosen
FURTHER = {name: {"name": "own"} for name in ("LinearController", "InverseController", "ScheduledController")} | {
    "LinearModel": {"operating_input": 0.5, "operating_output": 0.5}
}
PASSES = {
    ("margins", "numerators", "matrix"): "two loops",
    ("margins", "denominators", "matrix"): "two loops",
    ("linearise_many", "operating_inputs", "matrix"): "four points",
    ("gain_schedule", "operating_inputs", "matrix"): "four points",
    ("past_state", "model", "model"): "is right",
    ("linearise_many", "model", "model"): "is right",
    ("check", "model", "model"): "is right",
    ("check", "operating_inputs", "matrix"): "four points",
    ("predict_loop", "model", "model"): "is right",
    ("free_run_residual", "model", "model"): "is right",
}


SENSELESS = [
    ("PidGains", {"integral": 0.0}, "needs integral action"),
    ("PidGains", {"filter_time": 0.0}, "positive filter_time"),
    ("PidGains", {"filter_time": -0.1}, "positive filter_time"),
    ("loop_shaping", {"max_sensitivity": 1.0}, "must be above 1"),
    ("loop_shaping", {"phase_margin_deg": 90.0}, "below 90"),
    ("loop_shaping", {"crossover_Hz": 5.1}, "half the sampling rate"),
    ("loop_shaping", {"crossover_Hz": -1.0}, "half the sampling rate"),
    ("lqg", {"closed_loop_time": 0.001}, "at least a sample"),
    ("lqg", {"noise": 0.0}, "must be positive"),
    ("lqg", {"drift": -1.0}, "must be positive"),
    ("lambda_tuning", {"closed_loop_time": 0.001}, "at least a sample"),
    ("lambda_tuning_pid", {"closed_loop_time": 0.001}, "at least a sample"),
    (
        "linearise_plant",
        {"values": [1.0]},
        r"values must be \d+ finite numbers, one for each free parameter .* a list of 1",
    ),
    ("linearise_plant", {"values": np.nan * PLANT.free_values}, r"values must be \d+ finite numbers"),
    ("scheduled", {"command_limits": (1.2, 0.0)}, "must rise"),
    ("static_curve", {"command_range": (1.0, 0.2)}, "it must rise"),
    ("static_curve", {"count": 1}, "at least 2"),
    ("StaticCurve", {"inputs": [1.0, 2.0, 3.0, 4.0], "outputs": [0.0, 1.0, 3.0, 2.0]}, "turns at 3"),
    ("StaticCurve", {"inputs": [1.0, 2.0, 3.0, 4.0], "outputs": [1.0, 0.0, 2.0, 9.0]}, "turns at 2"),
    ("StaticCurve", {"inputs": [1.0, 2.0, 3.0], "outputs": [1.0, 1.0, 2.0]}, "turns at 2"),
    ("StaticCurve", {"inputs": [1.0, 2.0, 3.0, 4.0], "outputs": [0.0, -3.0, -2.0, -1.9]}, "turns at 2"),
    ("StaticCurve", {"inputs": [1.0], "outputs": [1.0]}, "at least two points"),
    ("StaticCurve", {"inputs": [2.0, 1.0], "outputs": [1.0, 2.0]}, "must increase"),
    ("Law", {"a": np.eye(2), "b": np.zeros((2, 2)), "c": np.zeros(1), "d": np.zeros(2)}, "the shape"),
    ("LinearController", {"operating_input": 5.0}, "must lie between the limits"),
    ("LinearController", {"closed_loop_time": 0.0}, "closed_loop_time is 0: it must be positive"),
    ("LinearController", {"sample_time": -1.0}, "sample_time is -1: it must be positive"),
    ("LinearController", {"windup": np.zeros(2)}, "windup has the shape"),
    ("LinearController", {"windup": np.zeros(1)}, "drift away"),
    ("LinearController", {"windup": np.array([2.5])}, "drift away"),
    ("ScheduledController", {"points": [0.4, 0.4]}, "increasing points"),
    ("ScheduledController", {"points": [0.4]}, "a law at each"),
    ("ScheduledController", {"windup": np.zeros(2)}, "windup has the shape"),
    ("ScheduledController", {"windup": np.zeros(1)}, "drift away at 0.4"),
    ("Limit", {"poor": 2.0}, "must be finite and must differ"),
    ("lambda_tuning", {"linear": MODEL}, r"linear must be a LinearModel, as linearise\(.* makes it; got a NarxModel"),
    ("lambda_tuning", {"command_limits": (1.2, np.inf)}, "the second of command_limits is inf: it must be finite"),
    ("lambda_tuning", {"command_limits": 3.0}, "must be two numbers, the least and the largest; got a float"),
    ("lambda_tuning", {"closed_loop_time": "1"}, "closed_loop_time must be a number; got text"),
    ("lambda_tuning", {"band_Hz": -1.0}, "band_Hz is -1: it must be positive and finite"),
    ("check", {"specification": [control.Limit(good=2.0, poor=1.5)]}, "must be a Specification; got a list"),
    ("check", {"others": {"spare": MODEL}}, r"others\['spare'\] must be a Plant or a CalibratedPlant; got a NarxModel"),
    ("check", {"others": [PLANT]}, "others must be a Mapping from names to plants; got a list of 1"),
    ("check", {"others": {1: PLANT}}, "a name in others must be a str; got an int"),
    ("check", {"others": {" ": PLANT}}, "an alternative plant cannot be called ' '"),
    ("check", {"rng": 0}, "rng must be a Generator, as numpy"),
    ("Specification", {"reserve": np.nan}, "reserve is nan: it must be finite"),
    *(
        ("SineResponse", {"values": np.ones(shape)}, r"values of a response have the shape \(.*\): it must be \(2, 3\)")
        for shape in ((3, 2), 6)
    ),
    *(("step_reference", {"plateau": p, "rise": r}, "shorter") for p, r in ((5, 5), (5, 9), (1, 1))),
    ("sine_reference", {"frequency_Hz": 5.0}, "below half the sampling rate, 5 Hz"),
    ("tone_reference", {"frequencies_Hz": [0.2, 6.0]}, "below half the sampling rate, 5 Hz"),
    *(
        ("limit_cycles", given, "increasing positive")
        for given in ({"amplitudes": [1.0]}, {"amplitudes": [0.0, 1.0]}, {"omegas": [2.0, 1.0]}, {"omegas": [1, 400]})
    ),
    (
        "limit_cycles",
        {"describing_function": lambda amplitude, omega: np.ones(5), "omegas": [1.0, 2.0, 3.0]},
        r"broadcast, here \(2, 3\); it returned \(5,\)",
    ),
    ("margins", {"numerators": [[0.0, np.nan]], "denominators": [1.0, -0.5]}, "loop 0 is not finite"),
    ("margins", {"numerators": [0.0, 1.0], "denominators": [[1.0, 0.0], [0.0, 0.0]]}, "loop 1 is zero"),
    ("margins", {"sample_time": 0.0}, "sample_time"),
    *(
        ("sine_response", given, "increasing positive numbers")
        for given in (
            *({"amplitudes": sizes} for sizes in ([0.1], [0.2, 0.1], [0.0, 0.1], [0.1, np.nan], [[0.1, 0.2]])),
            *({"omega": rates} for rates in ([1.0, np.pi / 0.1], [1.0, 1.0])),
        )
    ),
]
"""What makes no sense, and what is said."""


def called(name, given):
    return getattr(control, name)(*FIRST.get(name, ()), **given, **FURTHER.get(name, {}))


# H-infinity needs a further package; whole checks take what is right in tests/unit/control/checking.
@pytest.mark.parametrize("name", [name for name in GIVEN if name not in ("hinf", "check")])
def test_what_is_right_is_taken(name):
    called(name, GIVEN[name])


@pytest.mark.parametrize(("name", "argument"), [(name, argument) for name in GIVEN for argument in GIVEN[name]])
def test_what_is_wrong_is_one_clear_error(name, argument):
    default = inspect.signature(getattr(control, name)).parameters.get(argument)
    for kind, value in WRONG.items():
        if (name, argument, kind) in PASSES or (default is not None and value is default.default):
            continue
        with pytest.raises(DeatwinError) as caught:
            called(name, {**GIVEN[name], argument: value})
            pytest.fail(f"{name} takes {argument} = {kind}")
        assert len(str(caught.value)) < 250 and "object at 0x" not in str(caught.value)
        assert argument in str(caught.value) or name not in NAMING


@pytest.mark.parametrize(("name", "given", "says"), SENSELESS, ids=lambda part: part if isinstance(part, str) else "")
def test_what_makes_no_sense_is_said(name, given, says):
    with pytest.raises(ControlError, match=says):
        called(name, {**GIVEN[name], **given})


@pytest.mark.parametrize("name", ["lambda_tuning", "lambda_tuning_pid", "loop_shaping", "loop_shaping_pid", "lqg"])
def test_a_model_that_answers_in_the_same_sample_is_refused(name):
    """No controller sees it: a loop designed on it would have a sample more of delay than its margins say."""
    at_once = control.LinearModel(
        numerator=[0.2, 0.0],
        denominator=[1.0, -0.8],
        covariance=np.zeros((3, 3)),
        sample_time=0.1,
        operating_input=0.5,
        operating_output=0.5,
    )
    with pytest.raises(
        ControlError, match=r"responds to a command in the same sample.*linear\.in_loop\(rig\.reading\)"
    ):
        called(name, {**GIVEN[name], "linear": at_once})
    called("lambda_tuning", {**SETTINGS, "linear": at_once.in_loop(ReadingTime.END_OF_HOLD)})


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"a": 0.5, "b": 1.0, "c": 1.0}, r"a of a control law has the shape \(\)"),
        ({"b": "1"}, "b must be real numbers; got text"),
        ({"d": "1"}, "d must be a number; got text"),
    ],
)
def test_a_law_of_the_error_names_what_is_wrong(given, says):
    with pytest.raises(ControlError, match=says):
        control.Law.of_error(**{"a": [[0.5]], "b": [1.0], "c": [1.0], "d": 0.0, **given})
    with pytest.raises(ControlError, match="factor must be a number; got text"):
        TUNED.scaled("2")


def test_loops_of_shapes_that_do_not_fit_are_refused():
    for act in (control.in_series, partial(control.margins, sample_time=0.1)):
        with pytest.raises(ControlError, match=r"shapes \(2, 2\) and \(3, 2\) do not fit"):
            act(np.ones((2, 2)), np.ones((3, 2)))
        for empty in ([], [[]], np.ones((0, 3))):
            for loop in ((empty, [1.0]), ([1.0], empty)):
                with pytest.raises(ControlError, match="must have one coefficient or more; got a"):
                    act(*loop)


def test_checks_take_what_is_right():
    for value in (1, 1.5, np.float32(2.0), np.int64(3), np.array(4.0)):
        for check in (number, finite, positive):
            check(value, "x")
    pair([0, np.float64(1.0)], "x")
    pair(np.array([0.0, 1.0]), "x")
    whole(3)(np.int64(3), "x")
    each(instance(int, float))((1, 2.0), "x")
    number(np.nan, "x")  # where a function bounds it itself
    not_negative(0, "x")
    for value in ([1], (0.5, -2.0), np.arange(3)):
        row(value, "x")


@pytest.mark.parametrize("value", [True, np.bool_(True), 2.0, 1, "3", None])
def test_what_is_no_count(value):
    with pytest.raises(ControlError, match="x must be an integer of at least 3; got"):
        whole(3)(value, "x")


def test_the_decorated_function_stays_itself():
    @taking(size=positive, other=number)
    def area(size: float, other: float | None = None) -> float:
        """Area."""
        return size**2

    assert area.__name__ == "area" and area.__doc__ == "Area."
    assert list(inspect.signature(area).parameters) == ["size", "other"]
    assert area(2.0) == area(size=2.0, other=None) == 4.0
    with pytest.raises(TypeError, match=r"area\(\) missing 1 required positional argument: 'size'"):
        area()
    with pytest.raises(ControlError, match="other must be a number; got a list of 1"):
        area(2.0, other=[1.0])


def test_functions_that_depend_on_the_kind_of_their_first_argument_take_it_by_position():
    """A function of `singledispatch` cannot take it by name."""
    several = [taker for name in control.__all__ if hasattr(taker := getattr(control, name), "registry")]
    assert control.static_curve in several
    for taker in several:
        first, *_ = inspect.signature(taker).parameters.values()
        assert first.kind is first.POSITIONAL_ONLY, taker
