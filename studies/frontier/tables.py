"""Tables of the frontier: what was measured beside what was aimed at, and every method from the bound down.

Every number comes with a standard error from 400 bootstrap samples of the seeds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pymc_ship.physics.vessel.vessel import Vessel, coefficient_names
from pymc_ship.replication.estimates import DIFFERENCES
from pymc_ship.replication.scores import statistic_and_error
from studies.frontier.data_sets import LEVELS
from studies.frontier.measure import Measurement

METHODS = {
    "bound": "Cramér-Rao bound",
    "flat prior": "trajectory fit, flat prior",
    "default prior": "trajectory fit, default prior",
    "weak form": "weak form",
    "best differencing": "best differencing",
    "paper's pipeline": "the paper's pipeline",
}
"""Methods from the bound down and how they are called."""

LEAST_SQUARES = "paper's pipeline, least squares"


@dataclass(frozen=True)
class Aim:
    """A number of the frontier's table and what it is to be.

    Attributes
    ----------
    label, unit : str
    cell : str
        Name of a :class:`studies.frontier.data_sets.Cell`.
    estimators : tuple of str
        One, or the two of a ratio.
    column : str
        Key of the measurement's values, or ``deviation``.
    statistic : str
        Key of :data:`STATISTICS`.
    limits : mapping of float to (float, float)
        Least and greatest value by level.
    """

    label: str
    unit: str
    cell: str
    estimators: tuple[str, ...]
    column: str
    statistic: str
    limits: Mapping[float, tuple[float, float]]


def _at_most(*highest: float) -> dict[float, tuple[float, float]]:
    return {level: (-np.inf, high) for level, high in zip(LEVELS, highest, strict=True)}


def _between(*limits: tuple[float, float]) -> dict[float, tuple[float, float]]:
    return dict(zip(LEVELS, limits, strict=True))


_COVERAGE = _between(*3 * [(87.0, 93.0)])
_BANDS = _between((85.0, 96.0), (85.0, 96.0), (82.0, 96.0))
_CORRECTED = {0.01: (85.0, 95.0)}
_ZIGZAG, _TURN, _LONG_TURN = ("10/10 zigzag",), ("35 deg turn",), ("35 deg turn, 600 s",)
_FLAT, _DEFAULT = ("flat prior",), ("default prior",)
_ALL = _between(*3 * [(100.0, 100.0)])

AIMS = (
    Aim(
        "RMSE / Cramér-Rao bound, flat prior", "", "white", _FLAT, "deviation", "rmse", limits=_at_most(1.1, 1.1, 1.15)
    ),
    Aim("90 % intervals cover, flat prior", "%", "white", _FLAT, "coverage", "mean", limits=_COVERAGE),
    Aim("90 % intervals cover, default prior", "%", "white", _DEFAULT, "coverage", "mean", limits=_COVERAGE),
    Aim("90 % bands cover, 10/10 zigzag", "%", "white", _ZIGZAG, "band_coverage", "mean", limits=_BANDS),
    Aim("90 % bands cover, 35 deg turn", "%", "white", _TURN, "band_coverage", "mean", limits=_BANDS),
    Aim("90 % bands cover, 35 deg turn, 600 s", "%", "white", _LONG_TURN, "band_coverage", "mean", limits=_BANDS),
    Aim("RMSE / range, 10/10 zigzag", "%", "white", _ZIGZAG, "error", "median", limits=_at_most(0.15, 0.7, 2.5)),
    Aim("RMSE / range, 35 deg turn", "%", "white", _TURN, "error", "median", limits=_at_most(0.3, 1.0, 3.5)),
    Aim(
        "RMSE / range, 35 deg turn, 600 s", "%", "white", _LONG_TURN, "error", "median", limits=_at_most(0.3, 1.0, 3.5)
    ),
    Aim("tactical diameter error", "%", "white", _TURN, "tactical_diameter", "median", limits=_at_most(0.1, 0.4, 3.0)),
    Aim(
        "first overshoot error",
        "deg",
        "white",
        _ZIGZAG,
        "first_overshoot_angle",
        "median",
        limits=_at_most(0.01, 0.03, 0.1),
    ),
    Aim(
        "second overshoot error",
        "deg",
        "white",
        _ZIGZAG,
        "second_overshoot_angle",
        "median",
        limits=_at_most(0.01, 0.03, 0.1),
    ),
    Aim("draws diverged, 10/10 zigzag", "%", "white", _ZIGZAG, "diverged", "mean", limits={}),
    Aim("draws diverged, 35 deg turn", "%", "white", _TURN, "diverged", "mean", limits={}),
    Aim("draws diverged, 35 deg turn, 600 s", "%", "white", _LONG_TURN, "diverged", "mean", limits={}),
    Aim("median coefficient error, 20/20 zigzag alone", "%", "white", _DEFAULT, "median_error", "median", limits={}),
    Aim(
        "the same and one designed run",
        "%",
        "one designed run",
        _DEFAULT,
        "median_error",
        "median",
        limits=_at_most(0.25, 2.0, 9.0),
    ),
    Aim(
        "the same and two designed runs",
        "%",
        "two designed runs",
        _DEFAULT,
        "median_error",
        "median",
        limits=_at_most(0.15, 1.0, 5.0),
    ),
    Aim("starts that reach the optimum, 20/20 zigzag", "%", "white", _DEFAULT, "reaching", "mean", limits=_ALL),
    Aim("starts that reach it, one designed run", "%", "one designed run", _DEFAULT, "reaching", "mean", limits=_ALL),
    Aim("starts that reach it, two designed runs", "%", "two designed runs", _DEFAULT, "reaching", "mean", limits=_ALL),
    Aim(
        "error of the paper's pipeline / trajectory fit",
        "",
        "white",
        ("paper's pipeline", "default prior"),
        "median_error",
        "ratio",
        limits=_between(*3 * [(5.0, np.inf)]),
    ),
    Aim(
        "small-step truth: median coefficient error",
        "%",
        "small-step truth",
        _DEFAULT,
        "median_error",
        "median",
        limits={},
    ),
    Aim(
        "small-step truth: 90 % intervals cover",
        "%",
        "small-step truth",
        _DEFAULT,
        "coverage",
        "mean",
        limits=_COVERAGE,
    ),
    *(
        Aim(f"{cell}: 90 % intervals cover", "%", cell, _DEFAULT, "coverage", "mean", limits=_CORRECTED)
        for cell in ("correlated 0.2 s", "correlated 1 s", "offsets", "Student-t3")
    ),
    *(
        Aim(f"{cell}, white noise assumed: cover", "%", cell, ("white assumed",), "coverage", "mean", limits={})
        for cell in ("correlated 0.2 s", "correlated 1 s", "offsets", "Student-t3")
    ),
)
"""The table of the frontier."""


def over_seeds(
    found: Sequence[Measurement], cell: str, level: float, estimators: Sequence[str], column: str
) -> np.ndarray:
    """Values of a column of one or more estimators, shape (n_seeds,), (n_seeds, n_estimators) or (.., n_coefficients).

    What could not be computed counts as infinitely wrong.
    """
    columns = []
    for estimator in estimators:
        mine = [one for one in found if (one.cell, one.level, one.estimator) == (cell, level, estimator)]
        mine = sorted(mine, key=lambda one: one.seed)
        columns.append([one.deviation if column == "deviation" else one.values[column] for one in mine])
    values = np.array(columns[0] if len(columns) == 1 else columns, dtype=float)
    values = values if len(columns) == 1 else values.T
    return np.where(np.isnan(values), np.inf, values)


def aim_rows(found: Sequence[Measurement]) -> list[dict]:
    """Value, standard error, limits and verdict of each aim at each level that was measured.

    Returns
    -------
    list of dict
        measure, unit, level, value, se, least, greatest, met ("yes", "no", or nothing where there is no aim).
    """
    rows, measured = [], {(one.cell, one.estimator, one.level) for one in found}
    for aim in AIMS:
        for level in sorted({level for *key, level in measured if key == [aim.cell, aim.estimators[0]]}):
            value, se = statistic_and_error(
                over_seeds(found, aim.cell, level, aim.estimators, aim.column), aim.statistic
            )
            least, greatest = aim.limits.get(level, (-np.inf, np.inf))
            verdict = "" if level not in aim.limits else "yes" if least <= value <= greatest else "no"
            row = {"measure": aim.label, "unit": aim.unit, "level": level, "value": value, "se": se}
            rows.append(row | {"least": least, "greatest": greatest, "met": verdict})
    return rows


def best_differencing(found: Sequence[Measurement], level: float) -> str:
    """Differencing method of the smallest median error at a level, the paper's own apart; chosen with hindsight."""
    median = {name: np.median(over_seeds(found, "white", level, (name,), "median_error")) for name in DIFFERENCES}
    return min(median, key=median.get)


