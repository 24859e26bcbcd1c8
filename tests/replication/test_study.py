"""The study end to end on a small run, and the page that reports it."""

from __future__ import annotations

import csv
import functools
import re
import sys
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.diagnostics import page as diagnostic_report
from pymc_ship.diagnostics.agreement import failure
from pymc_ship.frontier.bound import cramer_rao_bound
from pymc_ship.frontier.scores import published_rows
from pymc_ship.machine import files
from pymc_ship.machine.files import OutputError
from pymc_ship.machine.seeds import generator
from pymc_ship.regression import identify as identification
from pymc_ship.regression.priors import FAMILIES
from pymc_ship.replication import findings, measurements, study
from pymc_ship.replication import page as report
from pymc_ship.replication.tables import agreement_blocks, csv_tables, page_tables
from pymc_ship.trial.noise import LITERAL_LEVEL

DOFS = ("surge", "sway", "yaw", "roll")
LEVEL, SEED, SWEEP = 0.01, 3, (1e-4, 1e-2)
SHOWN = (LEVEL, LITERAL_LEVEL)


@pytest.fixture(scope="module")
def result(container):
    """A small run: two noise levels, two of the sweep, few evaluations in the tuning."""
    with pytest.MonkeyPatch.context() as patch:
        few = functools.partial(identification.tune_prior, evaluations=6)
        patch.setattr(identification, "tune_prior", few)
        return study.run_study(container, level=LEVEL, levels=(LITERAL_LEVEL,), sweep=SWEEP, seed=SEED)


def parts_of(*names):
    """Parts of the sections of these names, none of the others, which take long to draw."""
    parts = diagnostic_report.parts
    return lambda one, ship, rng: parts(one, ship, rng) if one.name in names else []


@pytest.fixture(scope="module")
def folder(result, tmp_path_factory):
    out = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(diagnostic_report, "parts", parts_of("surge, conjugate"))
        assert report.write_study(result, out) == out / "index.html"
    return out


@pytest.fixture(scope="module")
def text(folder):
    return (folder / "index.html").read_text(encoding="utf-8")


# tables ---------------------------------------------------------------------------------------------------------------

SUMMARY = {"family", "dof", "coefficients", "median", "under_5", "under_20", "under_50", "coverage"}
FORECAST = {"level", "manoeuvre", "error", "coverage", "share_diverged", "share_extrapolated", "extrapolation"}
TABLES = {
    "errors": (2 * 2 * 5, SUMMARY | {"level"}),
    "sweep": (2 * 5, SUMMARY | {"level"}),
    "published": (2 * 5, SUMMARY | {"level"}),
    "differencing": (3 * 2, SUMMARY | {"derivative", "interval"}),
    "discretisation": (3, {"differences", "worst", *DOFS}),
    "priors": (2 * 4 * 4, {"family", "dof", "choice", "shape", "scale", "kappa", "score", "score_se", "log_evidence"}),
    "printed_errors": (4, {"dof", "printed", "fit_own", "fit_other"}),
    "full_conditional": (4, {"dof", "mcmc", "mcse", "z_marginal", "z_full_conditional"}),
    "forecast_zigzag": (4, FORECAST | {"family", "first_overshoot_angle_median", "second_overshoot_angle_reference"}),
    "forecast_turning_circle": (4, FORECAST | {"family", "advance_median", "tactical_diameter_reference"}),
    "coefficients": (
        102,
        {
            "dof",
            "coefficient",
            "reference",
            "sign_source",
            "mean_conjugate",
            "sd_semiconjugate",
            "bound",
            "bound_literal",
        },
    ),
    "agreement": (16, {"family", "dof", "method", "largest_z", "z_limit", "r_hat", "divergences", "agrees"}),
    "denoising": (6, {"channel", "noise", "before", "after", "gain"}),
    "methods": (2 * 6, (SUMMARY - {"family", "dof"}) | {"level", "method", "detail"}),
    "published_bound": (2, {"family", "errors", "median", "below", "on_bound", "level"}),
    "trajectory_zigzag": (2, FORECAST | {"pareto_khat", "first_overshoot_angle_median"}),
    "trajectory_turning_circle": (2, FORECAST | {"pareto_khat", "advance_median"}),
    "data": (4, {"dof", "rows", "terms", "condition", "vif_median", "vif_largest", "largest"}),
}
UNKNOWN = {
    "published": {"coverage"},
    "agreement": {"divergences"},
    "coefficients": {f"{name}_{family}" for name in ("published", "published_error", "error") for family in FAMILIES}
    | {"bound", "bound_literal"},
    "methods": {"coverage", "median", "under_5", "under_20", "under_50"},
}
"""What may be NaN: no intervals are printed, nor are there of the bound, Gibbs knows no divergence, a zero has no
relative error, a fit without prior may fail under the literal noise."""


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_a_table_has_its_rows_and_keys(result, name):
    n_rows, keys = TABLES[name]
    rows = csv_tables(result)[name]
    assert len(rows) == n_rows
    assert all(keys <= set(row) for row in rows)
    assert len({tuple(row) for row in rows}) == 1


