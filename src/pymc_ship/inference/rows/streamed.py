"""Exact posteriors from more rows than memory holds: the rows are read once, in chunks, and reduced to a triangle.

With the QR decomposition [1 X y] = Q R, the rows of R have the same singular values, projections and residual as the
rows of the data, for any prior on the columns. A chunk is reduced by triangularising it under the R so far: as accurate
as the SVD of all rows, without X'X and y'y - b'X'y (Golub & Van Loan, Matrix Computations, 4th ed., 5.2 and 6.5). The
column of ones holds the means, so that columns are centred without a second pass; a large offset would still cost
digits, which is why the means of the first rows are taken off before and given back after.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pymc_ship.inference.rows.scaling import SCALINGS, RegressionDataError, ScaledRegression
from pymc_ship.machine.arguments import check_choice

_BLOCK = 2048
"""Rows triangularised at a time: they stay in a core's cache."""

_ROUND_OFF = 1e-14


@dataclass(frozen=True, repr=False)
class StreamedRegression(ScaledRegression):
    """Regression data reduced to as many rows as there are terms, and two more; posteriors take it as RegressionData.

    :func:`~pymc_ship.inference.regression.conjugate.conjugate`,
    :func:`~pymc_ship.inference.regression.semiconjugate.semiconjugate`,
    :func:`~pymc_ship.inference.sampling.gibbs.gibbs` and :func:`~pymc_ship.inference.regression.tune.maximise_evidence`
    give what they give for all rows; what needs the rows themselves (likelihood of each row, residuals,
    cross-validation) ends with a RegressionDataError.

    Attributes
    ----------
    coefficients : tuple of str
        Names, length n_terms.
    n_rows : int
        Rows that were read.
    scaled_design_matrix : ndarray, shape (n_terms + 2, n_terms)
        Reduced rows of the columns that the priors live on.
    scaled_response : ndarray, shape (n_terms + 2,)
    column_center, column_scale : ndarray, shape (n_terms,)
    response_center, response_scale : float
    constant : int
        Index of the constant column, -1 where there is none.
    constant_level : float
        Its value, 0 where there is none.
    """

    coefficients: tuple[str, ...]
    n_rows: int
    scaled_design_matrix: np.ndarray
    scaled_response: np.ndarray
    column_center: np.ndarray
    column_scale: np.ndarray
    response_center: float
    response_scale: float
    constant: int
    constant_level: float

    dof = vessel = derivative = ""

    @property
    def design_matrix(self) -> np.ndarray:
        """Not kept: RegressionDataError."""
        raise RegressionDataError(
            "A streamed regression keeps no rows, found a use that needs them; draw from conjugate, semiconjugate or "
            "gibbs, or give RegressionData."
        )

    response = time = rows = design_matrix


class _Reduction:
    """Triangle of [1 X-shift y-shift], number of rows, and least and largest value of each column of [X y] so far."""

    def __init__(self, names: tuple[str, ...]):
        self.names, width = names, len(names) + 2
        self.triangle, self.n_rows = np.zeros((width, width)), 0
        self.low, self.high = np.full(width - 1, np.inf), np.full(width - 1, -np.inf)
        self.shift = None

    def add(self, X: np.ndarray, y: np.ndarray) -> None:
        """Take in the rows of one chunk."""
        width = len(self.triangle)
        for begin in range(0, len(y), _BLOCK):
            rows = X[begin : begin + _BLOCK], y[begin : begin + _BLOCK]
            stacked = np.empty((width + len(rows[1]), width))
            stacked[:width] = self.triangle
            stacked[width:, 0], stacked[width:, 1:-1], stacked[width:, -1] = 1.0, *rows
            low, high = stacked[width:, 1:].min(axis=0), stacked[width:, 1:].max(axis=0)
            finite = np.isfinite(low) & np.isfinite(high)
            if not finite.all():
                bad = ", ".join(np.array([*self.names, "the response"])[~finite])
                raise RegressionDataError(
                    f"Regression data must be finite, found NaN or infinity in {bad} among rows "
                    f"{self.n_rows} to {self.n_rows + len(rows[1]) - 1}; clean the data."
                )
            self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)
            self.shift = stacked[width:, 1:].mean(axis=0) if self.shift is None else self.shift
            stacked[width:, 1:] -= self.shift
            self.triangle = np.linalg.qr(stacked, mode="r")
            self.n_rows += len(rows[1])


