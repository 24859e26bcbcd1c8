"""Chapter "From the bound down" of the study's report: every method beside the Cramer-Rao bound, by noise level."""

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


def level_told(result: StudyResult) -> float:
    """Noise level that the sentences are on: the one shown, or the least with any noise."""
    levels = {row["level"] for row in result.tables["methods"]}
    return result.level if result.level in levels else min(levels)


def short(result: StudyResult) -> list[str]:
    """What the chapter adds to the summary that heads the page."""
    said = [_published(result)] if result.tables["published_bound"] else []
    level = level_told(result)
    found = {row["method"]: _percent(row["median"]) for row in result.tables["methods"] if row["level"] == level}
    flat, damped = (found[fit_name(prior)] for prior in TRAJECTORY_PRIORS)
    text = (
        f"At noise level {level:g} the bound leaves unbiased estimates a median error of {found[BOUND]}; on that "
        f"record the trajectory fit has {flat} (flat prior) and {damped} (order-damped prior), the weak form "
        f"{found['weak form']}, the best differencing {found['best differencing']} and the paper's pipeline "
        f"{found[_PAPER]}."
    )
    return [*said, f"{text}{_forecasts(result, level)}"]


def _percent(error: float) -> str:
    return f"{_n(error)} %" if np.isfinite(error) else "no result"


def _published(result: StudyResult) -> str:
    rows = result.tables["published_bound"]
    below, errors = (sum(row[name] for row in rows) for name in ("below", "errors"))
    levels = " and ".join(f"{_n(row['level'])} ({_shorter(row['family'])})" for row in rows)
    return (
        f"At the printed noise level of {LITERAL_LEVEL:.3f}, {below} of {errors} published errors lie below the "
        f"Cramer-Rao bound, where {BELOW_ON_BOUND} % of those of an unbiased estimator on it would: it leaves a median "
        f"error of {_n(rows[0]['on_bound'])} % from all samples. Errors of the published size are within reach of an "
        f"unbiased estimator at noise levels of {levels} or less."
    )


def _shorter(family: str) -> str:
    return {"semiconjugate": "semi-conjugate"}.get(family, family)


def _forecasts(result: StudyResult, level: float) -> str:
    """Sentence on the forecasts of the trajectory fit; empty where it failed."""
    zigzag, turn = (_at(result.tables.get(f"trajectory_{name}", []), level) for name in ("zigzag", "turning_circle"))
    if zigzag is None or turn is None:
        return ""
    return (
        f" The trajectory fit forecasts the 10/10 zigzag within {_n(zigzag['error'])} % of the channels' range and the "
        f"35 deg turn within {_n(turn['error'])} % (order-damped prior; {_n(zigzag['share_diverged'])} and "
        f"{_n(turn['share_diverged'])} % of the draws diverged)."
    )


def _at(rows: list[dict], level: float, **labels: str) -> dict | None:
    wanted = {"level": level} | labels
    return next((row for row in rows if all(row[key] == value for key, value in wanted.items())), None)


def beside_errors(result: StudyResult) -> str:
    """Sentences above Tables 2 and 3 on the columns of the bound."""
    text = (
        "Beside the errors stands the Cramer-Rao bound: the least standard deviation, in percent of the reference, "
        "that an unbiased estimate from all samples of u, v, r, p and phi can have, the initial state being unknown; "
        f"at the printed noise level of {LITERAL_LEVEL:.3f} for the published errors, at {result.level:g} for ours. "
        "Estimates that a prior pulls to the right place may lie below it."
    )
    return f"{text} {_published(result)}" if result.tables["published_bound"] else text


def chapter(result: StudyResult) -> dict:
    """Paragraphs, tables and the sentences on extrapolation of the chapter."""
    level = level_told(result)
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
        "The trajectory fit compares the simulated motion with the raw record and differentiates nothing; the weak "
        "form integrates the equations of motion against test functions; best differencing is the one of four (central "
        "or Savitzky-Golay, each second or every sample, on the denoised record) that turns out to have the smallest "
        "median error; the paper's pipeline is that of section 5, conjugate family. The flat prior leaves the fit "
        "unbiased to first order; the order-damped one is centred on zero, narrower for terms of higher order, its "
        "scale found by evidence for each degree of freedom, and may pass the bound. No method knows the reference "
        f"values. The record was made by Euler steps of {STEP:g} s, and trajectory fit, weak form and bound take the "
        "same steps (method euler): the error of integration, which a record from the sea has, is left out."
    )


def _draw_text() -> str:
    return (
        "Each level is one draw of the noise. The errors of the coefficients of one draw are strongly correlated, so "
        "its coverage says little of a method: that takes means over many draws, as make frontier forms them. To call "
        "every coefficient zero is an error of 100 %: medians near it, or above, tell of the prior and not of the ship."
    )


def _forecast_text() -> str:
    return (
        "Forecasts of the trajectory fit (order-damped prior, normal approximation) beside those of the paper's "
        "pipeline: error (RMSE of the median over the channels' range), coverage of the 90 % bands, share of the draws "
        "that diverged, which the bands leave out, and share of the instants outside the motion of the record. Where "
        f"Pareto k-hat exceeds {KHAT_LIMIT:g}, the normal approximation is not to be trusted."
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
    """Scores of both forecasts by level and method, with keys that begin with the name of the manoeuvre."""
    rows = []
    for level in dict.fromkeys(row["level"] for row in result.tables["methods"]):
        for method, prefix, labels in ((_TRAJECTORY, "trajectory", {}), (_PAPER, "forecast", {"family": "conjugate"})):
            found = {name: _at(result.tables.get(f"{prefix}_{name}", []), level, **labels) for name in MANOEUVRES}
            known = {name: row for name, row in found.items() if row is not None}
            if len(known) < len(found):
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
    """Forecasts of the trajectory fit beside those of the paper's pipeline."""
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
    """Median error of every method against the noise level, with the published medians where they were printed."""
    rows = result.tables["methods"]
    levels = sorted({row["level"] for row in rows})
    by_method = {name: {row["level"]: row["median"] for row in rows if row["method"] == name} for name in _names(rows)}
    errors = {name: np.array([found.get(level, np.nan) for level in levels]) for name, found in by_method.items()}
    published = {_shorter(row["family"]): row["median"] for row in result.tables["published_bound"]}
    return figures.errors_by_method(np.array(levels), errors, published, LITERAL_LEVEL)


def _names(rows: list[dict]) -> list[str]:
    return list(dict.fromkeys(row["method"] for row in rows))
