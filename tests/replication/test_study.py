"""The study end to end on a small run, and the page that reports it."""

from __future__ import annotations

import csv
import re
import sys
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.diagnostics import page as diagnostic_report
from pymc_ship.diagnostics.agreement import failure_sentence
from pymc_ship.inference.identifiability.bound import cramer_rao_bound
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.trajectory.posterior import KHAT_LIMIT
from pymc_ship.machine.seeds import generator
from pymc_ship.pages.page import render_page
from pymc_ship.records.files.noise import LITERAL_LEVEL
from pymc_ship.replication import findings
from pymc_ship.replication import page as report
from pymc_ship.replication.tables import agreement_blocks, csv_tables, page_tables
from tests.replication.cases import (
    DOFS,
    FIGURES,
    FILES,
    LEVEL,
    METHODS,
    SEED,
    SHOWN,
    TABLES,
    UNKNOWN,
    Page,
    median_errors,
    subsections_of,
    unpublished,
)

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("name", TABLES)
def test_a_table_has_its_rows_and_keys(result, name):
    n_rows, keys = TABLES[name]
    rows = csv_tables(result)[name]
    assert len(rows) == n_rows
    assert all(keys <= set(row) for row in rows)
    assert len({tuple(row) for row in rows}) == 1


def test_every_table_is_known(result):
    assert set(csv_tables(result)) == set(TABLES)


@pytest.mark.parametrize("name", [name for name in TABLES if not name.startswith(("forecast", "trajectory"))])
def test_a_table_is_finite_but_for_what_cannot_be_known(result, name):
    wrong = [
        (key, value)
        for row in csv_tables(result)[name]
        for key, value in row.items()
        if not isinstance(value, str) and key not in UNKNOWN.get(name, set()) and not np.isfinite(value)
    ]
    assert wrong == []


def test_relative_errors_are_unknown_for_zeros_only(result):
    for row in csv_tables(result)["coefficients"]:
        for family in FAMILIES:
            assert np.isnan(row[f"error_{family}"]) == (row["reference"] == 0.0)
        assert np.isnan([row["bound"], row["bound_literal"]]).tolist() == 2 * [row["reference"] == 0.0]


def test_forecasts_at_the_level_shown_are_scored_and_shares_are_shares(result):
    for name in ("forecast_zigzag", "forecast_turning_circle"):
        for row in result.tables[name]:
            assert 0.0 <= row["diverged"] <= 100.0
            if row["level"] == LEVEL:
                assert 0.0 < row["error"] < 100.0
                assert 0.0 <= row["coverage"] <= 100.0
    row = result.tables["forecast_turning_circle"][0]
    assert row["advance_lower"] <= row["advance_median"] <= row["advance_upper"]


def test_the_bound_is_that_of_the_noise_on_the_record(result):
    """Of the record as it was polluted, and 1 % of noise has a hundredth of the bound of all."""
    noisy = result.noisy[LEVEL]
    sd = {name: noisy.attrs[f"noise_sd_{name}"] for name in ("u", "v", "r", "p", "phi")}
    bound = cramer_rao_bound(result.trial, result.vessel, sd, method="euler")
    np.testing.assert_allclose(LEVEL * result.bound, bound, rtol=1e-9)
    for row in csv_tables(result)["coefficients"]:
        if row["reference"] != 0.0:
            expected = 100.0 * float(bound.sel(coefficient=row["coefficient"])) / abs(1e-5 * row["reference"])
            assert row["bound"] == pytest.approx(expected, rel=1e-9)
            assert row["bound_literal"] == pytest.approx(expected * LITERAL_LEVEL / LEVEL, rel=1e-9)


def test_the_methods_stand_where_their_use_of_the_record_puts_them(result):
    """At 1 % of noise: the fit near the bound, the order-damped one below both, the others far above."""
    median = {method: value for (level, method), value in median_errors(result).items() if level == LEVEL}
    bound, flat, damped, *others = median.values()
    assert 0.5 * bound < flat < 2.0 * bound
    assert damped < flat
    assert min(others) > 1.5 * bound
    assert median["paper's pipeline"] > 3.0 * flat
    shown = next(
        row
        for row in result.tables["errors"]
        if (row["level"], row["family"], row["dof"]) == (LEVEL, "conjugate", "all")
    )
    assert median["paper's pipeline"] == shown["median"]


