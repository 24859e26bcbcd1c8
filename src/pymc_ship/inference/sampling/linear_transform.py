"""Linear coordinates of a PyMC variable for NUTS: they change the path of the sampler, not the posterior."""

from __future__ import annotations

import numpy as np
import pytensor.tensor as pt
from pymc.distributions.transforms import Transform
from pytensor.tensor.variable import TensorVariable


class LinearTransform(Transform):
    """Coordinates c of a vector x = center + basis c, center (n,), basis (n, n) not singular."""

    name = "linear"

    def __init__(self, center: np.ndarray, basis: np.ndarray):
        self.center, self.basis = center, basis
        self.inverse, self.log_volume = np.linalg.inv(basis), float(np.linalg.slogdet(basis)[1])

    def forward(self, value: TensorVariable, *_: object) -> TensorVariable:
        """Coordinates of a vector."""
        return pt.dot(self.inverse, value - self.center)

    def backward(self, value: TensorVariable, *_: object) -> TensorVariable:
        """Vector of coordinates."""
        return self.center + pt.dot(self.basis, value)

    def log_jac_det(self, value: TensorVariable, *_: object) -> TensorVariable:
        """Log determinant of the basis."""
        return pt.as_tensor(self.log_volume)
