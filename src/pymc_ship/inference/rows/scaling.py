"""Scaled columns of a regression: what every posterior takes from its rows, however many they are."""

from __future__ import annotations

from functools import cached_property
from textwrap import shorten

import numpy as np

SCALINGS = ("none", "zscore")
"""How columns and response are scaled: not at all, or to zero mean and unit standard deviation."""


UNEVEN = 30.0
"""Ratio of the largest to the smallest column from which an unscaled design is ill-conditioned for that alone.

The ratio is a lower bound of the condition number, and a condition number of 30 is where Belsley, Kuh & Welsch (1980),
Regression Diagnostics, doi:10.1002/0471725153, ch. 3, see harm; they scale the columns to equal length first.
"""

SIZED_ROWS = 4
"""Rows from which a column has a size: of 28 columns of standard normal numbers, as many as a degree of freedom of the
container ship has, the largest is ``UNEVEN`` times the smallest in four of five single rows, in less than 1 of 1000
sets of four rows."""


class ScaledRegression:
    """What posteriors take from regression data, worked out from the scaled columns and how they were scaled.

    A subclass has ``coefficients``, ``column_center``, ``column_scale``, ``response_center``, ``response_scale``,
    ``constant``, ``constant_level``, ``n_rows``, ``scaled_design_matrix`` and ``scaled_response``, documented in
    :class:`RegressionData`.
    """

    formula = None

    def __repr__(self) -> str:
        """Size, origin, names, scaling, and a remark on uneven columns; no array is written out."""
        labels = ", ".join(filter(None, [self.dof, self.vessel, self.derivative]))
        centred = f"centred on {self.coefficients[self.constant]}" if self.column_center.any() else "not centred"
        return (
            f"{type(self).__name__} of {self.n_rows} rows and {self.n_terms} terms{f' ({labels})' * bool(labels)}\n"
            f"  terms     {shorten(', '.join(self.coefficients), 100, placeholder=' ...')}\n"
            f"  columns   {centred}, scales {self.column_scale.min():.4g} to {self.column_scale.max():.4g}\n"
            f"  response  centre {self.response_center:.4g}, scale {self.response_scale:.4g}"
            + (f"\n  remark    {self.uneven}" if self.uneven else "")
        )

    @cached_property
    def uneven(self) -> str:
        """Sentence on columns of very different size, for which one prior variance is no default; else empty."""
        size = np.sqrt(np.sum(self.scaled_design_matrix**2, axis=0) / self.n_rows)
        small, large = min(size[size > 0.0], default=0.0), size.max()
        if large <= UNEVEN * small or self.n_rows < SIZED_ROWS:
            return ""
        names = [self.coefficients[list(size).index(value)] for value in (small, large)]
        return (
            f"The columns must be of one size where all have the same prior, found {names[0]} of {small:.2g} and "
            f"{names[1]} of {large:.2g}; take scaling='zscore' or a kappa for each column."
        )

    @property
    def n_terms(self) -> int:
        """Number of columns."""
        return len(self.coefficients)

    @cached_property
    def svd(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Thin singular value decomposition (left, singular_values, right transposed) of the scaled design."""
        return np.linalg.svd(self.scaled_design_matrix, full_matrices=False)

    @cached_property
    def projection(self) -> tuple[np.ndarray, float]:
        """Scaled response along the left singular vectors, and the square of what lies outside them."""
        left, _, _ = self.svd
        z = left.T @ self.scaled_response
        return z, float(np.sum((self.scaled_response - left @ z) ** 2))

    @property
    def least_squares(self) -> np.ndarray:
        """Least-squares coefficients of the original columns (of least norm on the scaled ones), shape (n_terms,)."""
        _, s, right = self.svd
        kept = s > s[0] * max(self.n_rows, self.n_terms) * np.finfo(float).eps
        return self.to_original(self.projection[0][kept] / s[kept] @ right[kept])

    @property
    def condition_number(self) -> float:
        """Largest over smallest singular value of the scaled design; infinite for more terms than rows."""
        s = self.svd[1]
        if self.n_terms > self.n_rows or s[-1] == 0.0:
            return float("inf")
        return float(s[0] / s[-1])

    @property
    def variance_inflation_factors(self) -> np.ndarray:
        """Factor by which collinearity inflates the variance of each coefficient, shape (n_terms,)."""
        if not np.isfinite(self.condition_number):
            return np.full(self.n_terms, np.inf)
        _, s, right = self.svd
        return np.sum((right / s[:, None]) ** 2, axis=0) * np.sum(self.scaled_design_matrix**2, axis=0)

    @cached_property
    def transformation(self) -> tuple[np.ndarray, np.ndarray]:
        """Offset (n_terms,) and matrix T (n_terms, n_terms) of b = offset + T b*."""
        T = np.diag(self.response_scale / self.column_scale)
        offset = np.zeros(self.n_terms)
        if self.constant >= 0:
            T[self.constant] -= self.column_center @ T / self.constant_level
            offset[self.constant] = self.response_center / self.constant_level
        return offset, T

    def to_original(self, scaled: np.ndarray) -> np.ndarray:
        """Map scaled coefficients, shape (..., n_terms), to those of the original columns."""
        offset, T = self.transformation
        return offset + scaled @ T.T

    def to_scaled(self, original: np.ndarray) -> np.ndarray:
        """Map coefficients of the original columns, shape (..., n_terms), to the scaled ones."""
        offset, T = self.transformation
        shifted = np.asarray(original, dtype=float) - offset
        return np.linalg.solve(T, shifted.reshape(-1, self.n_terms).T).T.reshape(shifted.shape)