def test_the_published_errors_cannot_come_from_the_printed_noise(result):
    for row in result.tables["published_bound"]:
        assert row["below"] > 0.95 * row["errors"]
        assert row["on_bound"] > 100.0 * row["median"]
        assert row["level"] < 0.01 * LITERAL_LEVEL
    bound = median_errors(result)[LITERAL_LEVEL, "Cramer-Rao bound"]
    assert bound == pytest.approx(row["on_bound"], rel=0.1)


def test_the_trajectory_fit_forecasts_better_than_the_pipeline(result):
    for name in ("zigzag", "turning_circle"):
        fit, pipeline = (
            next(row for row in result.tables[f"{kind}_{name}"] if row["level"] == LEVEL)
            for kind in ("trajectory", "forecast")
        )
        assert fit["error"] < 0.3 * pipeline["error"]
        assert "outside the motion of the record" in fit["extrapolation"]


def test_levels_families_and_dofs_are_all_there(result):
    found = {(row["level"], row["family"], row["dof"]) for row in result.tables["errors"]}
    assert found == {(level, family, dof) for level in SHOWN for family in FAMILIES for dof in (*DOFS, "all")}
    assert set(result.noisy) == set(result.smooth) == set(result.identifications) == set(SHOWN)


def test_errors_grow_with_the_noise(result):
    median = {row["level"]: row["median"] for row in result.tables["sweep"] if row["dof"] == "all"}
    assert median[1e-4] < 0.2 * median[1e-2]


def test_denoising_lowers_every_error(result):
    for row in csv_tables(result)["denoising"]:
        assert row["gain"] == pytest.approx(row["before"] / row["after"])
        assert row["gain"] > 2.0
        assert row["before"] == pytest.approx(row["noise"], rel=0.05)


def test_exact_gibbs_and_nuts_agree_everywhere(result):
    assert list(result.agreement) == list(FAMILIES)
    for by_dof in result.agreement.values():
        assert tuple(by_dof) == DOFS
        for dataset in by_dof.values():
            assert dataset["method"].values.tolist() == ["gibbs", "nuts"]
            assert dataset["agrees"].values.all(), dataset.attrs["verdict"]
    assert {row["agrees"] for row in csv_tables(result)["agreement"]} == {"yes"}


def test_the_marginal_shape_fits_nuts_and_the_printed_one_does_not(result):
    for row in result.tables["full_conditional"]:
        assert abs(row["z_marginal"]) < 5.0
        assert row["z_full_conditional"] > 30.0


def test_agreement_blocks_show_every_quantity(result):
    blocks = agreement_blocks(result)
    assert [block["title"] for block in blocks] == [f"{dof}, {family}" for family in FAMILIES for dof in DOFS]
    for block, dof in zip(blocks, 2 * DOFS, strict=True):
        names = [cells[0] for cells in block["table"].cells]
        assert names == [*result.vessel.coefficients(dof)["coefficient"].values, "σ²"]


def test_page_tables_are_rectangular_and_numbers_stand_under_numeric_heads(result):
    tables = page_tables(result)
    assert {"indices", "denoising", "data", "priors", "errors", "agreement"} <= set(tables)
    for made in tables.values():
        assert made.cells
        assert {len(cells) for cells in made.cells} == {len(made.heads)} == {len(made.numeric)}
    heads = dict(zip(tables["errors"].heads, tables["errors"].numeric, strict=True))
    assert (heads["DOF"], heads["median %"]) == (False, True)


def test_findings_do_without_the_literal_level(result):
    """A study of chosen levels is reported, too."""
    rows = {name: [row for row in rows if row.get("level") != LITERAL_LEVEL] for name, rows in result.tables.items()}
    fewer = replace(result, tables=rows)
    assert len(findings.all_findings(fewer)) == len(findings.all_findings(result))
    assert findings.short(fewer) == findings.short(result)


def test_the_figures_of_a_ship_that_does_not_roll_are_drawn(result):
    assert set(report._figures(unpublished(result))) == FIGURES


def test_nothing_is_said_of_a_print_that_is_not_there(result):
    said = [*findings.short(unpublished(result)), *(one["text"] for one in findings.all_findings(unpublished(result)))]
    assert [text for text in said if "0 of 0" in text or "– %" in text or "Xv" in text] == []


def test_the_study_draws_the_same_noise_whatever_else_runs(result):
    again = ps.pollute(result.trial, level=LEVEL, rng=generator(SEED, "noise", LEVEL))
    assert again.identical(result.noisy[LEVEL])


def test_the_folder_holds_page_figures_tables_and_posteriors(folder):
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert names == FILES


def six_digits(value):
    return str(float(f"{value:.6g}") if isinstance(value, float) else value)


