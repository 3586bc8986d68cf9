"""Other packages' polynomials as our models: their own free runs, and what is said where they are not installed."""

import numpy as np
import pytest

from deatwin.ident.narx.model import NarxModel
from deatwin.plant.errors import ModelError
from deatwin.plant.recording import Recording
from deatwin.studies.public import black_boxes
from deatwin.studies.public.black_boxes import Fastcan, SysIdentPy
from deatwin.studies.public.records import Learner


def drawn(seed: int = 0) -> Recording:
    rng = np.random.default_rng(seed)
    u, y = rng.uniform(-1, 1, 300), np.zeros(300)
    for k in range(2, 300):
        y[k] = 0.5 * y[k - 1] - 0.2 * y[k - 2] * u[k - 1] + 0.4 * u[k - 2] ** 2 + 0.3
    return Recording.from_arrays(u, y, 0.1)


def learned(peer: Learner) -> NarxModel:
    try:
        return peer.fit(drawn()).model_
    except ModelError:
        pytest.skip("the package is not installed")


@pytest.mark.parametrize("kind", [SysIdentPy, Fastcan])
def test_the_true_terms_are_read_out_of_a_peer_s_model(kind):
    model = learned(kind(lags=2, degree=2, terms=4))
    found = {str(term): value for term, value in zip(model.terms, model.theta, strict=True) if abs(value) > 1e-6}
    true = {"y(k-1)": 0.5, "y(k-2)u(k-1)": -0.2, "u(k-2)^2": 0.4, "1": 0.3}
    assert found == pytest.approx(true, abs=1e-6)
    assert model.simulate(drawn(1)).rms_error < 1e-6


@pytest.mark.parametrize("kind", [SysIdentPy, Fastcan])
def test_a_package_that_is_not_installed_is_said_so(kind, monkeypatch):
    def absent(name: str) -> None:
        raise ModuleNotFoundError(name)

    monkeypatch.setattr(black_boxes, "import_module", absent)
    with pytest.raises(ModelError, match=r"^not installed \(extra compare\)$"):
        kind(lags=1, degree=1, terms=1).fit(drawn())
