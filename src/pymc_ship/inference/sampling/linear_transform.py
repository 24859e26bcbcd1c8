"""Linear coordinates of a PyMC variable: NUTS moves in them, the model is stated without them."""

from __future__ import annotations

import numpy as np
import pytensor.tensor as pt
from pymc.distributions.transforms import Transform
from pytensor.tensor.variable import TensorVariable


class LinearTransform(Transform):
    """Coordinates c of a vector x = center + basis c.

    Given as ``transform=`` to a PyMC variable, it changes the coordinates that NUTS moves in and nothing else: the
    density of x, and so the posterior, is the one that the model states. Where the basis is a root of about the
    posterior covariance, c is about standard normal and a chain needs few steps.

    Parameters
    ----------
    center : ndarray, shape (n,)
    basis : ndarray, shape (n, n)
        Not singular.
    """

    name = "linear"

    def __init__(self, center: np.ndarray, basis: np.ndarray):
        self.center, self.basis = center, basis
        self.inverse, self.log_volume = np.linalg.inv(basis), float(np.linalg.slogdet(basis)[1])

    def forward(self, value: TensorVariable, *_: object) -> TensorVariable:
        """Coordinates of a vector."""
        return pt.dot(self.inverse, value - self.center)

    def backward(self, value: TensorVariable, *_: object) -> TensorVariable:
        """Vector at some coordinates."""
        return self.center + pt.dot(self.basis, value)

    def log_jac_det(self, value: TensorVariable, *_: object) -> TensorVariable:
        """Log volume of the basis, whatever the coordinates."""
        return pt.as_tensor(self.log_volume)