@pytest.mark.parametrize("name", TABLES)
def test_a_csv_holds_the_rows_of_its_table(result, folder, name):
    with (folder / "tables" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        read = list(csv.DictReader(file))
    rows = [{key: six_digits(value) for key, value in row.items()} for row in csv_tables(result)[name]]
    assert read == rows


def test_figures_beside_the_page_are_png(folder):
    assert all(path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n") for path in (folder / "figures").iterdir())


@pytest.mark.parametrize("method", METHODS)
def test_a_posterior_is_without_what_its_draws_and_data_give_again(result, folder, method):
    path = folder / "posteriors" / f"sway-semiconjugate-{method}.nc"
    tree = ps.read_posterior(path)
    by_row = {"log_likelihood", "prior_predictive", "posterior_predictive"}
    assert not by_row & set(tree.children)
    assert path.stat().st_size < 3e6
    data, prior = (getattr(result.identifications[LEVEL], name) for name in ("data", "priors"))
    whole = ps.with_predictive(tree, data["sway"], prior["semiconjugate"]["sway"], rng=1)
    assert by_row <= set(whole.children)


@pytest.mark.parametrize("method", METHODS)
def test_a_posterior_is_read_back(result, folder, method):
    tree = ps.read_posterior(folder / "posteriors" / f"sway-semiconjugate-{method}.nc")
    written = result.draws["semiconjugate"][method]["sway"]
    assert tree["posterior"].to_dataset().identical(written["posterior"].to_dataset())
    assert tree.attrs == written.attrs
    assert tree.attrs["dof"] == "sway"


def test_the_page_is_well_formed(page, text):
    assert text.lstrip().startswith("<!doctype html>")
    assert page.faults == []
    assert [len(page.all(tag)) for tag in ("html", "head", "body", "title", "h1")] == [1, 1, 1, 1, 1]


def test_the_page_is_self_contained(page, text):
    assert set(page.fetched) == {"diagnostics.html"}
    assert page.all("script") == page.all("link") == page.all("iframe") == []
    style = re.findall(r"<style.*?</style>", text, flags=re.DOTALL)
    assert not any("@import" in part or "http" in part for part in style)
    assert re.findall(r"url\((?!#)", text) == []


def test_the_page_states_step_and_limit_of_the_fits(text):
    assert "Euler steps of 0.02 s" in text
    assert f"Pareto k-hat exceeds {KHAT_LIMIT:g}." in text


def test_the_page_names_no_place_on_this_machine(text, page, folder):
    places = {str(folder), str(Path.home()), str(Path.cwd()), str(Path(ps.__file__).parent), "/tmp/", sys.prefix}
    assert [place for place in places if place in text] == []
    assert re.findall(r"https?://\S+", page.text) == []


def test_every_link_of_the_page_has_its_place(page):
    targets = [attrs["href"] for attrs in page.all("a") if attrs["href"] != "diagnostics.html"]
    assert len(targets) == 12  # ten sections; the figure of methods and its section link each other
    assert {target.removeprefix("#") for target in targets} <= set(page.ids)


def test_ids_of_sections_and_figures_are_unique(page):
    """Also against the ids inside the figures."""
    own = [attrs["id"] for tag, attrs in page.elements if tag in ("section", "figure")]
    assert [name for name in own if page.ids.count(name) > 1] == []


def test_ids_inside_the_figures_are_unique(page):
    """Two figures of a page must not mean each other's markers."""
    assert len(set(page.ids)) == len(page.ids)


def test_every_figure_has_a_caption_and_every_image_its_words(page):
    drawn = [attrs["id"] for attrs in page.all("figure")]
    assert set(drawn) == FIGURES | {f"{kind}_{family}" for kind in ("trace", "rank") for family in FAMILIES}
    assert len(drawn) == 12
    assert all(len(page.captions[name]) > 20 for name in drawn)
    assert all(attrs["alt"] for attrs in page.all("img"))
    assert len(page.all("svg")) + len(page.all("img")) == len(drawn)


def test_the_page_fits_a_phone(page):
    metas = {attrs["name"]: attrs["content"] for attrs in page.all("meta") if "name" in attrs}
    assert metas["viewport"] == "width=device-width, initial-scale=1"
    assert {"charset": "utf-8"} in page.all("meta")
    scrolled = [attrs for attrs in page.all("div") if attrs.get("class") == "scroll"]
    assert len(scrolled) == len(page.all("table")) > 20


def test_no_number_of_the_page_is_missing(page):
    assert re.findall(r".{0,40}\b(?:nan|None|inf|NaN|undefined)\b.{0,40}", page.text) == []
    assert "{{" not in page.text
    assert "{%" not in page.text


def test_the_page_says_what_was_run(page):
    assert "Noise level shown 0.01, seed 3." in page.text
    assert "Bayesian regression of 102 coefficients" in page.text
    assert "16 of 16 comparisons" in page.text
    assert f"--level {LEVEL:g} --seed {SEED}" in page.text


def test_the_page_goes_from_the_bound_down(page, result):
    assert "9 Methods and the Cramer-Rao bound" in page.text
    below = sum(row["below"] for row in result.tables["published_bound"])
    assert f"{below} of 186 published errors lie below" in page.text
    assert page.text.count("Cramer-Rao bounds at noise levels 0.447 (beside the published) and 0.01") == len(DOFS)
    assert page.text.count("outside the motion of the record") >= 3


def test_rendering_twice_gives_the_same_page(result, text):
    same = render_page(report.PAGE, report.study_content(result, "")) == text
    assert same
    assert plt.get_fignums() == []


@pytest.mark.usefixtures("undrawn")
def test_the_page_follows_its_result(result, text, monkeypatch):
    """The broken twin of the last: another seed, and the images of the chains left out to save time."""
    monkeypatch.setattr(report, "_trace_figures", lambda result: [])
    other = Page(render_page(report.PAGE, report.study_content(replace(result, seed=SEED + 1), "")))
    assert f"seed {SEED + 1}." in other.text
    assert f"seed {SEED}." not in other.text


def test_the_pages_link_to_each_other(page, diagnosed, folder):
    for one, other in ((page, "diagnostics.html"), (diagnosed, "index.html")):
        assert [attrs["href"] for attrs in one.all("a")].count(other) == 1
        assert (folder / other).is_file()


def test_the_diagnostics_have_a_section_for_each_dof_and_family(diagnosed):
    names = [f"{dof}, {family}" for dof in DOFS for family in FAMILIES]
    heads = re.findall(r"\d (\w+, \w+conjugate|\w+, conjugate) All convergence diagnostics pass\.", diagnosed.text)
    assert heads == names
    assert diagnosed.text.count("Against the exact posterior: gibbs agrees (largest |z|") == len(names)
    assert "exact, 4 chains of 1000 draws; gibbs, 4 chains of 2000 draws; nuts, 4 chains of 2000" in diagnosed.text
    assert "diagnostic fails" not in diagnosed.text


def test_a_section_draws_the_exact_posterior_and_the_chains_of_nuts(diagnosed, result):
    kinds = "forest trace rank ess energy noise predictive pair correlation residuals pareto pit ships"
    assert [attrs["id"] for attrs in diagnosed.all("figure")] == [f"posterior-1-{kind}" for kind in kinds.split()]
    assert diagnosed.faults == []
    assert diagnosed.fetched == ["index.html"]
    assert "The chains are those of nuts." in diagnosed.text
    assert "Leave-one-out cross-validation elpd" in diagnosed.text
    assert "quantities move with the prior" in diagnosed.text


@pytest.mark.usefixtures("undrawn")
def test_a_study_whose_chains_fail_says_where_and_writes_both_pages(result, tmp_path, monkeypatch):
    """One chain of NUTS stands elsewhere; the study itself holds."""
    tree = result.draws["conjugate"]["nuts"]["yaw"]
    torn = tree.assign({"posterior": tree["posterior"].copy(deep=True)})
    torn["posterior"]["coefficients"][3, :, 0] += 1.0
    trees = result.draws["conjugate"]["nuts"] | {"yaw": torn}
    draws = result.draws | {"conjugate": result.draws["conjugate"] | {"nuts": trees}}
    broken = replace(result, draws=draws)
    assert failure_sentence(result.comparisons) == ""
    assert re.match(
        r".* in 1 of 8 posteriors, first in yaw, conjugate: nuts: largest R-hat ", failure_sentence(broken.comparisons)
    )
    monkeypatch.setattr(diagnostic_report, "posterior_kind", subsections_of())
    monkeypatch.setattr(report, "_trace_figures", lambda result: [])
    report.write_study(broken, tmp_path)
    pages = [(tmp_path / name).read_text(encoding="utf-8") for name in ("index.html", "diagnostics.html")]
    assert "yaw, conjugate</a> (a convergence diagnostic fails)" in pages[1]
    assert pages[1].count("a convergence diagnostic fails") == 1
