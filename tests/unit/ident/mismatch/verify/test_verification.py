"""What a verification says, in words, in the file and in its picture, of what was found."""

from dataclasses import replace

import pytest

from deatwin.ident.mismatch.verify.constancy import Constancy
from deatwin.ident.mismatch.verify.transfer import Transfer
from deatwin.ident.mismatch.verify.verification import Ablation, Verification


def verification(**fields) -> Verification:
    """One that holds, but for the fields given."""
    held = Verification(
        fitted_before=9e-6,
        fitted_after=2e-6,
        unseen_before=10e-6,
        unseen_after=2.1e-6,
        gain_low=7e-6,
        noise=2e-6,
        output_unit="m",
    )
    return replace(held, **fields)


def test_each_failure_is_said_and_is_enough():
    part = Transfer(
        part="steps.csv", before=2e-6, after=4e-6, gain_low=-3e-6, gain_high=-1e-6, floor=2.2e-6, model_error=1e-6
    )
    taken = Ablation(effect="creep", fitted=2e-6, unseen=2.1e-6, gain_low=-1e-8, share=0.0)
    assert verification().holds
    for failed, said in (
        ({"gain_low": 0.0}, "not certain that the explanation lowers the error on held-out data"),
        ({"ablations": (taken,)}, "rises if creep is removed"),
        ({"transfers": (part,)}, "steps.csv"),
        ({"constancies": (Constancy(effect="delay", own=0.5, change=2.0, deviation=0.1),)}, "the strength of delay"),
    ):
        assert not verification(**failed).holds
        assert said in verification(**failed).failures[0]
    assert verification(gain_low=0.0, counts=True).holds
    within = replace(part, after=2.15e-6)  # worse, but within noise and model error
    uncertain = replace(part, gain_high=1e-7)
    small = replace(part, after=2.23e-6)  # 2.23² - 2.00² is less than 1.00², 2.24² - 2.00² is more
    assert verification(transfers=(within, uncertain, small)).holds
    assert not verification(transfers=(replace(part, after=2.24e-6),)).holds


def test_a_doubt_of_one_effect_is_none_of_the_others():
    sure = Ablation(effect="creep", fitted=4e-6, unseen=5e-6, gain_low=1e-6, share=0.5)
    spared = Ablation(effect="delay", fitted=2.2e-6, unseen=2.2e-6, gain_low=-1e-8, share=0.1)
    both = verification(ablations=(sure, spared))
    assert not both.holds
    assert both.doubted == ("delay",)
    for other in (
        {"ablations": (sure,)},  # nothing is doubted
        {"ablations": (spared,)},  # nothing is left
        {"ablations": (spared, replace(spared, effect="creep"))},  # nothing is certain
        {"ablations": (sure, spared), "gain_low": 0.0},  # the whole is refuted
    ):
        assert verification(**other).doubted == ()


def test_an_effect_that_may_be_absent_is_doubted():
    """Whether its removal raises the error or not; but not beside a refuted whole, nor if all effects are doubted."""
    creep = Ablation(effect="creep", fitted=4e-6, unseen=5e-6, gain_low=1e-6, share=0.5)
    sure, spared = replace(creep, effect="delay"), replace(creep, effect="delay", gain_low=-1e-8)
    for delay in (sure, spared):
        found = verification(ablations=(creep, delay), perhaps_absent=("delay",))
        assert found.doubted == ("delay",)
        assert (
            found.failures[-1] == "the strength of delay may be zero, even at the fitted values of its other parameters"
        )
    assert verification(ablations=(creep, sure), perhaps_absent=("delay",), gain_low=0.0).doubted == ()
    assert verification(ablations=(creep, spared), perhaps_absent=("creep",)).doubted == ()


def test_the_file_has_amplitudes_in_micrometres():
    taken = Ablation(effect="creep", fitted=9e-6, unseen=10e-6, gain_low=7e-6, share=0.97)
    data = verification(ablations=(taken,)).summary
    assert data.gain_low == pytest.approx(7.0) and data.counts is False
    sizes = {name: pytest.approx(size) for name, size in (("fitted", 9.0), ("unseen", 10.0), ("gain_low", 7.0))}
    assert data.ablation == (Ablation(effect="creep", share=0.97, counts=False, **sizes),)
    assert verification(output_unit="V").summary.gain_low == 7e-6


def test_it_draws_every_part(monkeypatch):
    import matplotlib as mpl

    mpl.use("Agg")
    taken = Ablation(effect="creep", fitted=9e-6, unseen=10e-6, gain_low=7e-6, share=0.97)
    part = Transfer(
        part="steps.csv", before=9e-6, after=2e-6, gain_low=6e-6, gain_high=8e-6, floor=2.2e-6, model_error=1e-6
    )
    axes = verification(ablations=(taken,), transfers=(part,)).plot()
    assert [label.get_text() for label in axes.get_yticklabels()] == ["all held-out data", "steps.csv", "without creep"]
    assert "µm" in axes.get_xlabel()
