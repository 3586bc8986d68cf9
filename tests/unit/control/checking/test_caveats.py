"""What is known against a model, and what a tuning left out, stands beside the verdict and in the file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from deatwin.control import Check
from deatwin.ident.narx import NarxModel, Reliance, ValidationStatus
from deatwin.plant import Plant

FAILED = Reliance(
    status=ValidationStatus.STRUCTURE, failed=("ue",), gain_error=0.12, gain_error_half_width=0.03
).provenance


def test_failed_tests_and_bias_stand_in_the_sentence_and_come_back_from_the_file(
    checked: Callable[..., Check],
    exact: Callable[..., NarxModel],
    rig: Plant,
    known: dict[str, str],
    passed: Check,
    tmp_path: Path,
) -> None:
    found = checked(exact(provenance=known | FAILED), rig)
    assert found.verdict is passed.verdict and "residual test" not in passed.sentence
    assert (
        "The model failed one residual test on held-out data (ue, where e is the residual and u the input): its residual "
        "still depends on the input, and the uncertainty of its parameters does not include this error."
        in found.sentence
    )
    assert (
        "The model is biased: on held-out data, the measured gain is 12 ± 3 % (95 % interval) larger" in found.sentence
    )
    found.save(tmp_path / "check.json")
    assert Check.load(tmp_path / "check.json").sentence == found.sentence


def test_a_model_that_cannot_be_judged_is_still_told_to_have_failed_its_tests(
    checked: Callable[..., Check], exact: Callable[..., NarxModel], rig: Plant, known: dict[str, str]
) -> None:
    found = checked(exact(provenance=known | FAILED | {"free_run": "diverged"}), rig)
    assert found.verdict.value == "fail" and "(ue, where" in found.sentence


def test_a_pi_without_a_proportional_part_says_so(passed: Check) -> None:
    # Lambda tuning cancels a lag only where it is longer than the closed-loop time.
    assert passed.controller is not None and passed.controller.name == "I"
    assert "The controller has no proportional part" in passed.sentence
