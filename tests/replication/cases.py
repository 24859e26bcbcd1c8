"""A small study: its levels and seed, the tables and figures it must have, and how its page is read."""

from __future__ import annotations

from dataclasses import replace
from html.parser import HTMLParser

from pymc_ship.diagnostics.regression_subsections import REGRESSION
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.pages.drawing import subplots
from pymc_ship.pages.page import Content
from pymc_ship.records.files.noise import LITERAL_LEVEL
from pymc_ship.replication import measurements
from pymc_ship.replication import page as report
from pymc_ship.replication.scores import published_rows

DOFS = ("surge", "sway", "yaw", "roll")
LEVEL, SEED, SWEEP = 0.01, 3, (1e-4, 1e-2)
SHOWN = (LEVEL, LITERAL_LEVEL)


def subsections_of(*names):
    """Kind of posterior whose sections of these names have subsections, and no others, which take long to draw."""

    def subsections(one, ship, rng):
        return REGRESSION.subsections(one, ship, rng) if one.name in names else []

    kind = replace(REGRESSION, subsections=subsections)
    return lambda tree: kind


SUMMARY = {"family", "dof", "coefficients", "median", "under_5", "under_20", "under_50", "coverage"}
FORECAST = {"level", "manoeuvre", "error", "coverage", "diverged", "extrapolated", "extrapolation"}
TABLES = {
    "errors": (2 * 2 * 5, SUMMARY | {"level"}),
    "sweep": (2 * 5, SUMMARY | {"level"}),
    "published": (2 * 5, SUMMARY | {"level"}),
    "differencing": (3 * 2, SUMMARY | {"derivative", "interval"}),
    "discretisation": (3, {"differences", "worst", *DOFS}),
    "priors": (2 * 4 * 4, {"family", "dof", "choice", "shape", "scale", "kappa", "score", "score_se", "log_evidence"}),
    "prior_ships": (
        2 * (2 * 4 + 1),
        {"family", "choice", "manoeuvre", "diverged", "wrong_way", "course_unstable", "complete", "index", "reached"},
    ),
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
    "denoisers": (
        5,
        (SUMMARY - {"family", "dof"}) | {"method", *(f"snr_{name}" for name in ("u", "v", "r", "p", "phi"))},
    ),
    "drawn_channels": (5, {"channel", "coverage", "sd", "rmse"}),
    "drawn_coefficients": (
        2 * 4,
        {"derivative", "dof", "median", "coverage", "median_pooled", "coverage_pooled", "widened"},
    ),
    "methods": (2 * 6, (SUMMARY - {"family", "dof"}) | {"level", "method", "detail"}),
    "published_bound": (2, {"family", "errors", "median", "below", "on_bound", "level"}),
    "trajectory_zigzag": (2, FORECAST | {"pareto_khat", "first_overshoot_angle_median"}),
    "trajectory_turning_circle": (2, FORECAST | {"pareto_khat", "advance_median"}),
    "data": (4, {"dof", "rows", "terms", "condition", "vif_median", "vif_largest", "largest"}),
}
UNKNOWN = {
    "prior_ships": {"lower", "median", "upper"},
    "published": {"coverage"},
    "agreement": {"divergences"},
    "coefficients": {f"{name}_{family}" for name in ("published", "published_error", "error") for family in FAMILIES}
    | {"bound", "bound_literal"},
    "methods": {"coverage", "coverage_half", "median", "under_5", "under_20", "under_50"},
}
"""What may be NaN: no ship of a wide prior may reach an index, no intervals are printed, nor are there of the bound,
Gibbs knows no divergence, a zero has no relative error, a fit without prior may fail under the literal noise."""


def median_errors(result):
    return {(row["level"], row["method"]): row["median"] for row in result.tables["methods"]}


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
METHODS = ("exact", "gibbs", "nuts")
FILES = {
    "index.html",
    "diagnostics.html",
    *(f"figures/{name}.png" for name in FIGURES),
    *(f"tables/{name}.csv" for name in TABLES),
    *(f"posteriors/{d}-{family}-{method}.nc" for d in DOFS for family in FAMILIES for method in METHODS),
}
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


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def quick_report(monkeypatch, template):
    """Make the report of a study take no time: one figure, one table, and pages of one word from a template."""
    template.write_text("{{ text }}")

    def study_content(result, diagnosed):
        figures, tables = {"sweep": subplots(1.0, 1.0)[0]}, {"errors": [{"dof": "surge", "median": 1.0}]}
        return Content({"text": "new"}, figures, tables, report._files(result, diagnosed))

    for name in ("PAGE", "DIAGNOSTICS"):
        monkeypatch.setattr(report, name, replace(getattr(report, name), template=template))
    monkeypatch.setattr(report, "study_content", study_content)
    monkeypatch.setattr(report, "diagnostic_content", lambda *_, **__: Content({"text": "diagnosed"}))
    monkeypatch.setattr(report, "write_posterior", lambda tree, path: path.write_text("posterior"))
