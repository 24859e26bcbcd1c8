"""The uncertainty of a corrected index from its parts, and what it leaves of a criterion (JCGM 100:2008).

Parts by draws: of the record, of the current and of the model. Runs of one manoeuvre to one side that were sailed more
than once scatter by what the sea, the helm and the approach do: a part of its own, which a single run cannot show.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pymc_ship.physics.manoeuvre.criteria import CONFORMANCE_PROBABILITY

PARTS = ("u_record", "u_current", "u_model")
"""Parts of the standard uncertainty that are deviations by draws."""

_DRAWS = 2000
_TAILS = (0.025, 0.975)


def uncertainty_budget(rows: Sequence[dict], rng: np.random.Generator) -> list[dict]:
    """Rows of corrected indices with their uncertainty.

    Parameters
    ----------
    rows : sequence of dict
        With ``manoeuvre``, ``index``, ``corrected``, ``limit`` (NaN for none) and, by the names of :data:`PARTS`, the
        deviations of each part, NaN where it is not known.
    rng : Generator

    Returns
    -------
    list of dict
        With the sd of each part in its place, ``u_runs``, the scatter of runs of one manoeuvre (NaN for a single one),
        ``runs``, their number, ``u_c``, the root of the sum of squares, ``U`` = 2 u_c, the ends ``lower`` and ``upper``
        of the interval of 95 %, and ``conformity``, empty without a limit. u_c, U and the interval are NaN where a part
        by draws is not known; a scatter that is not known is left out of them.
    """
    found = []
    for row in rows:
        alike = [
            one["corrected"] for one in rows if (one["manoeuvre"], one["index"]) == (row["manoeuvre"], row["index"])
        ]
        u_runs = float(np.std(alike, ddof=1)) if len(alike) > 1 else np.nan
        scatter = float(np.nan_to_num(u_runs))
        sds = {name: float(np.std(row[name])) for name in PARTS}
        u_c = float(np.linalg.norm([*sds.values(), scatter]))
        drawn = row["corrected"] + sum(rng.choice(row[name], _DRAWS) for name in PARTS)
        drawn = drawn + scatter * rng.standard_normal(_DRAWS)
        lower, upper = np.quantile(drawn, _TAILS).tolist()
        known = {
            **sds,
            "u_runs": u_runs,
            "runs": len(alike),
            "u_c": u_c,
            "U": 2.0 * u_c,
            "lower": lower,
            "upper": upper,
        }
        found.append(row | known | {"conformity": conformity(row["corrected"], drawn, row["limit"])})
    return found


def conformity(value: float, drawn: np.ndarray, limit: float) -> str:
    """Whether a value keeps a limit, as its draws have it or, where they are unknown, as it was measured."""
    if np.isnan(limit):
        return ""
    if not np.isfinite(drawn).all():
        return f"{'met' if value <= limit else 'not met'} as measured"
    kept = float(np.mean(drawn <= limit))
    return "met" if kept >= CONFORMANCE_PROBABILITY else "not met" if kept <= 1.0 - CONFORMANCE_PROBABILITY else "open"
