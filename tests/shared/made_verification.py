"""A verification with a finding of each kind: placebos, held-out parts and strengths that stand and that do not."""

from deatwin.ident.mismatch.result import Ablation
from deatwin.ident.mismatch.verify.constancy import Constancy
from deatwin.ident.mismatch.verify.placebos import Placebo, PlaceboKind
from deatwin.ident.mismatch.verify.transfer import Transfer
from deatwin.ident.mismatch.verify.verification import Verification

VERIFIED = Verification(
    fitted_before=9e-6,
    fitted_after=2e-6,
    unseen_before=10.2e-6,
    unseen_after=2.13e-6,
    gain_low=7.4e-6,
    noise=2e-6,
    output_unit="m",
    ablations=(Ablation(effect="creep", fitted=9e-6, unseen=10.2e-6, gain_low=7.4e-6, share=0.968),),
    shams=(
        Placebo(effect="creep", kind=PlaceboKind.BACKWARDS, share=0.0312, expected=0.02),
        Placebo(effect="creep", kind=PlaceboKind.OPPOSITE, share=0.9124, expected=0.0),
        Placebo(effect="creep", kind=PlaceboKind.RANDOM_PHASES, skipped="it hardly differs"),
    ),
    transfers=(
        Transfer(
            part="steps.csv", before=11e-6, after=2.2e-6, gain_low=8e-6, gain_high=9e-6, floor=2.3e-6, model_error=1e-6
        ),
        Transfer(
            part="lowest amplitudes",
            before=2e-6,
            after=6.78e-6,
            gain_low=-5e-6,
            gain_high=-4e-6,
            floor=2.3e-6,
            model_error=1e-6,
        ),
    ),
    constancies=(
        Constancy(effect="creep", change=-1.264, deviation=0.083, own=0.5),
        Constancy(effect="delay", own=0.04),
    ),
)