@pytest.mark.slow
def test_every_table_is_known(result):
    assert set(csv_tables(result)) == set(TABLES)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in TABLES if not name.startswith(("forecast", "trajectory"))])
def test_a_table_is_finite_but_for_what_cannot_be_known(result, name):
    wrong = [
        (key, value)
        for row in csv_tables(result)[name]
        for key, value in row.items()
        if not isinstance(value, str) and key not in UNKNOWN.get(name, set()) and not np.isfinite(value)
    ]
    assert wrong == []


@pytest.mark.slow
def test_relative_errors_are_unknown_for_zeros_only(result):
    for row in csv_tables(result)["coefficients"]:
        for family in FAMILIES:
            assert np.isnan(row[f"error_{family}"]) == (row["reference"] == 0.0)
        assert np.isnan([row["bound"], row["bound_literal"]]).tolist() == 2 * [row["reference"] == 0.0]


@pytest.mark.slow
def test_forecasts_at_the_level_shown_are_scored_and_shares_are_shares(result):
    for name in ("forecast_zigzag", "forecast_turning_circle"):
        for row in result.tables[name]:
            assert 0.0 <= row["share_diverged"] <= 100.0
            if row["level"] == LEVEL:
                assert 0.0 < row["error"] < 100.0
                assert 0.0 <= row["coverage"] <= 100.0
    row = result.tables["forecast_turning_circle"][0]
    assert row["advance_lower"] <= row["advance_median"] <= row["advance_upper"]


def median_errors(result):
    return {(row["level"], row["method"]): row["median"] for row in result.tables["methods"]}


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_published_errors_cannot_come_from_the_printed_noise(result):
    for row in result.tables["published_bound"]:
        assert row["below"] > 0.95 * row["errors"]
        assert row["on_bound"] > 100.0 * row["median"]
        assert row["level"] < 0.01 * LITERAL_LEVEL
    bound = median_errors(result)[LITERAL_LEVEL, "Cramer-Rao bound"]
    assert bound == pytest.approx(row["on_bound"], rel=0.1)


@pytest.mark.slow
def test_the_trajectory_fit_forecasts_better_than_the_pipeline(result):
    for name in ("zigzag", "turning_circle"):
        fit, pipeline = (
            next(row for row in result.tables[f"{kind}_{name}"] if row["level"] == LEVEL)
            for kind in ("trajectory", "forecast")
        )
        assert fit["error"] < 0.3 * pipeline["error"]
        assert "outside the motion of the record" in fit["extrapolation"]


@pytest.mark.slow
def test_levels_families_and_dofs_are_all_there(result):
    found = {(row["level"], row["family"], row["dof"]) for row in result.tables["errors"]}
    assert found == {(level, family, dof) for level in SHOWN for family in FAMILIES for dof in (*DOFS, "all")}
    assert set(result.noisy) == set(result.smooth) == set(result.found) == set(SHOWN)


@pytest.mark.slow
def test_errors_grow_with_the_noise(result):
    median = {row["level"]: row["median"] for row in result.tables["sweep"] if row["dof"] == "all"}
    assert median[1e-4] < 0.2 * median[1e-2]


@pytest.mark.slow
def test_denoising_lowers_every_error(result):
    for row in csv_tables(result)["denoising"]:
        assert row["gain"] == pytest.approx(row["before"] / row["after"])
        assert row["gain"] > 2.0
        assert row["before"] == pytest.approx(row["noise"], rel=0.05)