def stream_regression(
    chunks: Iterable[tuple[np.ndarray, np.ndarray]],
    coefficients: Sequence[str] | None = None,
    *,
    scaling: str = "none",
) -> StreamedRegression:
    """Regression data from rows that are read once, a chunk at a time; memory does not grow with the rows.

    Parameters
    ----------
    chunks : iterable of (ndarray, ndarray)
        Design matrix, shape (n_chunk, n_terms), and response, shape (n_chunk,), of any number of rows.
    coefficients : sequence of str, optional
        Names of the columns; ``x1``, ``x2``, ... by default.
    scaling : {"none", "zscore"}, optional
        As :meth:`pymc_ship.inference.rows.data.RegressionData.from_arrays`, over all rows.

    Returns
    -------
    StreamedRegression

    Raises
    ------
    RegressionDataError
        For no chunk, chunks of wrong or differing shapes, values that are not finite, duplicate names, fewer rows than
        terms, columns without variation.

    Examples
    --------
    Ten chunks of a thousand rows:

    >>> import numpy as np
    >>> import pymc_ship as ps
    >>> def chunks(rng):
    ...     for _ in range(10):
    ...         rows = rng.standard_normal((1000, 2))
    ...         yield rows, rows @ [2.0, -1.0] + 0.1 * rng.standard_normal(1000)
    >>> data = ps.stream_regression(chunks(np.random.default_rng(1)), ["a", "b"])
    >>> data.n_rows
    10000
    >>> print(ps.conjugate(data, ps.ConjugatePrior()).mean.round(2))
    [ 2. -1.]
    """
    check_choice("The scaling", scaling, SCALINGS, RegressionDataError)
    reduction = None
    for number, (design_matrix, response) in enumerate(chunks, start=1):
        X, y = np.asarray(design_matrix, dtype=float), np.asarray(response, dtype=float)
        if X.ndim != 2 or y.shape != X.shape[:1] or not X.shape[1]:
            raise RegressionDataError(
                f"A chunk has a design matrix (rows, terms) and a response (rows,), found shapes {X.shape} and "
                f"{y.shape} in chunk {number}; reshape it."
            )
        reduction = reduction or _Reduction(_names(coefficients, X.shape[1]))
        if X.shape[1] != len(reduction.names):
            raise RegressionDataError(
                f"Chunks have the same columns, found {X.shape[1]} in chunk {number} after {len(reduction.names)}; "
                "give every chunk all columns."
            )
        reduction.add(X, y)
    if reduction is None or reduction.n_rows < len(reduction.names):
        found = "no chunk" if reduction is None else f"{reduction.n_rows} rows for {len(reduction.names)} terms"
        raise RegressionDataError(
            f"A streamed regression needs at least as many rows as terms, found {found}; give RegressionData."
        )
    return _scaled(reduction, scaling)


def _names(coefficients: Sequence[str] | None, n_terms: int) -> tuple[str, ...]:
    names = tuple(coefficients) if coefficients is not None else tuple(f"x{j + 1}" for j in range(n_terms))
    if len(names) != n_terms or len(set(names)) != n_terms:
        raise RegressionDataError(
            f"Each of the {n_terms} columns has a name of its own, found {', '.join(names)}; rename them."
        )
    return names


def _scaled(reduction: _Reduction, scaling: str) -> StreamedRegression:
    """Centre and scale the reduced rows as RegressionData does the rows themselves."""
    names, n_terms = reduction.names, len(reduction.names)
    largest = np.maximum(np.abs(reduction.low), np.abs(reduction.high))
    varies = reduction.high - reduction.low > _ROUND_OFF * largest
    constants = np.flatnonzero(~varies[:-1] & (reduction.low[:-1] != 0.0))
    constant = int(constants[0]) if constants.size else -1
    level = float(reduction.low[constant]) if constants.size else 0.0
    ones, rows = reduction.triangle[0, 0], reduction.triangle[:, 1:].copy()
    rows[0] += ones * reduction.shift
    center, scale = np.zeros(n_terms + 1), np.ones(n_terms + 1)
    if scaling == "zscore":
        idle = [name for j, name in enumerate(names) if not varies[j] and j != constant]
        if idle:
            raise RegressionDataError(
                f"A z-scored column must vary over the rows; {', '.join(idle)} did not: leave the terms out."
            )
        if constants.size:
            center = rows[0] / ones
            rows[0] = 0.0
            center[constant], rows[:, constant], rows[0, constant] = 0.0, 0.0, level * ones
        scale = np.sqrt(np.sum(rows**2, axis=0) / reduction.n_rows)
        if scale[-1] <= _ROUND_OFF * largest[-1]:
            raise RegressionDataError("The response must vary over the rows; it is constant: check the data.")
        rows /= scale
    return StreamedRegression(
        coefficients=names,
        n_rows=reduction.n_rows,
        scaled_design_matrix=rows[:, :-1],
        scaled_response=rows[:, -1],
        column_center=center[:-1],
        column_scale=scale[:-1],
        response_center=float(center[-1]),
        response_scale=float(scale[-1]),
        constant=constant,
        constant_level=level,
    )
