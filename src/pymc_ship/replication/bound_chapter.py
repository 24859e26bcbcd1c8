"""Chapter "From the bound down" of the study's page: every method against the Cramer-Rao bound, by noise level."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pymc_ship.inference.trajectory.posterior import KHAT_LIMIT
from pymc_ship.pages.tables import Columns, Table, fixed_point, number, table
from pymc_ship.records.files.noise import LITERAL_LEVEL
from pymc_ship.replication import figures
from pymc_ship.replication.measurements import BOUND, fit_name
from pymc_ship.replication.study import MANOEUVRES, STEP, TRAJECTORY_PRIORS, StudyResult

BELOW_ON_BOUND = 68
"""Share [%] of normal errors within one standard deviation."""

_n = number(2)
_TRAJECTORY, _PAPER = "trajectory fit", "paper's pipeline"


def level_with_noise(result: StudyResult) -> float:
    """Noise level of the sentences: the one shown, or the least with any noise."""
    levels = {row["level"] for row in result.tables["methods"]}
    return result.level if result.level in levels else min(levels)


def short(result: StudyResult) -> list[str]:
    """Sentences that head the page on the published errors, the methods and the forecasts."""
    level = level_with_noise(result)
    medians = {row["method"]: _percent(row["median"]) for row in result.tables["methods"] if row["level"] == level}
    damped = medians[fit_name(TRAJECTORY_PRIORS[-1])]
    methods = (
        f"At noise level {level:g} the median error of a coefficient is {medians[_PAPER]} with the paper's method and "
        f"{damped} with a fit of whole trajectories; the bound gives {medians[BOUND]} for unbiased estimates."
    )
    return [*_published_in_short(result), methods, *_forecasts(result, level)]


def _published_in_short(result: StudyResult) -> list[str]:
    rows = result.tables["published_bound"]
    below, errors = (sum(row[name] for row in rows) for name in ("below", "errors"))
    text = (
        f"At the printed noise level of {LITERAL_LEVEL:.3f}, {below} of {errors} published errors are smaller than the "
        f"Cramer-Rao bound, the least standard error of an unbiased estimate. Of unbiased normal estimates with "
        f"this standard error, {BELOW_ON_BOUND} % have a smaller error."
    )
    return [text] if rows else []


def _percent(error: float) -> str:
    return f"{_n(error)} %" if np.isfinite(error) else "no result"


def _published(result: StudyResult) -> str:
    rows = result.tables["published_bound"]
    below, errors = (sum(row[name] for row in rows) for name in ("below", "errors"))
    levels = " and ".join(f"{_n(row['level'])} ({_shorter(row['family'])})" for row in rows)
    return (
        f"At the printed noise level of {LITERAL_LEVEL:.3f}, {below} of {errors} published errors lie below the "
        f"Cramer-Rao bound. Of unbiased normal estimates on the bound, {BELOW_ON_BOUND} % do. The median error on the "
        f"bound is {_n(rows[0]['on_bound'])} %. An unbiased estimator can reach the published errors at noise levels "
        f"of {levels} or less."
    )


def _shorter(family: str) -> str:
    return {"semiconjugate": "semi-conjugate"}.get(family, family)


def _forecasts(result: StudyResult, level: float) -> list[str]:
    """Sentence on the forecasts of the paper's pipeline and of the trajectory fits that converged."""
    rows = {row["method"]: row for row in forecast_rows(result) if row["level"] == level}
    methods = [name for name in (_PAPER, _TRAJECTORY) if name in rows]
    if not methods:
        return []
    errors = " and ".join(
        f"{_n(rows[name]['zigzag_error'])} and {_n(rows[name]['turning_circle_error'])} % with the {name}"
        for name in methods
    )
    diverged = " and ".join(_n(rows[name]["turning_circle_share_diverged"]) for name in methods)
    return [
        f"Forecasts of the 10/10 zigzag and the 35 deg turn have errors of {errors} (of the channels' range); "
        f"{diverged} % of the draws diverge in the turn."
    ]


def _at(rows: list[dict], level: float, **labels: str) -> dict | None:
    wanted = {"level": level} | labels
    return next((row for row in rows if all(row[key] == value for key, value in wanted.items())), None)


def beside_errors(result: StudyResult) -> str:
    """Sentences above Tables 2 and 3 on the columns of the bound."""
    text = (
        "The Cramer-Rao bound is the least standard error, in percent of the reference, of an unbiased estimate "
        "from all samples of u, v, r, p and phi with an unknown initial state. It is at the printed noise level of "
        f"{LITERAL_LEVEL:.3f} for the published errors and at {result.level:g} for ours. A prior near the reference "
        "can make errors smaller than the bound."
    )
    return f"{text} {_published(result)}" if result.tables["published_bound"] else text