@pytest.mark.slow
def test_exact_gibbs_and_nuts_agree_everywhere(result):
    assert list(result.agreement) == list(FAMILIES)
    for by_dof in result.agreement.values():
        assert tuple(by_dof) == DOFS
        for dataset in by_dof.values():
            assert dataset["method"].values.tolist() == ["gibbs", "nuts"]
            assert dataset["agrees"].values.all(), dataset.attrs["verdict"]
    assert {row["agrees"] for row in csv_tables(result)["agreement"]} == {"yes"}


@pytest.mark.slow
def test_the_marginal_shape_fits_nuts_and_the_printed_one_does_not(result):
    for row in result.tables["full_conditional"]:
        assert abs(row["z_marginal"]) < 5.0
        assert row["z_full_conditional"] > 30.0


@pytest.mark.slow
def test_agreement_blocks_show_every_quantity(result):
    blocks = agreement_blocks(result)
    assert [block["title"] for block in blocks] == [f"{dof}, {family}" for family in FAMILIES for dof in DOFS]
    for block, dof in zip(blocks, 2 * DOFS, strict=True):
        names = [cells[0] for cells in block["table"].cells]
        assert names == [*result.vessel.coefficients(dof)["coefficient"].values, "σ²"]


@pytest.mark.slow
def test_page_tables_are_rectangular_and_numbers_stand_under_numeric_heads(result):
    tables = page_tables(result)
    assert {"indices", "denoising", "data", "priors", "errors", "agreement"} <= set(tables)
    for made in tables.values():
        assert made.cells
        assert {len(cells) for cells in made.cells} == {len(made.heads)} == {len(made.numeric)}
    heads = dict(zip(tables["errors"].heads, tables["errors"].numeric, strict=True))
    assert (heads["DOF"], heads["median %"]) == (False, True)


@pytest.mark.slow
def test_findings_do_without_the_literal_level(result):
    """A study of chosen levels is reported, too."""
    rows = {name: [row for row in rows if row.get("level") != LITERAL_LEVEL] for name, rows in result.tables.items()}
    fewer = replace(result, tables=rows)
    assert len(findings.all_findings(fewer)) == len(findings.all_findings(result))
    assert findings.short(fewer) == findings.short(result)


def unpublished(result):
    """The result as of a ship that does not roll and of which nothing is published."""
    kept = {
        dof: tuple(replace(c, published={}, published_error={}) for c in result.vessel.forces[dof]) for dof in DOFS[:3]
    }
    vessel = replace(result.vessel, name="my_ship", forces=kept)
    draws = {
        family: {method: {dof: tree for dof, tree in trees.items() if dof in kept} for method, trees in methods.items()}
        for family, methods in result.draws.items()
    }
    tables = {name: [row for row in rows if row.get("dof") != "roll"] for name, rows in result.tables.items()}
    tables["published"] = published_rows(vessel, FAMILIES)
    tables["printed_errors"] = measurements.printed_error_rows(vessel, tuple(FAMILIES))
    names = [str(name) for dof in kept for name in vessel.coefficients(dof)["coefficient"].values]
    unit_bound = result.bound.sel(coefficient=names).values
    tables["published_bound"] = measurements.published_bound_rows(vessel, unit_bound, tuple(FAMILIES))
    return replace(result, vessel=vessel, draws=draws, tables=tables)


@pytest.mark.slow
def test_the_figures_of_a_ship_that_does_not_roll_are_drawn(result):
    assert set(report._figures(unpublished(result))) == FIGURES


@pytest.mark.slow
def test_nothing_is_said_of_a_print_that_is_not_there(result):
    said = [*findings.short(unpublished(result)), *(one["text"] for one in findings.all_findings(unpublished(result)))]
    assert [text for text in said if "0 of 0" in text or "– %" in text or "Xv" in text] == []


# generators -----------------------------------------------------------------------------------------------------------

