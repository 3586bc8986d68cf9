"""What a check refuses, and with what words: limits, designs, controllers, models, operating inputs and names."""

from dataclasses import dataclass, fields, replace
from functools import partial

import control
import numpy as np
import pytest

from deatwin.control import (
    Check,
    ControlError,
    Limit,
    LinearController,
    Specification,
    Verdict,
    from_control,
    linearise,
    loop_shaping,
)
from deatwin.control.checking.trial import Trial, require_short_runs
from deatwin.ident.narx import NarxModel
from deatwin.plant import ModelError

H = 0.02


REVERSED = {"gain": (1.5, 2.0), "stable_share": (0.9, 0.975), "overshoot": (0.5, 0.25), "limit_cycle": (0.3, 0.05)}


@pytest.mark.parametrize("name", REVERSED)
def test_limits_the_wrong_way_round_are_refused(name):
    good, poor = REVERSED[name]
    with pytest.raises(ControlError, match=rf"{name}: (more|less) is better.* good = {good:g} and poor = {poor:g}"):
        Specification(**{name: Limit(good=good, poor=poor)})
    kept = Specification(**{name: Limit(good=poor, poor=good)})
    assert getattr(kept, name).good == poor


def refused(error):
    def design(linear, *, command_limits):
        raise error

    return design


@pytest.mark.parametrize(
    "details",
    [
        pytest.param({"closed_loop_time": 1e-3}, id="shorter than a sample"),
        pytest.param({"design": refused(ControlError("no such controller"))}, id="design"),
        pytest.param({"design": refused(ModelError("not on this model"))}, id="model"),
    ],
)
def test_a_design_that_is_refused_fails_with_its_reason(checked, exact, document_of, rig, details, tmp_path):
    shares = []
    found = checked(exact(), rig, progress=shares.append, **details)
    assert found.verdict is Verdict.FAIL
    assert found.reason.startswith("no controller could be designed: ")
    assert found.controller is found.margins is found.steps is None
    assert found.table == ()
    document_of(found, tmp_path)
    assert Check.load(tmp_path / "check.json").sentence == found.sentence


def broken_design(linear, *, command_limits):
    return {"gain": 1.0}["gian"]


@dataclass(frozen=True)
class Drawer:
    """A design that is an object."""

    opened: bool

    def __call__(self, linear, *, command_limits):
        if not self.opened:
            raise OSError("the drawer is locked")
        return "a drawing"


@pytest.mark.parametrize(
    ("design", "says", "cause"),
    [
        (broken_design, "the design broken_design raised KeyError: 'gian'", KeyError),
        (partial(broken_design, nothing=1), "the design broken_design raised TypeError: .*nothing", TypeError),
        (Drawer(opened=False), "the design Drawer raised OSError: the drawer is locked", OSError),
        (Drawer(opened=True), "the design Drawer returned str; it must return a Controller", type(None)),
    ],
    ids=["function", "partial", "object", "no controller"],
)
def test_a_design_of_one_s_own_that_breaks_is_one_clear_error(checked, exact, rig, design, says, cause):
    with pytest.raises(ControlError, match=says) as caught:
        checked(exact(), rig, design=design)
    assert type(caught.value.__cause__) is cause


def test_a_design_for_another_operating_input_is_refused(checked, exact, rig, fast):
    with pytest.raises(ControlError, match=r"for the operating input 0\.5, not for 0"):
        checked(exact(), rig, design=lambda linear, command_limits: replace(fast, operating_input=0.5))


def test_a_controller_of_another_sample_time_is_refused_at_once(checked, exact, rig, fast):
    shares = []
    with pytest.raises(ControlError, match=r"every 0\.01 s"):
        checked(exact(), rig, controller=replace(fast, sample_time=0.01), progress=shares.append)
    assert shares == []


def test_what_is_no_controller_is_refused_with_what_would_be(checked, exact, rig):
    model = from_control(control.tf([1.0], [1.0, -0.5], H))
    for given, says in (
        (model, r"LinearModel \(a model, from which a controller can be designed\); it must be a Controller"),
        ("PI", "controller is a str; it must be"),
    ):
        with pytest.raises(ControlError, match=says):
            checked(exact(), rig, controller=given)


