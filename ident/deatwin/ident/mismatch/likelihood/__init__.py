r"""One likelihood for readings that a plant follows up to structured errors, a fast error and noise.

.. math:: y_j = f_j(\theta) + B_j \beta + L \lambda + g_j + e_j

Everything but the rms :math:`\kappa_j` of g and :math:`\sigma_j` of e is Gaussian and linear about a fit: columns
[J, B, L] in coordinates with standard normal priors, and a stationary rest g + e, which a filter whitens in O(n).
`model` has the data, `whitening` the filter, `laplace` the evidence for given κ and σ, `scales` its integral over
them, `structured` the columns of the plant's own error and of the effects' laws.
"""