PURPOSES = [
    ("noise", 0.01),
    ("noise", 0.001),
    ("prior", 0.01),
    ("forecast", 0.01, "conjugate", "zigzag"),
    ("forecast", 0.01, "semiconjugate", "zigzag"),
    ("forecast", 0.01, "conjugate", "turning_circle"),
    ("exact", "conjugate"),
    ("nuts", "conjugate", "surge"),
    ("gibbs", "conjugate", "surge"),
    ("nuts", "conjugate", "sway"),
    ("sweep",),
    ("trajectory", 0.01),
]


def first_numbers(purposes, seed=SEED):
    return {purpose: generator(seed, *purpose).integers(2**62, size=4).tolist() for purpose in purposes}


def test_a_generator_depends_on_seed_and_purpose_and_not_on_the_order():
    forward = first_numbers(PURPOSES)
    assert first_numbers(reversed(PURPOSES)) == forward
    assert len({tuple(numbers) for numbers in forward.values()}) == len(PURPOSES)
    other = first_numbers(PURPOSES, seed=SEED + 1)
    assert all(other[purpose] != forward[purpose] for purpose in PURPOSES)


def test_purposes_are_told_apart_by_every_word():
    assert len({tuple(n) for n in first_numbers([("a", "b"), ("ab",), ("b", "a"), ("a",), ("b",)]).values()}) == 5


@pytest.mark.slow
def test_the_study_draws_the_same_noise_whatever_else_runs(result):
    again = ps.pollute(result.trial, level=LEVEL, rng=generator(SEED, "noise", LEVEL))
    assert again.identical(result.noisy[LEVEL])


# files ----------------------------------------------------------------------------------------------------------------

FIGURES = {
    "denoising",
    "noise_variance",
    "tuning",
    "sample_paths",
    "sweep",
    "methods",
    "forecast_zigzag",
    "forecast_turning_circle",
}