@dataclass(frozen=True, kw_only=True, eq=False)
class Unlawful(LinearController):
    """A controller whose law breaks, or is none."""

    returned: object = None

    def local(self, operating_input):
        return self.returned or {}["law"]


def test_a_controller_of_one_s_own_whose_law_breaks_is_one_clear_error(checked, exact, rig, fast):
    values = {field.name: getattr(fast, field.name) for field in fields(fast)}
    with pytest.raises(ControlError, match=r"Unlawful\.local raised KeyError at 0: 'law'") as caught:
        checked(exact(), rig, controller=Unlawful(**values))
    assert isinstance(caught.value.__cause__, KeyError)
    with pytest.raises(ControlError, match=r"Unlawful\.local returned str at 0; it must return a Law"):
        checked(exact(), rig, controller=Unlawful(**values, returned="PI"))


@pytest.mark.parametrize(
    "given",
    [{"design": loop_shaping}, {"operating_input": 0.1}, {"closed_loop_time": 0.3}, {"command_limits": (-1, 1)}],
)
def test_what_only_a_design_takes_is_refused_beside_a_controller(checked, exact, rig, fast, given):
    with pytest.raises(ControlError, match=f"{next(iter(given))} would have no effect, because a controller is given"):
        checked(exact(), rig, controller=fast, **given)


def test_a_closed_loop_time_is_refused_beside_a_design_that_does_not_get_it(checked, exact, rig):
    with pytest.raises(ControlError, match=r"no effect on the design loop_shaping: .* design=partial\(lqg, clos"):
        checked(exact(), rig, design=loop_shaping, closed_loop_time=0.3)


def test_runs_without_an_end_are_refused_with_the_longest_closed_loop_time(checked, exact, rig, fast):
    """50 times for the steps and 30 pi for three periods of a sine at a fifth of the bandwidth: 144.2 in all."""
    longest = 200_000 * H / (50 + 30 * np.pi)
    require_short_runs(replace(fast, closed_loop_time=longest - 1e-6))
    with pytest.raises(ControlError, match=r"need 2e\+05 samples, but the limit is 200000; give 27\.7 s or less"):
        require_short_runs(replace(fast, closed_loop_time=longest + 1e-6))
    trial = Trial(controller=replace(fast, closed_loop_time=1.0), linear=linearise(exact()), rng=None)
    assert trial.step_reference.size + trial.sine_reference.size == pytest.approx((50 + 30 * np.pi) / H, abs=1)
    with pytest.raises(ControlError, match=r"give 27\.7 s or less"):
        checked(exact(), rig, controller=replace(fast, closed_loop_time=1e9))


def test_a_controller_outside_of_the_training_data_is_refused(checked, exact, rig, fast):
    far = replace(fast, operating_input=1.2, command_max=2.0)
    with pytest.raises(ModelError, match="outside the range of the training data"):
        checked(exact(), rig, controller=far)
    with pytest.raises(ModelError, match="outside the range of the training data"):
        checked(exact(), rig, controller=fast, operating_inputs=[0.0, 1.5])


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        pytest.param({"y(k-1)": 0.5, "u1(k)": 1.0, "u2(k)": 1.0}, "2 inputs", id="two inputs"),
        pytest.param({"y1": {"y1(k-1)": 0.5, "u(k)": 1.0}, "y2": {"y2(k-1)": 0.5}}, "output", id="two outputs"),
        pytest.param({"y(k-1)": 0.5, "u(k)": 1.0, "e(k-1)": 0.3}, "noise", id="noise terms"),
    ],
)
def test_a_model_of_another_kind_is_one_clear_error(checked, rig, terms, message):
    with pytest.raises(ModelError, match=message):
        checked(NarxModel.from_terms(terms, sample_time=H), rig, operating_input=0.0, command_limits=(-1.0, 1.0))


@pytest.mark.parametrize("name", ["", "plant", "model", "plant in large motions"])
def test_another_plant_needs_a_name_of_its_own(checked, exact, rig, fast, name):
    with pytest.raises(ControlError, match="cannot be called"):
        checked(exact(), rig, controller=fast, others={name: rig})
