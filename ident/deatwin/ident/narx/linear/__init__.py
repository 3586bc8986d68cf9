"""Linear black boxes as baselines: ARX, ARMAX, output error and Box-Jenkins.

>>> import numpy as np
>>> from deatwin.plant.recording import Recording
>>> u = np.random.default_rng(0).normal(size=200)
>>> y = np.zeros(200)
>>> for k in range(1, 200):
...     y[k] = 0.8 * y[k - 1] + 0.5 * u[k - 1]
>>> model = OutputError(nb=1, nf=1, offset=False).fit(Recording.from_arrays(u, y, 0.1)).model_
>>> print(model)
B1 = 0 + 0.5 q^-1
F1 = 1 - 0.8 q^-1
offset = 0
"""

from deatwin.ident.narx.linear.estimators import Armax, Arx, BoxJenkins, LinearIdentifier, OutputError
from deatwin.ident.narx.linear.model import LinearModel
from deatwin.ident.narx.linear.polynomials import Orders, Polynomials

__all__ = [
    "Armax",
    "Arx",
    "BoxJenkins",
    "LinearIdentifier",
    "LinearModel",
    "Orders",
    "OutputError",
    "Polynomials",
]