@pytest.mark.slow
def test_the_folder_holds_page_figures_tables_and_posteriors(folder):
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    methods = ("exact", "gibbs", "nuts")
    assert names == {
        "index.html",
        "diagnostics.html",
        *(f"figures/{name}.png" for name in FIGURES),
        *(f"tables/{name}.csv" for name in TABLES),
        *(f"posteriors/{d}-{family}-{method}.nc" for d in DOFS for family in FAMILIES for method in methods),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_a_csv_holds_the_rows_of_its_table(result, folder, name):
    with (folder / "tables" / f"{name}.csv").open(encoding="utf-8", newline="") as file:
        read = list(csv.DictReader(file))
    rows = csv_tables(result)[name]
    assert read == [{key: str(value) for key, value in row.items()} for row in rows]


@pytest.mark.slow
def test_figures_beside_the_page_are_png(folder):
    assert all(path.read_bytes().startswith(b"\x89PNG\r\n\x1a\n") for path in (folder / "figures").iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("method", ["exact", "gibbs", "nuts"])
def test_a_posterior_is_read_back(result, folder, method):
    tree = ps.read_posterior(folder / "posteriors" / f"sway-semiconjugate-{method}.nc")
    written = result.draws["semiconjugate"][method]["sway"]
    assert tree["posterior"].to_dataset().identical(written["posterior"].to_dataset())
    assert tree.attrs == written.attrs
    assert tree.attrs["dof"] == "sway"


# page -----------------------------------------------------------------------------------------------------------------

VOID = {"area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source", "track", "wbr"}


class Page(HTMLParser):
    """Elements, links, ids and visible text of a page; ``faults`` holds tags that do not balance."""

    def __init__(self, text):
        super().__init__()
        self.open, self.faults, self.elements, self.words, self.captions = [], [], [], [], {}
        self.feed(text)
        self.close()
        self.faults += [f"<{tag}> is not closed" for tag, _ in self.open]

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append((tag, dict(attrs)))

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if not self.open or self.open[-1][0] != tag:
            self.faults.append(f"</{tag}> at {self.getpos()}")
        else:
            self.open.pop()

    def handle_data(self, data):
        tags = [tag for tag, _ in self.open]
        if not {"style", "svg"} & set(tags):
            self.words.append(data)
        if "figcaption" in tags and data.strip():
            name = next(attrs["id"] for tag, attrs in self.open if tag == "figure")
            self.captions[name] = self.captions.get(name, "") + data

    def all(self, tag):
        return [attrs for name, attrs in self.elements if name == tag]

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())

    @property
    def ids(self):
        return [attrs["id"] for _, attrs in self.elements if "id" in attrs]

    @property
    def fetched(self):
        """Everything a browser would load or follow, but for data inside the page and places in it."""
        names = ("src", "href", "xlink:href", "action", "data", "srcset", "poster")
        values = [attrs[name] for _, attrs in self.elements for name in names if attrs.get(name)]
        return [value for value in values if not value.startswith(("#", "data:"))]


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


def test_the_checks_of_a_page_can_fail():
    bad = Page('<p><b>nan</p><img src="https://a.b/c.png"><figure id="x"></figure><a href="#gone">')
    assert bad.faults
    assert bad.fetched == ["https://a.b/c.png"]
    assert bad.captions == {}
    assert "gone" not in bad.ids
    assert re.search(r"\bnan\b", bad.text)


@pytest.mark.slow
def test_the_page_is_well_formed(page, text):
    assert text.lstrip().startswith("<!doctype html>")
    assert page.faults == []
    assert [len(page.all(tag)) for tag in ("html", "head", "body", "title", "h1")] == [1, 1, 1, 1, 1]


@pytest.mark.slow
def test_the_page_is_self_contained(page, text):
    assert set(page.fetched) == {"diagnostics.html"}
    assert page.all("script") == page.all("link") == page.all("iframe") == []
    style = re.findall(r"<style.*?</style>", text, flags=re.DOTALL)
    assert not any("@import" in part or "http" in part for part in style)
    assert re.findall(r"url\((?!#)", text) == []


@pytest.mark.slow
def test_the_page_names_no_place_on_this_machine(text, page, folder):
    places = {str(folder), str(Path.home()), str(Path.cwd()), str(Path(ps.__file__).parent), "/tmp/", sys.prefix}
    assert [place for place in places if place in text] == []
    assert re.findall(r"https?://\S+", page.text) == []


@pytest.mark.slow
def test_every_link_of_the_page_has_its_place(page):
    targets = [attrs["href"] for attrs in page.all("a") if attrs["href"] != "diagnostics.html"]
    assert len(targets) == 10
    assert {target.removeprefix("#") for target in targets} <= set(page.ids)


@pytest.mark.slow
def test_ids_of_sections_and_figures_are_unique(page):
    """Also against the ids inside the figures."""
    own = [attrs["id"] for tag, attrs in page.elements if tag in ("section", "figure")]
    assert [name for name in own if page.ids.count(name) > 1] == []


@pytest.mark.slow
def test_ids_inside_the_figures_are_unique(page):
    """Two figures of a page must not mean each other's markers."""
    assert len(set(page.ids)) == len(page.ids)


@pytest.mark.slow
def test_every_figure_has_a_caption_and_every_image_its_words(page):
    drawn = [attrs["id"] for attrs in page.all("figure")]
    assert set(drawn) == FIGURES | {f"{kind}_{family}" for kind in ("trace", "rank") for family in FAMILIES}
    assert len(drawn) == 12
    assert all(len(page.captions[name]) > 20 for name in drawn)
    assert all(attrs["alt"] for attrs in page.all("img"))
    assert len(page.all("svg")) + len(page.all("img")) == len(drawn)


@pytest.mark.slow
def test_the_page_fits_a_phone(page):
    metas = {attrs["name"]: attrs["content"] for attrs in page.all("meta") if "name" in attrs}
    assert metas["viewport"] == "width=device-width, initial-scale=1"
    assert {"charset": "utf-8"} in page.all("meta")
    scrolled = [attrs for attrs in page.all("div") if attrs.get("class") == "scroll"]
    assert len(scrolled) == len(page.all("table")) > 20


@pytest.mark.slow
def test_no_number_of_the_page_is_missing(page):
    assert re.findall(r".{0,40}\b(?:nan|None|inf|NaN|undefined)\b.{0,40}", page.text) == []
    assert "{{" not in page.text
    assert "{%" not in page.text


@pytest.mark.slow
def test_the_page_says_what_was_run(page):
    assert "Noise level shown 0.01, seed 3." in page.text
    assert "Bayesian regression of 102 coefficients" in page.text
    assert "16 of 16 comparisons" in page.text
    assert f"--level {LEVEL:g} --seed {SEED}" in page.text


@pytest.mark.slow
def test_the_page_goes_from_the_bound_down(page, result):
    assert "9 From the bound down" in page.text
    below = sum(row["below"] for row in result.tables["published_bound"])
    assert f"{below} of 186 published errors lie below" in page.text
    assert page.text.count("Cramer-Rao bounds at noise levels 0.447 (beside the published) and 0.01") == len(DOFS)
    assert page.text.count("outside the motion of the record") >= 3


@pytest.mark.slow
def test_rendering_twice_gives_the_same_page(result, text):
    same = report.render(result, report._figures(result)) == text
    assert same
    assert plt.get_fignums() == []


@pytest.mark.slow
def test_the_page_follows_its_result(result, text, monkeypatch):
    """The broken twin of the last: another seed, and the images of the chains left out to save time."""
    monkeypatch.setattr(report, "_trace_figures", lambda result: [])
    other = Page(report.render(replace(result, seed=SEED + 1), report._figures(result)))
    assert f"seed {SEED + 1}." in other.text
    assert f"seed {SEED}." not in other.text


# diagnostics ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def diagnosed(folder):
    return Page((folder / "diagnostics.html").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_the_pages_link_to_each_other(page, diagnosed, folder):
    for one, other in ((page, "diagnostics.html"), (diagnosed, "index.html")):
        assert [attrs["href"] for attrs in one.all("a")].count(other) == 1
        assert (folder / other).is_file()


@pytest.mark.slow
def test_the_diagnostics_have_a_section_for_each_dof_and_family(diagnosed):
    names = [f"{dof}, {family}" for dof in DOFS for family in FAMILIES]
    heads = re.findall(r"\d (\w+, \w+conjugate|\w+, conjugate) All convergence gates hold\.", diagnosed.text)
    assert heads == names
    assert diagnosed.text.count("Against the exact posterior: gibbs agrees (largest |z|") == len(names)
    assert "exact, 4 chains of 1000 draws; gibbs, 4 chains of 2000 draws; nuts, 4 chains of 2000" in diagnosed.text
    assert "gate fails" not in diagnosed.text


@pytest.mark.slow
def test_a_section_draws_the_exact_posterior_and_the_chains_of_nuts(diagnosed, result):
    kinds = "forest trace rank ess energy noise predictive pair correlation residuals pareto pit"
    assert [attrs["id"] for attrs in diagnosed.all("figure")] == [f"posterior-1-{kind}" for kind in kinds.split()]
    assert diagnosed.faults == []
    assert diagnosed.fetched == ["index.html"]
    assert "The chains are those of nuts." in diagnosed.text
    assert "Leave-one-out cross-validation elpd" in diagnosed.text
    assert "quantities move with the prior" in diagnosed.text


@pytest.mark.slow
def test_a_study_whose_chains_fail_says_where_and_writes_both_pages(result, tmp_path, monkeypatch):
    """One chain of NUTS stands elsewhere; the study itself holds."""
    tree = result.draws["conjugate"]["nuts"]["yaw"]
    torn = tree.assign({"posterior": tree["posterior"].copy(deep=True)})
    torn["posterior"]["coefficients"][3, :, 0] += 1.0
    trees = result.draws["conjugate"]["nuts"] | {"yaw": torn}
    draws = result.draws | {"conjugate": result.draws["conjugate"] | {"nuts": trees}}
    broken = replace(result, draws=draws)
    assert failure(result.comparisons) == ""
    assert re.match(
        r".* in 1 of 8 posteriors, first in yaw, conjugate: nuts: largest R-hat ", failure(broken.comparisons)
    )
    monkeypatch.setattr(diagnostic_report, "parts", parts_of())
    monkeypatch.setattr(report, "_trace_figures", lambda result: [])
    report.write_study(broken, tmp_path)
    pages = [(tmp_path / name).read_text(encoding="utf-8") for name in ("index.html", "diagnostics.html")]
    assert "yaw, conjugate</a> (a gate fails)" in pages[1]
    assert pages[1].count("a gate fails") == 1


# interrupted writes ---------------------------------------------------------------------------------------------------


@pytest.fixture
def earlier(tmp_path, monkeypatch):
    """Folder with an earlier report, and a report that takes no time."""
    monkeypatch.setattr(report, "_figures", lambda result: {})
    monkeypatch.setattr(report, "render", lambda result, drawn: "new")
    monkeypatch.setattr(report, "diagnostic_page", lambda *arguments, **settings: "diagnosed")
    monkeypatch.setattr(report, "csv_tables", lambda result: {"errors": [{"dof": "surge", "median": 1.0}]})
    (tmp_path / "index.html").write_text("earlier")
    return tmp_path


NOTHING = SimpleNamespace(draws={}, comparisons=[], vessel=None, seed=SEED)


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_complete_write_replaces_the_earlier_page(earlier):
    report.write_study(NOTHING, earlier)
    assert (earlier / "index.html").read_text() == "new"
    assert (earlier / "tables" / "errors.csv").read_text() == "dof,median\nsurge,1.0\n"
    assert (earlier / "diagnostics.html").read_text() == "diagnosed"
    assert names(earlier) == ["diagnostics.html", "figures", "index.html", "posteriors", "tables"]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, RuntimeError])
