"""Linear coordinates of a PyMC variable: NUTS moves in them, the model is stated without them."""

from __future__ import annotations

import numpy as np
import pytensor.tensor as pt
from pymc.distributions.transforms import Transform


class LinearTransform(Transform):
    """Coordinates c of an array x = center + basis c, its values in one line.

    Given as ``transform=`` to a PyMC variable, it changes the coordinates that NUTS moves in and nothing else: the
    density of x, and so the posterior, is the one that the model states. Where the basis is a root of about the
    posterior covariance, c is about standard normal and a chain needs few steps.

    Parameters
    ----------
    center : ndarray of any shape, of n values
    basis : ndarray, shape (n, n)
        Not singular.
    """

    name = "linear"

    def __init__(self, center: np.ndarray, basis: np.ndarray):
        self.center, self.basis = center, basis
        self.inverse, self.log_volume = np.linalg.inv(basis), float(np.linalg.slogdet(basis)[1])

    def forward(self, value, *_):
        """Coordinates of an array, in its shape."""
        return pt.dot(self.inverse, (value - self.center).ravel()).reshape(self.center.shape)

    def backward(self, value, *_):
        """Array at some coordinates."""
        return self.center + pt.dot(self.basis, value.ravel()).reshape(self.center.shape)

    def log_jac_det(self, value, *_):
        """Log volume of the basis, whatever the coordinates."""
        return pt.as_tensor(self.log_volume)
