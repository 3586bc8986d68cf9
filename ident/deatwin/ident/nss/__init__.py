"""Nonlinear state spaces: polynomials and functions of states and inputs, fitted by the free run.

>>> import numpy as np
>>> from deatwin.plant.recording import Recording
>>> u = np.random.default_rng(0).uniform(-1, 1, 400)
>>> x = np.zeros(401)
>>> for k in range(400):
...     x[k + 1] = 0.7 * x[k] + u[k] - 0.2 * x[k] ** 3
>>> model = Pnlss(states=1, degrees=[3], feedthrough=False).fit(Recording.from_arrays(u, x[:-1], 0.1)).model_
>>> bool(model.simulate(Recording.from_arrays(u, x[:-1], 0.1)).rms_error < 1e-6)
True
"""

from deatwin.ident.nss.cascade import Cascade
from deatwin.ident.nss.identifier import StateSpaceIdentifier
from deatwin.ident.nss.model import NonlinearStateSpace
from deatwin.ident.nss.pnlss import Pnlss

__all__ = ["Cascade", "NonlinearStateSpace", "Pnlss", "StateSpaceIdentifier"]