@pytest.mark.parametrize("page", ["render", "diagnostic_page"])
def test_a_page_that_cannot_be_rendered_leaves_everything_as_it_was(earlier, monkeypatch, page, stop):
    def fail(*arguments, **settings):
        raise stop("stopped")

    monkeypatch.setattr(report, page, fail)
    with pytest.raises(stop, match="stopped"):
        report.write_study(NOTHING, earlier)
    assert names(earlier) == ["index.html"]
    assert (earlier / "index.html").read_text() == "earlier"


@pytest.mark.parametrize("step", ["figures", "posteriors", "tables", "diagnostics.html", "index.html"])
@pytest.mark.parametrize(("stop", "raised"), [(KeyboardInterrupt, KeyboardInterrupt), (OSError, OutputError)])
def test_an_interrupted_write_keeps_the_earlier_page_and_no_partial(earlier, monkeypatch, step, stop, raised):
    moved = []

    def move(source, target, replace=files.os.replace):
        moved.append(Path(target).name)
        if moved[-1] == step:
            raise stop("stopped")
        replace(source, target)

    monkeypatch.setattr(files.os, "replace", move)
    with pytest.raises(raised):
        report.write_study(NOTHING, earlier)
    assert moved[-1] == step
    assert (earlier / "index.html").read_text() == "earlier"
    assert [name for name in names(earlier) if name.startswith(".")] == []


