"""Uncertainty budget of a corrected index (JCGM 100:2008) and its conformity (JCGM 106:2012).

Components: record, current and model, by draws, and the scatter of repeated runs.
"""

from collections.abc import Sequence

import numpy as np

from pymc_ship.physics.manoeuvre.criteria import CONFORMANCE_PROBABILITY

COMPONENTS = ("u_record", "u_current", "u_model")  # of the standard uncertainty that are given as draws
_DRAWS = 2000
_TAILS = (0.025, 0.975)


def uncertainty_budget(rows: Sequence[dict], rng: np.random.Generator) -> list[dict]:
    """Rows of corrected indices with their uncertainty.

    Given are ``manoeuvre``, ``index``, ``corrected``, ``limit`` (NaN for none) and the deviations of
    :data:`COMPONENTS` by draw (NaN where unknown). Added are the sd of each component, ``u_runs``, the scatter of
    repeated runs (NaN for a single one), ``runs``, their number, ``u_c``, the root of the sum of
    squares, ``U`` = 2 u_c, the 95 % interval ``lower`` to ``upper`` (NaN where a component is unknown) and
    ``conformity``, empty without a limit.
    """
    budget = []
    for row in rows:
        same = [other for other in rows if all(other[key] == row[key] for key in ("manoeuvre", "index"))]
        repeated = [other["corrected"] for other in same]
        u_runs = float(np.std(repeated, ddof=1)) if len(repeated) > 1 else np.nan
        scatter = float(np.nan_to_num(u_runs))
        sds = {name: float(np.std(row[name])) for name in COMPONENTS}
        u_c = float(np.linalg.norm([*sds.values(), scatter]))
        draws = row["corrected"] + sum(rng.choice(row[name], _DRAWS) for name in COMPONENTS)
        draws = draws + scatter * rng.standard_normal(_DRAWS)
        lower, upper = np.quantile(draws, _TAILS).tolist()
        columns = sds | {"u_runs": u_runs, "runs": len(repeated), "u_c": u_c, "U": 2.0 * u_c}
        columns |= {"lower": lower, "upper": upper}
        budget.append(row | columns | {"conformity": conformity(row["corrected"], draws, row["limit"])})
    return budget


def conformity(value: float, draws: np.ndarray, limit: float) -> str:
    """Conformity with a limit, by the draws or, where they are unknown, as measured."""
    if np.isnan(limit):
        return ""
    if not np.isfinite(draws).all():
        return f"{'met' if value <= limit else 'not met'} as measured"
    probability = float(np.mean(draws <= limit))
    if probability >= CONFORMANCE_PROBABILITY:
        return "met"
    return "not met" if probability <= 1.0 - CONFORMANCE_PROBABILITY else "open"
