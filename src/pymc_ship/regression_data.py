"""Design matrix and response of one degree of freedom, their scaling and their conditioning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np


class RegressionDataError(ValueError):
    """Data that no regression can use; the sentence says why."""


@dataclass(frozen=True)
class RegressionData:
    """Regression data of one response, in original units, with the scaling that priors live on.

    With ``s_j`` and ``c_j`` the scale and centre of column j and ``s``, ``c`` those of the response, the scaled
    coefficients b* obey (y - c)/s = sum_j b*_j (x_j - c_j)/s_j + e. Columns are centred only when the design holds a
    constant column, which then takes up the shift; so b = offset + T b* maps back exactly.

    Attributes
    ----------
    design_matrix : ndarray, shape (n_rows, n_terms)
    response : ndarray, shape (n_rows,)
    coefficients : tuple of str
        Names, length n_terms.
    column_center, column_scale : ndarray, shape (n_terms,)
    response_center, response_scale : float
    constant : int
        Index of the constant column, -1 where there is none.
    time : ndarray, shape (n_rows,)
        Coordinate of the rows [s]; the row number where no time is known.
    dof, vessel, derivative : str
        What the rows were made from; empty for plain arrays.
    """

    design_matrix: np.ndarray
    response: np.ndarray
    coefficients: tuple[str, ...]
    column_center: np.ndarray
    column_scale: np.ndarray
    response_center: float
    response_scale: float
    constant: int
    time: np.ndarray
    dof: str = ""
    vessel: str = ""
    derivative: str = ""

    @classmethod
    def from_arrays(
        cls,
        design_matrix: np.ndarray,
        response: np.ndarray,
        coefficients: Sequence[str] | None = None,
        *,
        scaling: str = "none",
        time: np.ndarray | None = None,
        **labels: str,
    ) -> RegressionData:
        """Regression data from plain arrays.

        Parameters
        ----------
        design_matrix : array_like, shape (n_rows, n_terms)
        response : array_like, shape (n_rows,)
        coefficients : sequence of str, optional
            Names of the columns; ``x1``, ``x2``, ... by default.
        scaling : {"none", "zscore"}, optional
            Whether priors live on the columns as they are or on columns (and response) of unit mean square, centred
            where the design holds a constant column.
        time : array_like, shape (n_rows,), optional
            Coordinate of the rows [s].
        **labels : str
            ``dof``, ``vessel`` and ``derivative``, kept for the record.

        Returns
        -------
        RegressionData

        Raises
        ------
        RegressionDataError
            For wrong shapes, values that are not finite, duplicate names, columns without variation.
        """
        X = np.array(design_matrix, dtype=float, order="C")
        y = np.array(response, dtype=float)
        if X.ndim != 2 or X.size == 0:
            raise RegressionDataError(f"A design matrix has shape (rows, terms), found {X.shape}; reshape it.")
        names = tuple(coefficients) if coefficients is not None else tuple(f"x{j + 1}" for j in range(X.shape[1]))
        _check(X, y, names)
        varies = np.ptp(X, axis=0) > 1e-14 * np.abs(X).max(axis=0)
        constants = np.flatnonzero(~varies & (X[0] != 0.0))
        constant = int(constants[0]) if constants.size else -1
        rows = np.arange(len(y), dtype=float) if time is None else np.array(time, dtype=float)
        data = cls(X, y, names, np.zeros(len(names)), np.ones(len(names)), 0.0, 1.0, constant, rows, **labels)
        if scaling == "none":
            return data
        if scaling != "zscore":
            raise RegressionDataError(f"The scaling is 'none' or 'zscore', found {scaling!r}; choose one of them.")
        return data._zscored(varies)

    def _zscored(self, varies: np.ndarray) -> RegressionData:
        idle = [name for j, name in enumerate(self.coefficients) if not varies[j] and j != self.constant]
        if idle:
            raise RegressionDataError(
                f"A z-scored column must vary over the rows; {', '.join(idle)} did not: leave the terms out or use a "
                "trial that excites them."
            )
        center = self.design_matrix.mean(axis=0) if self.constant >= 0 else np.zeros(self.n_terms)
        middle = float(self.response.mean()) if self.constant >= 0 else 0.0
        scale = np.sqrt(np.mean((self.design_matrix - center) ** 2, axis=0))
        if self.constant >= 0:
            center[self.constant] = 0.0
            scale[self.constant] = abs(self.design_matrix[0, self.constant])
        spread = float(np.sqrt(np.mean((self.response - middle) ** 2)))
        if spread == 0.0:
            raise RegressionDataError("The response must vary over the rows; it is constant: check the trial.")
        return replace(self, column_center=center, column_scale=scale, response_center=middle, response_scale=spread)

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return self.design_matrix.shape[0]

    @property
    def n_terms(self) -> int:
        """Number of columns."""
        return self.design_matrix.shape[1]

    @cached_property
    def scaled_design_matrix(self) -> np.ndarray:
        """Columns that the priors live on, shape (n_rows, n_terms)."""
        return (self.design_matrix - self.column_center) / self.column_scale

    @cached_property
    def scaled_response(self) -> np.ndarray:
        """Response that the priors live on, shape (n_rows,)."""
        return (self.response - self.response_center) / self.response_scale

    @cached_property
    def svd(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Thin singular value decomposition (left, singular_values, right transposed) of the scaled design."""
        return np.linalg.svd(self.scaled_design_matrix, full_matrices=False)

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
            level = self.design_matrix[0, self.constant]
            T[self.constant] -= self.column_center @ T / level
            offset[self.constant] = self.response_center / level
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

    def rows(self, index: np.ndarray) -> RegressionData:
        """Return the given rows (integers or mask), with the scaling of the whole."""
        return replace(
            self, design_matrix=self.design_matrix[index], response=self.response[index], time=self.time[index]
        )


def _check(X: np.ndarray, y: np.ndarray, names: tuple[str, ...]) -> None:
    if y.shape != (X.shape[0],):
        raise RegressionDataError(f"The response has one value for each of {X.shape[0]} rows, found shape {y.shape}.")
    if len(names) != X.shape[1]:
        raise RegressionDataError(f"Each of the {X.shape[1]} columns has one name, found {len(names)} names.")
    if len(set(names)) != len(names):
        twice = sorted({name for name in names if names.count(name) > 1})
        raise RegressionDataError(f"Coefficient names must differ, found {', '.join(twice)} more than once.")
    bad = [name for j, name in enumerate(names) if not np.isfinite(X[:, j]).all()]
    if bad or not np.isfinite(y).all():
        where = ", ".join(bad) if bad else "the response"
        raise RegressionDataError(f"Regression data must be finite, found NaN or infinity in {where}; clean the trial.")
