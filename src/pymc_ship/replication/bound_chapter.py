"""Chapter "From the bound down" of the study's page: every method against the Cramer-Rao bound, by noise level."""

import numpy as np
from matplotlib.figure import Figure

from pymc_ship.pages.tables import Columns, Table, fixed_point, heads, number, table
from pymc_ship.records.files.noise import LITERAL_LEVEL
from pymc_ship.replication import figures
from pymc_ship.replication.measurements import BOUND, fit_name
from pymc_ship.replication.study import MANOEUVRES, TRAJECTORY_PRIORS, StudyResult
from pymc_ship.replication.tables import ERROR_COUNTS

BELOW_ON_BOUND = 68  # share [%] of normal errors within one standard deviation

_n = number(2)
_TRAJECTORY, _PAPER = "trajectory fit", "paper's pipeline"


def level_with_noise(result: StudyResult) -> float:
    """Noise level of the sentences: the one shown, or the least with any noise."""
    levels = {row["level"] for row in result.tables["methods"]}
    return result.level if result.level in levels else min(levels)


def short(result: StudyResult) -> list[str]:
    """Sentences that head the page on the published errors, the methods and the forecasts."""
    level = level_with_noise(result)
    rows = [row for row in result.tables["methods"] if row["level"] == level]
    medians = {row["method"]: f"{_n(row['median'])} %" if np.isfinite(row["median"]) else "no result" for row in rows}
    damped = medians[fit_name(TRAJECTORY_PRIORS[-1])]
    methods = (
        f"At noise level {level:g} the median error of a coefficient is {medians[_PAPER]} with the paper's method and "
        f"{damped} with a fit of whole trajectories; the bound gives {medians[BOUND]} for unbiased estimates."
    )
    return [*_published_in_short(result), methods, *_forecasts(result, level)]


def _published_in_short(result: StudyResult) -> list[str]:
    below, errors = _below_bound(result)
    text = (
        f"At the printed noise level of {LITERAL_LEVEL:.3f}, {below} of {errors} published errors are smaller than the "
        f"Cramer-Rao bound, the least standard error of an unbiased estimate. Of unbiased normal estimates with "
        f"this standard error, {BELOW_ON_BOUND} % have a smaller error."
    )
    return [text] if errors else []


def _below_bound(result: StudyResult) -> tuple[int, int]:
    rows = result.tables["published_bound"]
    return sum(row["below"] for row in rows), sum(row["errors"] for row in rows)


def published_text(result: StudyResult) -> str:
    """Sentences above Tables 2 and 3 on the published errors and the bound; empty without published errors."""
    rows, (below, errors) = result.tables["published_bound"], _below_bound(result)
    if not rows:
        return ""
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
    diverged = " and ".join(_n(rows[name]["turning_circle_diverged"]) for name in methods)
    return [
        f"Forecasts of the 10/10 zigzag and the 35 deg turn have errors of {errors} (of the channels' range); "
        f"{diverged} % of the draws diverge in the turn."
    ]


def _at(rows: list[dict], level: float, **labels: str) -> dict | None:
    wanted = {"level": level} | labels
    return next((row for row in rows if all(row[key] == value for key, value in wanted.items())), None)


def chapter(result: StudyResult) -> dict:
    """Tables of the chapter and its sentences on extrapolation."""
    level = level_with_noise(result)
    outside = {
        MANOEUVRES[name].label: row["extrapolation"]
        for name in MANOEUVRES
        if (row := _at(result.tables.get(f"trajectory_{name}", []), level)) is not None
    }
    return {
        "methods": method_table(result),
        "forecasts": forecast_table(result),
        "level": f"{level:g}",
        "extrapolation": [f"{label}: {sentence}" for label, sentence in outside.items()],
    }


def method_table(result: StudyResult) -> Table:
    """Errors of every method by noise level, in columns by method."""
    columns = (
        heads(number(3), level="noise level") | heads(str, method="method") | heads(number(3), median="median error %")
    )
    columns |= ERROR_COUNTS | heads(fixed_point(0), coverage="90 % intervals cover %") | heads(str, detail="how")
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
                for key in ("error", "coverage", "diverged", "extrapolated")
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
            f"{name}_diverged": ("diverged %", fixed_point(1)),
            f"{name}_extrapolated": ("outside %", fixed_point(0)),
        }
    return table(forecast_rows(result), columns | {"pareto_khat": ("Pareto k-hat", fixed_point(2))})


def figure(result: StudyResult) -> Figure:
    """Median error of every method against the noise level, with the published medians."""
    rows = result.tables["methods"]
    levels = sorted({row["level"] for row in rows})
    names = dict.fromkeys(row["method"] for row in rows)
    by_method = {name: {row["level"]: row["median"] for row in rows if row["method"] == name} for name in names}
    errors = {name: np.array([medians.get(level, np.nan) for level in levels]) for name, medians in by_method.items()}
    published = {_shorter(row["family"]): row["median"] for row in result.tables["published_bound"]}
    return figures.errors_by_method(np.array(levels), errors, published, LITERAL_LEVEL)
