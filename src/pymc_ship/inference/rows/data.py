"""Design matrix and response of one degree of freedom, their scaling and their conditioning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from textwrap import shorten
from typing import Any

import numpy as np

from pymc_ship.inference.rows import frames
from pymc_ship.machine.arguments import check_choice, check_kind, label_array, name_list, real_array
from pymc_ship.machine.errors import InferenceError

ROUNDING = 1e-10
"""Range over largest magnitude below which values are constant but for rounding; sixteen eps of coarser floats."""

UNEVEN = 30.0
"""Largest over smallest column norm above which an unscaled design is called uneven: a lower bound of the condition
number, with the limit of Belsley, Kuh & Welsch (1980), Regression Diagnostics, doi:10.1002/0471725153, ch. 3."""

LABELS = ("vessel", "dof", "derivative", "record_verdict", "record_remarks")
"""Texts on the origin of the rows."""

_SMALLEST, _LARGEST = 1e-100, 1e100  # magnitudes of columns and response
FEWEST_ROWS = 4  # rows that sizes of columns and response are judged over, at least


@dataclass(frozen=True, eq=False, repr=False)
class RegressionData:
    """Regression data of one response.

    With s_j, c_j the scale and centre of column j and s, c those of the response, the scaled coefficients b* obey
    (y - c)/s = sum_j b*_j (x_j - c_j)/s_j + e, and b = offset + T b*. Columns are centred if one column is constant.

    Attributes
    ----------
    design_matrix, response : ndarray, shape (n_rows, n_terms), (n_rows,)
        The n_terms columns are named by ``coefficients``.
    column_center, column_scale : ndarray, shape (n_terms,)
        Those of the response are the floats ``response_center`` and ``response_scale``.
    constant : int
        Index of the constant column, -1 where there is none.
    time, run : ndarray, shape (n_rows,)
        Coordinate of the rows [s], or the row number; label of the run, "1" for a single trial.
    dof, vessel, derivative, record_verdict, record_remarks : str
        Origin of the rows, and quality flags of the trial.
    fixed : mapping of str to float
        Values of coefficients whose part is subtracted, from :func:`pymc_ship.hold_fixed`.

    Arrays are read-only.
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
    run: np.ndarray
    dof: str = ""
    vessel: str = ""
    derivative: str = ""
    record_verdict: str = "not checked"
    record_remarks: str = ""
    formula: frames.Formula | None = None
    fixed: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in ("design_matrix", "response", "column_center", "column_scale", "time", "run"):
            values = np.asarray(getattr(self, name))
            if values.flags.writeable:  # decompositions are kept
                values = values.view()
                values.setflags(write=False)
            object.__setattr__(self, name, values)

    def __getstate__(self) -> dict[str, Any]:
        return {one.name: getattr(self, one.name) for one in fields(self)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self.__post_init__()  # copied and read arrays are writeable

    @classmethod
    def from_formula(
        cls,
        formula: str,
        frame: Any,
        *,
        scaling: str = "zscore",
        time: np.ndarray | None = None,
        run: Sequence[str] | np.ndarray | None = None,
        **labels: str,
    ) -> RegressionData:
        """Regression data from a formula of Bambi (doi:10.18637/jss.v103.i15) and a table of its variables.

        Needs formulae, which ``pymc-ship[formula]`` installs. Posteriors of these data predict from new tables.

        Parameters
        ----------
        formula : str
            Such as ``"Y ~ v + r + v:r + I(delta**2)"``; ``0 +`` removes the intercept.
        frame : DataFrame
            Without gaps in the columns of the formula.
        scaling, time, run, **labels
            As :meth:`from_arrays`.

        Raises
        ------
        InferenceError
            Without formulae, for a formula with group-level terms or that does not fit, and as :meth:`from_arrays`.
        """
        design_matrix, response, parsed_formula = frames.formula_rows(formula, frame)
        for what, column in {"time": time, "run": run}.items():
            frames.check_same_rows(frame, column, what)
        given: dict[str, Any] = {"scaling": scaling, "time": time, "run": run, **labels}
        data = cls.from_arrays(design_matrix, response, parsed_formula.names, **given)
        return replace(data, formula=parsed_formula)

    @classmethod
    def from_arrays(
        cls,
        design_matrix: Any,
        response: np.ndarray,
        coefficients: Sequence[str] | None = None,
        *,
        scaling: str = "zscore",
        time: np.ndarray | None = None,
        run: Sequence[str] | np.ndarray | None = None,
        **labels: str,
    ) -> RegressionData:
        """Regression data from plain arrays, or from a table.

        Parameters
        ----------
        design_matrix : array_like, shape (n_rows, n_terms), or DataFrame
        response : array_like, shape (n_rows,)
        coefficients : sequence of str, optional
            Names of the columns, ``x1``, ``x2``, ... by default; for a DataFrame or a labelled array of xarray the
            columns to use, all by default.
        scaling : {"zscore", "none"}, optional
            "zscore": priors are of columns and response of unit mean square, centred if one column is constant, so
            that units do not matter; "none": priors are in the units given.
        time, run : array_like of float and of str, shape (n_rows,), optional
            Coordinate [s] and run of each row.
        **labels : str
            The attributes from ``dof`` to ``record_remarks``.

        Raises
        ------
        InferenceError
            For wrong shapes, values masked, missing, complex or not finite, missing or repeated names, z-scored
            columns or response without variation, or a table or labelled array and a response of different index.
        """
        rounding = _rounding(design_matrix.to_numpy() if frames.is_frame(design_matrix) else design_matrix)
        given = frames.column_names(design_matrix)
        if coefficients is not None:
            given = name_list("Coefficient names", coefficients, InferenceError)
        if given is not None and not frames.is_frame(design_matrix):
            design_matrix = frames.by_label(design_matrix, given, "The rows")
        for what, column in {"response": response, "time": time, "run": run}.items():
            frames.check_same_rows(design_matrix, column, what)
        if frames.is_frame(design_matrix):
            design_matrix = frames.frame_columns(design_matrix, given or (), "The rows")
        X = real_array("The design matrix", design_matrix, InferenceError)
        y = real_array("The response", response, InferenceError)
        if X.ndim != 2 or X.size == 0:
            raise InferenceError(f"A design matrix has shape (rows, terms), found {X.shape}; reshape it.")
        names = tuple(f"x{j + 1}" for j in range(X.shape[1])) if given is None else given
        times = np.arange(len(y), dtype=float) if time is None else real_array("The time", time, InferenceError)
        runs = np.full(len(y), "1") if run is None else label_array("The run", run, InferenceError)
        _check(X, y, names, times, runs)
        varies = np.ptp(X, axis=0) > rounding * np.abs(X).max(axis=0)
        constants = np.flatnonzero(~varies & (X[0] != 0.0))
        constant = int(constants[0]) if constants.size else -1
        for label, text in labels.items():
            check_choice("A label of regression data", label, LABELS, InferenceError)
            check_kind(f"The label {label}", text, str, "give a text", InferenceError)
        values: dict[str, Any] = {"column_center": np.zeros(len(names)), "column_scale": np.ones(len(names)), **labels}
        values |= {"response_center": 0.0, "response_scale": 1.0, "constant": constant, "time": times, "run": runs}
        data = cls(X, y, names, **values)
        check_choice("The scaling", scaling, ("zscore", "none"), InferenceError)
        if scaling == "none":
            return data
        if np.ptp(y) <= _rounding(response) * np.abs(y).max():
            raise InferenceError(
                "A z-scored response must vary over the rows, found a constant; check it or take scaling='none'."
            )
        return data._zscore(varies)

    def _zscore(self, varies: np.ndarray) -> RegressionData:
        idle = [name for j, name in enumerate(self.coefficients) if not varies[j] and j != self.constant]
        if idle:
            raise InferenceError(
                f"A z-scored column must vary over the rows; {', '.join(idle)} did not: leave the terms out or use "
                "rows that excite them."
            )
        center, scale = _center_and_size(self.design_matrix, self.constant >= 0)
        if self.constant >= 0:
            center[self.constant], scale[self.constant] = 0.0, abs(self.constant_level)
        middle, size = map(float, _center_and_size(self.response, self.constant >= 0))
        return replace(self, column_center=center, column_scale=scale, response_center=middle, response_scale=size)

    def __repr__(self) -> str:
        labels = ", ".join(filter(None, [self.dof, self.vessel, self.derivative]))
        centred = f"centred on {self.coefficients[self.constant]}" if self.column_center.any() else "not centred"
        return (
            f"{type(self).__name__} of {self.n_rows} rows and {self.n_terms} terms{f' ({labels})' * bool(labels)}\n"
            f"  terms     {shorten(', '.join(self.coefficients), 100, placeholder=' ...')}\n"
            f"  columns   {centred}, scales {self.column_scale.min():.4g} to {self.column_scale.max():.4g}\n"
            f"  response  centre {self.response_center:.4g}, scale {self.response_scale:.4g}"
            + "".join(f"\n  remark    {remark}" for remark in (self.uneven, self.dependent, self.repeated) if remark)
        )

    @property
    def n_rows(self) -> int:
        """Number of rows."""
        return self.design_matrix.shape[0]

    @property
    def n_terms(self) -> int:
        """Number of columns."""
        return len(self.coefficients)

    @property
    def constant_level(self) -> float:
        """Value of the constant column, 0 where there is none."""
        return float(self.design_matrix[0, self.constant]) if self.constant >= 0 else 0.0

    @cached_property
    def scaled_design_matrix(self) -> np.ndarray:
        """Scaled columns, shape (n_rows, n_terms)."""
        return (self.design_matrix - self.column_center) / self.column_scale

    @cached_property
    def scaled_response(self) -> np.ndarray:
        """Scaled response, shape (n_rows,)."""
        return (self.response - self.response_center) / self.response_scale

    def rows(self, index: np.ndarray | slice | Sequence[int]) -> RegressionData:
        """Data of the given rows (integers or mask), scaled as the whole; InferenceError for none or other rows."""
        n = self.n_rows
        index = np.arange(n)[index] if isinstance(index, slice) else np.asarray(index)
        chosen = np.count_nonzero(index) if index.dtype.kind == "b" else index.size
        if not chosen or index.dtype.kind not in "biu":
            raise InferenceError(
                f"Rows are given by integers or a mask, one or more, found {chosen} of type {index.dtype}; choose some."
            )
        inside = index.size == n if index.dtype.kind == "b" else -n <= index.min() and index.max() < n
        if index.ndim != 1 or not inside:
            raise InferenceError(
                f"Rows are a list of integers up to {n - 1} or a mask of {n} values, found shape {index.shape} with "
                f"{index.min()} to {index.max()}; correct it."
            )
        names = ("design_matrix", "response", "time", "run")
        return replace(self, **{name: getattr(self, name)[index] for name in names})

    @property
    def order(self) -> np.ndarray:
        """Row numbers in order of time, run after run, shape (n_rows,)."""
        labels = list(dict.fromkeys(self.run.tolist()))
        return np.lexsort((self.time, np.array([labels.index(run) for run in self.run.tolist()])))

    @property
    def is_scaled(self) -> bool:
        """Whether the prior is of scaled columns or a scaled response."""
        return self.response_scale != 1.0 or bool((self.column_scale != 1.0).any())

    def rescaled_rows(self, index: np.ndarray) -> RegressionData:
        """Data of the given rows, scaled by these rows alone if the whole is scaled.

        A column that does not vary over the rows keeps its scale. InferenceError if the response does not vary.
        """
        part, centred = self.rows(index), self.constant >= 0
        if not self.is_scaled:
            return part
        scales, centers = [], []
        for name, scale in (("design_matrix", self.column_scale), ("response", self.response_scale)):
            values = getattr(part, name)
            center, size = _center_and_size(values, centred)
            varies = size > ROUNDING * np.abs(values).max(axis=0)
            whole = _center_and_size(getattr(self, name), centred)[1]
            scales.append(scale * np.divide(size, whole, out=np.ones_like(whole), where=varies))
            centers.append(center)
        if not varies:
            raise InferenceError(
                "The response must vary over the rows of a fit, found a constant in some; take fewer folds."
            )
        if centred:
            centers[0][self.constant] = 0.0
        return replace(
            part,
            column_center=centers[0],
            column_scale=scales[0],
            response_center=float(centers[1]),
            response_scale=float(scales[1]),
        )

    @cached_property
    def uneven(self) -> str:
        """Warning about columns of very different size under one prior variance; else empty."""
        size = np.sqrt(np.sum(self.scaled_design_matrix**2, axis=0) / self.n_rows)
        small, large = min(size[size > 0.0], default=0.0), size.max()
        if large <= UNEVEN * small or self.n_rows < FEWEST_ROWS:
            return ""
        names = [self.coefficients[list(size).index(value)] for value in (small, large)]
        return (
            f"The columns must be of one size where all have the same prior, found {names[0]} of {small:.2g} and "
            f"{names[1]} of {large:.2g}; take scaling='zscore' or a kappa for each column."
        )

    @cached_property
    def dependent(self) -> str:
        """Warning about columns of which one is a linear combination of others; else empty."""
        _, s, right = self.svd
        null = right[s <= ROUNDING * s[0]]
        together = np.abs(null.T @ null) > ROUNDING**0.5
        groups = dict.fromkeys(
            ", ".join(np.array(self.coefficients)[row]) for row in together if np.count_nonzero(row) > 1
        )
        if not groups or self.n_rows < max(self.n_terms, FEWEST_ROWS):
            return ""
        return (
            f"The columns must be linearly independent, found a combination of 0 among {'; and among '.join(groups)}, "
            "along which the posterior is the prior; leave a term out."
        )

    @cached_property
    def repeated(self) -> str:
        """Warning about rows that all stand equally often, two times or more; else empty."""
        if 2 * len(np.unique(self.response)) > self.n_rows:  # without a sort of whole rows
            return ""
        _, counts = np.unique(np.column_stack([self.design_matrix, self.response]), axis=0, return_counts=True)
        if len(counts) == 1 or counts[0] == 1 or np.ptp(counts):
            return ""
        return (
            f"The errors of rows must be independent, found each row {counts[0]} times; give each once, or the "
            f"standard deviations are {np.sqrt(counts[0]):.2g} times too small."
        )

    @cached_property
    def svd(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Thin singular value decomposition (left, singular_values, right transposed) of the scaled design."""
        left, s, right = np.linalg.svd(self.scaled_design_matrix, full_matrices=False)
        return left, s, right

    @cached_property
    def projection(self) -> tuple[np.ndarray, float]:
        """Scaled response along the left singular vectors, and the residual sum of squares."""
        left, _, _ = self.svd
        z = left.T @ self.scaled_response
        return z, float(np.sum((self.scaled_response - left @ z) ** 2))

    @property
    def least_squares(self) -> np.ndarray:
        """Least-squares coefficients of the original columns, of least norm on the scaled ones, shape (n_terms,)."""
        _, s, right = self.svd
        full = s > s[0] * max(self.n_rows, self.n_terms) * np.finfo(float).eps
        return self.to_original(self.projection[0][full] / s[full] @ right[full])

    @property
    def condition_number(self) -> float:
        """Largest over smallest singular value of the scaled design; infinite for more terms than rows."""
        s = self.svd[1]
        return float("inf") if self.n_terms > self.n_rows or s[-1] == 0.0 else float(s[0] / s[-1])

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

    @cached_property
    def basis(self) -> np.ndarray:
        """Original coefficients of a unit along each right singular vector, shape (n_singular_values, n_terms)."""
        return self.svd[2] @ self.transformation[1].T

    def to_original(self, scaled: np.ndarray) -> np.ndarray:
        """Map scaled coefficients, shape (..., n_terms), to those of the original columns."""
        offset, T = self.transformation
        return offset + scaled @ T.T

    def to_scaled(self, original: np.ndarray) -> np.ndarray:
        """Map coefficients of the original columns, shape (..., n_terms), to the scaled ones."""
        offset, T = self.transformation
        shifted = np.asarray(original, dtype=float) - offset
        return np.linalg.solve(T, shifted.reshape(-1, self.n_terms).T).T.reshape(shifted.shape)


def _center_and_size(values: np.ndarray, centred: bool) -> tuple[np.ndarray, np.ndarray]:
    """Mean of each column, or 0, and root mean square about it."""
    center = values.mean(axis=0) if centred else np.zeros(values.shape[1:])
    return center, np.sqrt(np.mean((values - center) ** 2, axis=0))


def _rounding(values: Any) -> float:
    """Relative range of values that are constant but for rounding, by their type."""
    dtype = getattr(values, "dtype", None)
    is_float = isinstance(dtype, np.dtype) and dtype.kind == "f"
    return max(ROUNDING, 16.0 * float(np.finfo(dtype).eps)) if is_float else ROUNDING


def _check(X: np.ndarray, y: np.ndarray, names: tuple[str, ...], time: np.ndarray, run: np.ndarray) -> None:
    for what, values in {"response": y, "time": time, "run": run}.items():
        if values.shape != (len(X),):
            raise InferenceError(f"The {what} has one value for each of {len(X)} rows, found shape {values.shape}.")
    if len(names) != X.shape[1]:
        raise InferenceError(f"Each of the {X.shape[1]} columns has one name, found {len(names)} names.")
    bad = [name for j, name in enumerate(names) if not np.isfinite(X[:, j]).all()]
    bad += [f"the {what}" for what, values in {"response": y, "time": time}.items() if not np.isfinite(values).all()]
    if bad:
        where = ", ".join(bad)
        raise InferenceError(f"Regression data must be finite, found NaN or infinity in {where}; clean the trial.")
    sizes = dict(zip(names, np.abs(X).max(axis=0), strict=True)) | {"the response": np.abs(y).max()}
    if far := {name: size for name, size in sizes.items() if size and not _SMALLEST < size < _LARGEST}:
        raise InferenceError(
            f"Regression data have magnitudes from {_SMALLEST:g} to {_LARGEST:g}, whose squares are numbers, found "
            f"{', '.join(f'{size:.2g} in {name}' for name, size in far.items())}; take other units."
        )
