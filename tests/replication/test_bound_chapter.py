"""The chapter from the bound down says what its tables hold, and no more."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pymc_ship.records.files.noise import LITERAL_LEVEL
from pymc_ship.replication import bound_chapter
from pymc_ship.replication.measurements import BOUND, fit_name

MEDIANS = {
    BOUND: 1300.0,
    fit_name("flat"): 1500.0,
    fit_name("order_damped"): 800.0,
    "weak form": 3000.0,
    "best differencing": 4000.0,
    "paper's pipeline": 6000.0,
}
"""Errors [%] at a noise level of 1, to which they are proportional."""

LEVELS = (0.001, 0.01, LITERAL_LEVEL)


def method_row(level, method, median):
    shares = {"coefficients": 93, "under_5": 10.0, "under_20": 20.0, "under_50": 30.0}
    coverage = float("nan") if method == BOUND else 88.0
    return {"level": level, "method": method, "median": median, **shares, "coverage": coverage, "detail": "so"}


def forecast_row(level, error, **more):
    shares = {
        "coverage": 90.0,
        "diverged": 1.5,
        "extrapolated": 50.0,
        "extrapolation": f"Said at {level:g}.",
    }
    return {"level": level, "error": error, **shares, **more}


def made_up(level=0.01, published=True):
    """Result with tables as a study leaves them."""
    families = (("conjugate", 92, 2.0, 0.0015), ("semiconjugate", 91, 3.7, 0.0029)) if published else ()
    tables = {
        "methods": [method_row(at, name, at * median) for at in LEVELS for name, median in MEDIANS.items()],
        "published_bound": [
            {"family": family, "errors": 93, "median": median, "below": below, "on_bound": 587.0, "level": possible}
            for family, below, median, possible in families
        ],
    }
    for name, factor in (("zigzag", 20.0), ("turning_circle", 50.0)):
        tables[f"trajectory_{name}"] = [forecast_row(at, factor * at, pareto_khat=0.4) for at in LEVELS]
        tables[f"forecast_{name}"] = [
            forecast_row(at, times * factor * at, family=family)
            for at in (0.0, *LEVELS)
            for family, times in (("semiconjugate", 30.0), ("conjugate", 10.0))
        ]
    return SimpleNamespace(level=level, tables=tables)


def failed(result, priors, level):
    """The same result after no start of some fits has converged at a level."""
    for row in result.tables["methods"]:
        if row["level"] == level and row["method"] in map(fit_name, priors):
            row["median"] = float("nan")
    if "order_damped" in priors:
        for name in ("trajectory_zigzag", "trajectory_turning_circle"):
            result.tables[name] = [row for row in result.tables[name] if row["level"] != level]
    return result


def test_the_sentences_of_the_head_have_the_numbers_of_the_level_shown():
    assert bound_chapter.short(made_up()) == [
        "At the printed noise level of 0.447, 183 of 186 published errors are smaller than the Cramer-Rao bound, the "
        "least standard error of an unbiased estimate. Of unbiased normal estimates with this standard error, 68 % "
        "have a smaller error.",
        "At noise level 0.01 the median error of a coefficient is 60 % with the paper's method and 8 % with a fit of "
        "whole trajectories; the bound gives 13 % for unbiased estimates.",
        "Forecasts of the 10/10 zigzag and the 35 deg turn have errors of 2 and 5 % with the paper's pipeline and 0.2 "
        "and 0.5 % with the trajectory fit (of the channels' range); 1.5 and 1.5 % of the draws diverge in the turn.",
    ]


def test_nothing_is_said_of_a_print_that_is_not_there():
    result = made_up(published=False)
    assert len(bound_chapter.short(result)) == 2
    assert bound_chapter.published_text(result) == ""
    assert "183 of 186 published errors lie" in bound_chapter.published_text(made_up())


def test_a_level_without_noise_leaves_the_words_to_the_least_noise():
    (_, methods, _) = bound_chapter.short(made_up(level=0.0))
    assert methods.startswith("At noise level 0.001 ")
    assert bound_chapter.chapter(made_up(level=0.0))["level"] == "0.001"


@pytest.mark.parametrize("priors", [("flat",), ("flat", "order_damped")])
def test_a_fit_that_failed_has_no_result_and_no_forecast(priors):
    (_, methods, forecasts) = bound_chapter.short(failed(made_up(), priors, 0.01))
    assert ("no result" in methods) == ("order_damped" in priors)
    assert ("trajectory fit" in forecasts) == ("order_damped" not in priors)
    assert "nan" not in methods + forecasts


def test_the_forecasts_stand_side_by_side_at_every_level_with_noise():
    rows = bound_chapter.forecast_rows(made_up())
    assert [(row["level"], row["method"]) for row in rows] == [
        (level, method) for level in LEVELS for method in ("trajectory fit", "paper's pipeline")
    ]
    fit, pipeline = rows[2:4]
    assert (fit["zigzag_error"], pipeline["zigzag_error"]) == (0.2, 2.0)
    assert (fit["turning_circle_error"], pipeline["turning_circle_error"]) == (0.5, 5.0)
    assert fit["pareto_khat"] == 0.4
    assert np.isnan(pipeline["pareto_khat"])


def test_where_the_fit_failed_the_pipeline_stands_alone():
    rows = bound_chapter.forecast_rows(failed(made_up(), ("order_damped",), 0.01))
    assert [row["method"] for row in rows if row["level"] == 0.01] == ["paper's pipeline"]
    assert len(rows) == 5


def test_the_chapter_says_what_the_forecasts_extrapolate():
    said = bound_chapter.chapter(made_up())
    assert said["extrapolation"] == ["zigzag 10/10 port: Said at 0.01.", "turning circle 35 port: Said at 0.01."]
    assert bound_chapter.chapter(failed(made_up(), ("order_damped",), 0.01))["extrapolation"] == []


def test_the_tables_have_a_row_for_each_level_and_method():
    said = bound_chapter.chapter(made_up())
    assert [cells[:3] for cells in said["methods"].cells[:2]] == [
        ["0.001", BOUND, "1.3"],
        ["0.001", fit_name("flat"), "1.5"],
    ]
    assert len(said["methods"].cells) == len(LEVELS) * len(MEDIANS)
    assert "–" in said["methods"].cells[0]
    assert [len(cells) for cells in said["forecasts"].cells] == [len(said["forecasts"].heads)] * 6


def test_the_figure_draws_every_method_over_the_levels():
    (ax,) = bound_chapter.figure(failed(made_up(), ("flat",), 0.01)).axes
    lines = {line.get_label(): line for line in ax.get_lines()}
    assert set(lines) == {*MEDIANS, "published, conjugate", "published, semi-conjugate"}
    np.testing.assert_allclose(lines["weak form"].get_xydata().T, [LEVELS, 3000.0 * np.array(LEVELS)])
    assert np.isnan(lines[fit_name("flat")].get_ydata()).tolist() == [False, True, False]
    assert lines["published, conjugate"].get_xydata().tolist() == [[LITERAL_LEVEL, 2.0]]
