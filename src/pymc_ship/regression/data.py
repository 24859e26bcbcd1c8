"""Design matrix and response of one degree of freedom, their scaling and their conditioning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from textwrap import shorten

import numpy as np
import xarray as xr

from pymc_ship.forces.prime_system import to_prime
from pymc_ship.forces.terms import evaluate
from pymc_ship.machine.arguments import check_choice
from pymc_ship.motion.equations import VELOCITIES
from pymc_ship.motion.prime_record import motion_record, prime_record
from pymc_ship.motion.weak_form import INDEPENDENT, weak_form
from pymc_ship.trial.judgement import judgement
from pymc_ship.trial.record import sampling_interval
from pymc_ship.vessel.vessel import DOFS, Vessel

SCALINGS = ("none", "zscore")
"""How columns and response are scaled: not at all, or to zero mean and unit standard deviation."""

_WITHOUT_DIFFERENCE = {"euler": (0, 1), "central": (1, 1)}
"""Samples at the begin and end of a record that lack a neighbour their difference needs."""

WEAK = {"weak": "rk4", "weak_euler": "euler"}
"""Names of the weak form among the derivatives, and what it takes the record to be."""


class RegressionDataError(ValueError):
    """Data that no regression can use; the sentence says why."""


class ScaledRegression:
    """What posteriors take from regression data, worked out from the scaled columns and how they were scaled.

    A subclass has ``coefficients``, ``column_center``, ``column_scale``, ``response_center``, ``response_scale``,
    ``constant``, ``constant_level``, ``n_rows``, ``scaled_design_matrix`` and ``scaled_response``, documented in
    :class:`RegressionData`.
    """

    def __repr__(self) -> str:
        """Size, origin, names and scaling; no array is written out."""
        labels = ", ".join(filter(None, [self.dof, self.vessel, self.derivative]))
        centred = f"centred on {self.coefficients[self.constant]}" if self.column_center.any() else "not centred"
        return (
            f"{type(self).__name__} of {self.n_rows} rows and {self.n_terms} terms{f' ({labels})' * bool(labels)}\n"
            f"  terms     {shorten(', '.join(self.coefficients), 100, placeholder=' ...')}\n"
            f"  columns   {centred}, scales {self.column_scale.min():.4g} to {self.column_scale.max():.4g}\n"
            f"  response  centre {self.response_center:.4g}, scale {self.response_scale:.4g}"
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


@dataclass(frozen=True, repr=False)
class RegressionData(ScaledRegression):
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
    dof, vessel, derivative, record_verdict, record_remarks : str
        What the rows were made from, and what :func:`pymc_ship.judged_trial` said of the trial.
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
    record_verdict: str = "not checked"
    record_remarks: str = ""

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
            The texts from ``dof`` to ``record_remarks``, kept for the record.

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
        if rows.shape != y.shape:
            raise RegressionDataError(f"The time has one value for each of {len(y)} rows, found shape {rows.shape}.")
        unscaled = {"column_center": np.zeros(len(names)), "column_scale": np.ones(len(names))}
        unscaled |= {"response_center": 0.0, "response_scale": 1.0}
        data = cls(design_matrix=X, response=y, coefficients=names, constant=constant, time=rows, **unscaled, **labels)
        check_choice("The scaling", scaling, SCALINGS, RegressionDataError)
        return data if scaling == "none" else data._zscored(varies)

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
        if spread <= 1e-14 * np.abs(self.response).max():
            raise RegressionDataError("The response must vary over the rows; it is constant: check the trial.")
        return replace(self, column_center=center, column_scale=scale, response_center=middle, response_scale=spread)

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return self.design_matrix.shape[0]

    @property
    def constant_level(self) -> float:
        """Value of the constant column, 0 where there is none."""
        return float(self.design_matrix[0, self.constant]) if self.constant >= 0 else 0.0

    @cached_property
    def scaled_design_matrix(self) -> np.ndarray:
        """Columns that the priors live on, shape (n_rows, n_terms)."""
        return (self.design_matrix - self.column_center) / self.column_scale

    @cached_property
    def scaled_response(self) -> np.ndarray:
        """Response that the priors live on, shape (n_rows,)."""
        return (self.response - self.response_center) / self.response_scale

    def rows(self, index: np.ndarray) -> RegressionData:
        """Return the given rows (integers or mask), with the scaling of the whole."""
        return replace(
            self, design_matrix=self.design_matrix[index], response=self.response[index], time=self.time[index]
        )


def regression_data(
    trial: xr.Dataset,
    vessel: Vessel,
    dof: str,
    *,
    interval: float | None = None,
    derivative: str = "euler",
) -> RegressionData:
    """Design matrix and response of one degree of freedom, from a trial.

    Differences want a denoised trial. The weak form takes the trial as it was measured: its rows are means under
    test functions 10 s long, formed without a derivative, and it denoises the motion in the terms itself. Windows that
    overlap share noise, which no posterior knows of: on a noisy zigzag intervals of 90 % held 48 to 57 % of the
    reference values with a row each 0.5 s, 66 to 70 % at 1 s, 79 to 81 % at 2 s and 85 to 90 % at 4 s.

    Parameters
    ----------
    trial : Dataset, dims (time,)
        u, v [m/s], r [rad/s], delta [rad]; p [rad/s] and phi [rad] where the vessel rolls; uniform time [s].
    vessel : Vessel
        Gives particulars, inertia and the terms of the DOF; its reference coefficients are not used.
    dof : {"surge", "sway", "yaw", "roll"}
    interval : float, optional
        Interval of the rows [s], a multiple of the sampling interval; by default every sample, or about 4 s between
        the centres of test functions.
    derivative : {"euler", "central", "savgol", "weak", "weak_euler"}, optional
        How accelerations are formed from the samples, see :func:`pymc_ship.denoising.derivative.derivative`, or in
        their place the weak form: "weak" for measured records, "weak_euler" exact for Euler steps of the interval.

    Returns
    -------
    RegressionData
        Prime values, z-scored, with the rows that have an acceleration or a whole test function.

    Raises
    ------
    TrialError
        For missing channels, NaN, or time that is not uniform; for the weak form, a trial too short or too coarse.
    RegressionDataError
        When the rudder never moves, the interval is no multiple of the sampling interval, or there are fewer rows than
        terms.
    ValueError
        For an unknown derivative.
    VesselError
        When the vessel has no such DOF.

    References
    ----------
    Xue et al. (2020), Eq. 6 and 21, doi:10.1016/j.oceaneng.2019.106612.

    Examples
    --------
    >>> import pymc_ship as ps
    >>> vessel = ps.load_vessel("kvlcc2")
    >>> trial = ps.simulate(vessel, ps.zigzag(20, 20), duration=600, step=0.5)
    >>> data = ps.regression_data(trial, vessel, "yaw", interval=5.0, derivative="central")
    >>> data.design_matrix.shape, data.coefficients[:3]
    ((119, 10), ('N0', 'Nv', 'Nr'))
    """
    from pymc_ship.denoising.derivative import DERIVATIVES

    check_choice("The derivative", derivative, (*DERIVATIVES, *WEAK))
    terms, record = vessel.terms(dof), motion_record(trial, vessel)
    if np.ptp(record["delta"]) == 0.0:
        raise RegressionDataError("The rudder of a trial must move, found a constant angle; use one that steers.")
    stride = _stride(sampling_interval(trial), interval)
    rows_of = _weak_rows if derivative in WEAK else _difference_rows
    design_matrix, response, time = rows_of(trial, vessel, dof, stride, derivative)
    if time.size < len(terms):
        raise RegressionDataError(
            f"The {dof} of {vessel.name!r} has {len(terms)} terms and needs as many rows, found {time.size}; use a "
            "longer trial or a shorter interval."
        )
    return RegressionData.from_arrays(
        design_matrix,
        response,
        [str(name) for name in vessel.coefficients(dof)["coefficient"].values],
        scaling="zscore",
        time=time,
        dof=dof,
        vessel=vessel.name,
        derivative=derivative,
        **judgement([trial]),
    )


def _difference_rows(
    trial: xr.Dataset, vessel: Vessel, dof: str, stride: int | None, derivative: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Terms, response and time of the samples that have an acceleration."""
    from pymc_ship.denoising.derivative import derivative as differentiate

    record, step = motion_record(trial, vessel), sampling_interval(trial)
    motion, speed, known = prime_record(vessel, record)
    L = vessel.particulars.L
    acceleration = [
        to_prime(f"{name}dot", differentiate(record[name], step, method=derivative), speed, L)
        if name in record
        else np.zeros_like(speed)
        for name in VELOCITIES
    ]
    index = DOFS.index(dof)
    response = vessel.inertia_matrix[index] @ np.array(acceleration) - known[index]
    begin, end = _WITHOUT_DIFFERENCE.get(derivative, (0, 0))
    rows = np.arange(speed.size - end)[:: stride or 1]
    rows = rows[rows >= begin]
    design_matrix = evaluate(vessel.terms(dof), {name: values[rows] for name, values in motion.items()})
    return design_matrix, response[rows], trial["time"].values[rows]


def _weak_rows(
    trial: xr.Dataset, vessel: Vessel, dof: str, stride: int | None, derivative: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Terms, response and centre of the test functions that lie inside the record."""
    stride = stride or round(INDEPENDENT / sampling_interval(trial))
    form = weak_form(trial, vessel, stride=stride, method=WEAK[derivative])
    return form.design_matrices[dof], form.responses[dof], form.time


def _stride(step: float, interval: float | None) -> int | None:
    """Samples from one row to the next; None for the default."""
    if interval is None:
        return None
    ratio = interval / step
    stride = round(ratio) if 0.0 < ratio < np.inf else 0
    if stride < 1 or abs(ratio - stride) > 1e-6 * ratio:
        raise RegressionDataError(
            f"The row interval is a multiple of the sampling interval, found {interval} s at {step:g} s; adjust it."
        )
    return stride


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