def chapter(result: StudyResult) -> dict:
    """Paragraphs, tables and the sentences on extrapolation of the chapter."""
    level = level_with_noise(result)
    outside = {
        MANOEUVRES[name].label: row["extrapolation"]
        for name in MANOEUVRES
        if (row := _at(result.tables.get(f"trajectory_{name}", []), level)) is not None
    }
    return {
        "paragraphs": [_method_text(), _draw_text()],
        "methods": method_table(result),
        "forecast_text": _forecast_text(),
        "forecasts": forecast_table(result),
        "level": f"{level:g}",
        "extrapolation": [f"{label}: {sentence}" for label, sentence in outside.items()],
    }


def _method_text() -> str:
    return (
        "The trajectory fit compares the simulated motion with the raw record and uses no accelerations. The weak form "
        "integrates the equations of motion against test functions. Best differencing is the one of four with the "
        "smallest median error: central or Savitzky-Golay, each second or every sample, on the denoised record. The "
        "paper's pipeline is that of section 5, conjugate family. With the flat prior the fit is unbiased to first "
        "order. The order-damped prior has mean zero and is narrower for terms of higher order; its scale maximises "
        "the evidence for each degree of freedom. With it errors can be smaller than the bound. No method uses the "
        f"reference values. The record has Euler steps of {STEP:g} s; trajectory fit, weak form and bound use the same "
        "steps, so there is no error of integration, which a measured record has."
    )


def _draw_text() -> str:
    return (
        "Each level has one draw of the noise. The errors of its coefficients are strongly correlated, so coverage "
        "needs means over many draws, as make frontier forms them. An estimate of zero has an error of 100 %; medians "
        "near 100 % or above follow the prior and not the data."
    )


def _forecast_text() -> str:
    return (
        "Forecasts of the trajectory fit (order-damped prior, normal approximation) and of the paper's pipeline. "
        "Error: RMSE of the median over the channels' range. Coverage: of the 90 % bands, without the draws that "
        "diverged. Outside: share of the instants outside the motion of the record. The normal approximation is not "
        f"reliable where Pareto k-hat exceeds {KHAT_LIMIT:g}."
    )


def method_table(result: StudyResult) -> Table:
    """Errors of every method by noise level, in columns by method."""
    columns: Columns = {
        "level": ("noise level", number(3)),
        "method": ("method", str),
        "median": ("median error %", number(3)),
        **{f"under_{k}": (f"< {k} %", fixed_point(0)) for k in (5, 20, 50)},
        "coverage": ("90 % intervals cover %", fixed_point(0)),
        "detail": ("how", str),
    }
    return table(result.tables["methods"], columns)


def forecast_rows(result: StudyResult) -> list[dict]:
    """Scores of both forecasts by level and method; the keys begin with the name of the manoeuvre."""
    rows = []
    for level in dict.fromkeys(row["level"] for row in result.tables["methods"]):
        for method, prefix, labels in ((_TRAJECTORY, "trajectory", {}), (_PAPER, "forecast", {"family": "conjugate"})):
            scored = {name: _at(result.tables.get(f"{prefix}_{name}", []), level, **labels) for name in MANOEUVRES}
            known = {name: row for name, row in scored.items() if row is not None}
            if len(known) < len(scored):
                continue
            scores = {
                f"{name}_{key}": row[key]
                for name, row in known.items()
                for key in ("error", "coverage", "share_diverged", "share_extrapolated")
            }
            khat = known["zigzag"].get("pareto_khat", float("nan"))
            rows.append({"level": level, "method": method, **scores, "pareto_khat": khat})
    return rows


def forecast_table(result: StudyResult) -> Table:
    """Forecasts of the trajectory fit and of the paper's pipeline."""
    columns: Columns = {"level": ("noise level", number(3)), "method": ("forecast by", str)}
    for name, short_name in (("zigzag", "zigzag"), ("turning_circle", "turn")):
        columns |= {
            f"{name}_error": (f"{short_name} error %", number(3)),
            f"{name}_coverage": ("cover %", fixed_point(0)),
            f"{name}_share_diverged": ("diverged %", fixed_point(1)),
            f"{name}_share_extrapolated": ("outside %", fixed_point(0)),
        }
    return table(forecast_rows(result), columns | {"pareto_khat": ("Pareto k-hat", fixed_point(2))})


def figure(result: StudyResult) -> Figure:
    """Median error of every method against the noise level, with the published medians."""
    rows = result.tables["methods"]
    levels = sorted({row["level"] for row in rows})
    by_method = {name: {row["level"]: row["median"] for row in rows if row["method"] == name} for name in _names(rows)}
    errors = {name: np.array([medians.get(level, np.nan) for level in levels]) for name, medians in by_method.items()}
    published = {_shorter(row["family"]): row["median"] for row in result.tables["published_bound"]}
    return figures.errors_by_method(np.array(levels), errors, published, LITERAL_LEVEL)


def _names(rows: list[dict]) -> list[str]:
    return list(dict.fromkeys(row["method"] for row in rows))
