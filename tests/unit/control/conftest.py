"""An actuator, a recording of it, and the model that was identified from the recording."""

import numpy as np
import pytest

from deatwin.ident.narx import Frols, NarxModel
from deatwin.plant import Diaphragm, Experiment, Plant, Recording
from deatwin.plant.excitation import band_limited_noise

SAMPLE_TIME = 0.02


@pytest.fixture(scope="session")
def plant() -> Plant:
    return Plant(rig=Diaphragm())


@pytest.fixture(scope="session")
def recording(plant: Plant) -> Recording:
    """A minute of noise up to 1 Hz about 2.4 V."""
    rng = np.random.default_rng(20)
    command = band_limited_noise(rng, 60.0, SAMPLE_TIME)
    bare = Recording.from_arrays(command, np.zeros_like(command), SAMPLE_TIME, start=5.0)
    return plant.record(Experiment(recordings=(bare,)), rng).recordings[0]


@pytest.fixture(scope="session")
def model(recording: Recording) -> NarxModel:
    """Readings end their rows, so that a row's command acts on the row's reading: input lags from 0 on."""
    return Frols(output_lags=2, input_lags=(0, 1, 2), degree=2, max_terms=10).fit(recording).model_