def test_the_page_is_moved_into_place_last(earlier, monkeypatch):
    moved = []

    def move(source, target, replace=files.os.replace):
        moved.append(Path(target).name)
        replace(source, target)

    monkeypatch.setattr(files.os, "replace", move)
    report.write_study(NOTHING, earlier)
    assert moved[-2:] == ["diagnostics.html", "index.html"]


# bad input ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def no_work(monkeypatch):
    """Any simulation of the study is an error of the test."""

    def fail(*arguments, **settings):
        raise AssertionError("the long work began")

    monkeypatch.setattr(study, "simulate", fail)


@pytest.mark.usefixtures("no_work")
def test_the_study_begins_where_its_input_is_good(tmp_path):
    with pytest.raises(AssertionError, match="the long work began"):
        ps.study(tmp_path)


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("place", ["taken", "taken/report"])
def test_a_folder_that_cannot_be_written_is_named_before_any_work(tmp_path, place):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(OutputError, match=r"taken.* cannot be written"):
        ps.study(tmp_path / place)
    assert names(tmp_path) == ["taken"]
    assert (tmp_path / "taken").read_text() == "a file"


@pytest.mark.usefixtures("no_work")
def test_an_unknown_vessel_is_named_before_any_work(tmp_path):
    with pytest.raises(ps.VesselError, match="found 'tanker'"):
        ps.study(tmp_path / "report", vessel="tanker")
    assert names(tmp_path) == []


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize("level", [-0.01, float("nan"), float("inf")])
def test_a_noise_level_that_is_none_is_named_before_any_work(container, level):
    with pytest.raises(ValueError, match="noise level"):
        study.run_study(container, level=level)
