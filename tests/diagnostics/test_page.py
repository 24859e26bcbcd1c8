"""The diagnostic page: what it says of posteriors right, wrong or incomplete."""

import re
from html.parser import HTMLParser

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from tests.diagnostics.cases import without
from tests.diagnostics.regressions import shifted, three_ways, torn
from tests.sentences import refused

pytestmark = pytest.mark.filterwarnings("error")
TITLES = [
    "Convergence diagnostics",
    "Agreement with the exact posterior",
    "Coefficients",
    "Chains",
    "Energy",
    "Prior and posterior of the noise variance",
    "Prior and posterior predictive check",
    "Correlation of the coefficients",
    "Singular directions of the design",
    "Residuals",
    "Leave-one-out cross-validation",
    "Sensitivity to prior and likelihood",
    "Ships of the prior and of the posterior",
]


class Tags(HTMLParser):
    """Open tags, ids and sources of a page; fails on tags that do not close."""

    def __init__(self, page):
        super().__init__()
        self.open, self.ids, self.links, self.sources = [], [], [], []
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.ids += [attrs["id"]] if "id" in attrs else []
        self.links += [attrs["href"]] if "href" in attrs else []
        self.sources += [attrs["src"]] if "src" in attrs else []
        if tag not in ("meta", "img"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def page(good, tmp_path_factory):
    """Page of a good posterior with its vessel and of a torn one that has nothing but its draws."""
    out = tmp_path_factory.mktemp("page")
    path = ps.diagnostic_report({"good": good}, out / "good", "container")
    bare = ps.diagnostic_report({"a < b": torn(good)}, out / "bare")
    return path.read_text(encoding="utf-8"), bare.read_text(encoding="utf-8"), path


@pytest.mark.slow
def test_the_page_is_one_file_that_needs_no_other(page):
    whole, bare, path = page
    assert path.name == "diagnostics.html"
    assert [entry.name for entry in path.parent.iterdir()] == ["diagnostics.html"]
    for text in (whole, bare):
        tags = Tags(text)
        assert len(set(tags.ids)) == len(tags.ids)
        assert {link.removeprefix("#") for link in tags.links} <= set(tags.ids)
        assert all(source.startswith("data:image/png;base64,") for source in tags.sources)
        assert re.findall(r"<h3[^>]*>(.*)</h3>", text) == TITLES
        assert "https://" not in text


@pytest.mark.slow
def test_the_page_states_its_defaults_and_shows_every_figure(page):
    whole, _, _ = page
    figures = {one for one in Tags(whole).ids if not re.fullmatch(r"repeat|posterior-1(-\d+)?", one)}
    kinds = "forest trace rank ess noise predictive pair correlation residuals pareto pit ships"
    assert figures == {f"posterior-1-{kind}" for kind in kinds.split()}
    for text in (
        "ci_kind eti",
        "ci_prob 0.95",
        "R-hat &lt; 1.01",
        "ESS &gt; 400",
        "E-BFMI &gt; 0.3",
        "envelope_prob 0.99",
    ):
        assert text in whole
    assert "Sway of container, method conjugate, 4 chains of 200 draws; 28 coefficients" in whole
    assert whole.count("determined</td>") > 5
    assert "Energy</h3>\n<p>Not shown: the tree has no sample_stats/energy.</p>" in whole


@pytest.mark.slow
def test_a_torn_posterior_heads_its_page_with_the_failing_diagnostic_and_says_what_is_missing(page):
    _, bare, _ = page
    assert "1 a &lt; b</h2>" in bare
    assert "(a convergence diagnostic fails)" in bare
    assert re.search(r"<li>A convergence diagnostic fails: largest R-hat [1-9.e]+.* \(Yv\), to be &lt; 1.01", bare)
    assert bare.count("Not shown: the tree has no") == 8
    assert "Not shown: no draws of the same data and prior by another method are given." in bare
    assert "the tree has no constant_data/design_matrix and no observed_data/response." in bare
    assert "the tree has no log_prior/coefficients and no constant_data/design_matrix and no observed" in bare


@pytest.mark.slow
def test_the_same_seed_gives_the_same_page(good, tmp_path):
    tree = without(good, "log_likelihood", "log_prior")
    first, second = (ps.diagnostic_report({"x": tree}, tmp_path / name, seed=3).read_bytes() for name in "ab")
    assert first == second


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
@pytest.mark.parametrize("case", ["one chain", "one coefficient", "stuck"])
def test_a_poor_posterior_is_still_reported(tmp_path, case):
    """What cannot be drawn is said; nothing is warned of, and a posterior that cannot be judged fails."""
    rng = np.random.default_rng(0)
    X = rng.standard_normal((50, 1 if case == "one coefficient" else 2))
    labels = {"coefficients": ("Yv", "Yr")[: X.shape[1]], "dof": "sway", "vessel": "raft"}
    data = ps.RegressionData.from_arrays(X, X.sum(axis=1) + 0.1 * rng.standard_normal(50), **labels)
    chains = 1 if case == "one chain" else 4
    tree = ps.exact_posterior(data, ps.ConjugatePrior(), draws=2400, chains=chains, rng=rng)
    if case == "stuck":
        still = tree["posterior"].to_dataset().copy(deep=True)
        still["coefficients"][:] = 1.0
        tree = tree.assign({"posterior": xr.DataTree(still)}).drop_nodes("log_likelihood")
    page = ps.diagnostic_report({"x": tree}, tmp_path).read_text(encoding="utf-8")
    said = {
        "one chain": "Ranks are not drawn: they need two chains.",
        "one coefficient": "Not shown: there is no pair of coefficients that vary.",
        "stuck": "<td>does not vary</td>",
    }
    assert said[case] in page
    assert ("(a convergence diagnostic fails)" in page) == (case != "one coefficient")


# several methods


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """Page of three methods, one of which is wrong."""
    trees = three_ways()
    page = ps.diagnostic_report(trees | {"b": shifted(trees["b"])}, tmp_path_factory.mktemp("shared"))
    return page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_section_of_several_methods_has_their_convergence_agreement_and_the_chains_of_nuts(shared):
    assert re.findall(r"<h3[^>]*>(.*)</h3>", shared) == TITLES
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>.*?</tr>", shared)]
    convergence_diagnostics = [row[:2] for row in cells if len(row) == 6 and row[0] in ("exact", "gibbs", "nuts")]
    assert [method for method, name in convergence_diagnostics if name == "largest R-hat"] == ["exact", "gibbs", "nuts"]
    assert [method for method, name in convergence_diagnostics if name == "divergences"] == ["nuts"]
    verdicts = {row[0]: (row[2], row[-1]) for row in cells if len(row) == 8 and row[-1] in ("yes", "no")}
    assert verdicts == {"gibbs": ("4.15", "no"), "nuts": ("4.15", "yes")}
    assert "The chains are those of nuts." in shared
    assert "Divergences and E-BFMI of exact and gibbs are not judged" in shared
    assert {f"posterior-1-{kind}" for kind in ("trace", "energy", "pit")} <= set(Tags(shared).ids)
    assert "exact, 4 chains of 1000 draws; gibbs, 4 chains of 1000 draws; nuts, 4 chains" in shared


@pytest.mark.slow
def test_a_disagreement_heads_the_section_and_the_contents(shared):
    assert "<li>All convergence diagnostics pass.</li>" in shared
    assert re.search(r"<li>Against the exact posterior: gibbs DISAGREES \(largest \|z\| .*; nuts agrees", shared)
    assert "a, b, c</a> (methods disagree)</li>" in shared


# what cannot be reported


@pytest.mark.parametrize("vessel", [None, "container"])
def test_no_tree_and_no_posterior_are_refused(tmp_path, vessel):
    with refused(ValueError, "posterior", "none"):
        ps.diagnostic_report({}, tmp_path / "out", vessel)
    with refused(ValueError, "junk"):
        ps.diagnostic_report({"junk": xr.DataTree()}, tmp_path / "out", vessel)
    assert list(tmp_path.iterdir()) == []