def bound_down_rows(found: Sequence[Measurement]) -> list[dict]:
    """Median coefficient error of every method at every level, from the bound down.

    Returns
    -------
    list of dict
        level, method, by (which differences are best), median_error [%], se, and times_bound.
    """
    rows = []
    for level in sorted({one.level for one in found if one.cell == "white"}):
        bound = None
        for key, method in (METHODS | {LEAST_SQUARES: "the paper's pipeline, least squares"}).items():
            name = best_differencing(found, level) if key == "best differencing" else key
            value, se = statistic_and_error(over_seeds(found, "white", level, (name,), "median_error"), "median")
            bound = bound or value
            row = {"level": level, "method": method, "by": name if key == "best differencing" else ""}
            rows.append(row | {"median_error": value, "se": se, "times_bound": value / bound})
    return rows


def noise_rows(found: Sequence[Measurement]) -> list[dict]:
    """Error and coverage of every trajectory fit, and the noise it chose.

    Returns
    -------
    list of dict
        cell, level, estimator, seeds, median_error [%], coverage and its se [%], shares [%] of data sets where white,
        ar1 or student_t and where offsets were chosen, and of failed fits.
    """
    rows = []
    for cell, level, estimator in dict.fromkeys((o.cell, o.level, o.estimator) for o in found if "failed" in o.values):
        where = found, cell, level, (estimator,)
        coverage, se = statistic_and_error(over_seeds(*where, "coverage"), "mean")
        mine = [one.values for one in found if (one.cell, one.level, one.estimator) == (cell, level, estimator)]
        row = {"cell": cell, "level": level, "estimator": estimator, "seeds": len(mine)}
        row |= {"median_error": statistic_and_error(over_seeds(*where, "median_error"), "median")[0]}
        row |= {"coverage": coverage, "se": se}
        kinds = {name: f"chose_{name}" for name in ("white", "ar1", "student_t", "offsets")} | {"failed": "failed"}
        rows.append(
            row | {key: 100.0 * float(np.mean([v.get(name, 0.0) for v in mine])) for key, name in kinds.items()}
        )
    return rows


def coefficient_rows(found: Sequence[Measurement], vessel: Vessel) -> list[dict]:
    """RMSE over the bound of each coefficient from the 20/20 zigzag alone, by level and prior."""
    rows = []
    for level in sorted({one.level for one in found if one.cell == "white"}):
        deviations = {name: over_seeds(found, "white", level, (name,), "deviation") for name in _FLAT + _DEFAULT}
        ratios = {name: np.sqrt(np.mean(values**2, axis=0)) for name, values in deviations.items()}
        for k, coefficient in enumerate(coefficient_names(vessel)):
            rows.append({"level": level, "coefficient": coefficient} | {key: float(v[k]) for key, v in ratios.items()})
    return rows


def measurement_rows(found: Sequence[Measurement]) -> list[dict]:
    """Every measurement as it is."""
    return [
        {"cell": one.cell, "level": one.level, "seed": one.seed, "estimator": one.estimator} | one.values
        for one in found
    ]
