"""The recording of the demo, and the thinning of long records for figures."""

from dataclasses import replace

import numpy as np

from deatwin.app.demo import NOISE_SECONDS, SHARES, conceal
from deatwin.plant import Creep, Diaphragm, Plant
from deatwin.plant.drawing import envelope


def test_the_film_is_not_quite_the_nominal_one_and_has_the_effect():
    nominal = Plant(rig=replace(Diaphragm(), ball_is_known=True))
    effect = Creep(modulus=52e3)
    truth, experiment = conceal(nominal, effect, np.random.default_rng(0))
    again, same = conceal(nominal, effect, np.random.default_rng(0))
    assert truth.effect_names == ("creep",)
    assert truth.parameters["creep.modulus"].value == 52e3
    for name, share in SHARES.items():
        ratio = truth.parameters[name].value / nominal.parameters[name].value
        assert ratio == again.parameters[name].value / nominal.parameters[name].value
        assert 0 < abs(ratio - 1) <= share
    for record, twin in zip(experiment.recordings, same.recordings, strict=True):
        np.testing.assert_array_equal(record.outputs, twin.outputs)
    assert [record.start for record in experiment.recordings] == [0.0, NOISE_SECONDS]


def test_an_envelope_keeps_the_extremes():
    values = np.random.default_rng(0).standard_normal(10_007)
    timepts = np.arange(values.size) * 0.02
    times, kept = envelope(timepts, values, columns=300)
    assert kept.size <= 602
    assert (np.diff(times) > 0).all()
    assert kept.min() == values.min()
    assert kept.max() == values.max()
    np.testing.assert_array_equal(envelope(timepts[:500], values[:500])[1], values[:500])
