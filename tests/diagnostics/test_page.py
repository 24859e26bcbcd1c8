"""The diagnostic page: what it says of posteriors right, wrong or incomplete, and the command that writes it."""

import re
from html.parser import HTMLParser
from importlib import import_module

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.diagnostics.agreement import Comparison, comparisons
from pymc_ship.diagnostics.parts import parts, verdict
from pymc_ship.regression.tree import read_posterior, write_posterior

pytestmark = pytest.mark.filterwarnings("error")

TITLES = [
    "Convergence gates",
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
]


def posterior(container, wave=0.0, draws=800):
    """Posterior of the container ship's first sway coefficients, as a vessel of that name would have them."""
    rng = np.random.default_rng(7)
    names = [str(name) for name in container.coefficients("sway")["coefficient"].values]
    X = rng.standard_normal((120, len(names)))
    noise = 1e-4 * rng.standard_normal(120)
    for k in range(1, 120):
        noise[k] += wave * noise[k - 1]
    response = X @ container.coefficients("sway").values + noise
    labels = {"dof": "sway", "vessel": "container", "derivative": "euler"}
    data = ps.RegressionData.from_arrays(X, response, names, scaling="zscore", time=np.arange(120.0), **labels)
    return ps.conjugate_posterior(data, ps.ConjugatePrior(kappa=1e4), draws=draws, chains=4, rng=rng)


def without(tree, *groups):
    kept = {name: node.to_dataset() for name, node in tree.children.items() if name not in groups}
    return xr.DataTree.from_dict({"/": tree.to_dataset(), **kept})


def torn(tree):
    """Posterior of which one chain stands elsewhere."""
    draws = tree["posterior"].to_dataset().copy(deep=True)
    draws["coefficients"][3, :, 0] += 1.0
    return xr.DataTree.from_dict({"/": tree.to_dataset(), "posterior": draws})


def verdict_on(tree):
    return verdict(Comparison("x", {"x": tree}))


def regression(seed=11):
    """Data of a raft with two coefficients, and the prior of its posteriors."""
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((60, 2))
    labels = {"dof": "sway", "vessel": "raft"}
    data = ps.RegressionData.from_arrays(X, X.sum(axis=1) + 0.1 * rng.standard_normal(60), ("Yv", "Yr"), **labels)
    return data, ps.ConjugatePrior(kappa=10.0)


def three_ways(**changes):
    """Exact, Gibbs and NUTS draws of one posterior, those of NUTS (independent ones with its groups) last."""
    data, prior = regression()
    exact = ps.conjugate_posterior(data, prior, draws=4000, rng=np.random.default_rng(1))
    gibbs = ps.gibbs_posterior(data, prior, draws=1000, rng=np.random.default_rng(2))
    nuts = ps.conjugate_posterior(data, prior, draws=4000, rng=np.random.default_rng(3))
    energy = np.random.default_rng(4).standard_normal((4, 1000))
    stats = {"diverging": np.zeros((4, 1000), dtype=bool), "energy": energy}
    stats = xr.Dataset({name: (("chain", "draw"), value) for name, value in stats.items()})
    nuts = nuts.assign({"sample_stats": xr.DataTree(stats)})
    nuts.attrs |= {"method": "nuts"} | changes
    return {"a": exact, "b": gibbs, "c": nuts}


def shifted(tree, by=0.1):
    """Draws whose first coefficient sits so many standard deviations from where it belongs."""
    draws = tree["posterior"].to_dataset().copy(deep=True)
    draws["coefficients"][..., 0] += by * draws["coefficients"][..., 0].std()
    return tree.assign({"posterior": xr.DataTree(draws)})


@pytest.fixture(scope="module")
def good(container):
    return posterior(container)


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
        assert re.findall(r"<h3>(.*)</h3>", text) == TITLES
        assert "https://" not in text


@pytest.mark.slow
def test_the_page_states_its_defaults_and_shows_every_figure(page):
    whole, _, _ = page
    figures = set(Tags(whole).ids) - {"posterior-1", "repeat"}
    kinds = "forest trace rank ess noise predictive pair correlation residuals pareto pit"
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
def test_a_torn_posterior_heads_its_page_with_the_failing_gate_and_says_what_is_missing(page):
    _, bare, _ = page
    assert "1 a &lt; b</h2>" in bare
    assert "(a gate fails)" in bare
    assert re.search(r"<li>A convergence gate fails: largest R-hat [1-9.e]+.* \(Yv\), to be &lt; 1.01", bare)
    assert bare.count("Not shown: the tree has no") == 6
    assert "Not shown: no draws of the same data and prior by another method are given." in bare
    assert "the tree has no constant_data/design_matrix and no observed_data/response." in bare
    assert "the tree has no log_prior/coefficients and no log_likelihood/response." in bare


@pytest.mark.slow
def test_the_same_seed_gives_the_same_page(good, tmp_path):
    tree = without(good, "log_likelihood", "log_prior")
    first, second = (ps.diagnostic_report({"x": tree}, tmp_path / name, seed=3).read_bytes() for name in "ab")
    assert first == second


def test_the_verdict_counts_what_the_data_determine(good):
    gates, determined, white = verdict_on(good)
    assert gates == "All convergence gates hold."
    count, total = map(int, re.match(r"(\d+) of (\d+) coefficients are determined by the data", determined).groups())
    assert 10 <= count < total == 28
    assert white.startswith("Residuals pass for white noise (r1 = ")


def test_the_verdict_on_correlated_residuals(container):
    white = verdict_on(posterior(container, wave=0.97))[2]
    assert re.match(
        r"Residuals are autocorrelated \(r1 = 0\.[4-9]\d*, Ljung-Box p = .*\): intervals are too narrow", white
    )
    assert white.endswith("leave-future-out or block folds are the right tool for serially correlated rows.")


def test_the_verdict_without_a_design_says_so(good):
    lines = verdict_on(without(good, "observed_data"))
    assert lines[1:] == [
        "What the data determine and the residuals are not known: the tree has no observed_data/response."
    ]


@pytest.mark.slow
def test_a_part_for_every_group_of_nuts(good):
    """sample_stats bring the energy; posterior_predictive is shown as the tree holds it."""
    rng = np.random.default_rng(0)
    shape = (4, 200)
    names = {"diverging": np.zeros(shape, dtype=bool), "energy": rng.standard_normal(shape)}
    stats = xr.Dataset({name: (("chain", "draw"), value) for name, value in names.items()})
    response = good["observed_data"]["response"].values + 1e-4 * rng.standard_normal((*shape, 120))
    drawn = xr.Dataset({"response": (("chain", "draw", "row"), response)})
    groups = {"sample_stats": xr.DataTree(stats), "posterior_predictive": xr.DataTree(drawn)}
    tree = without(good, "log_likelihood").assign(groups)
    found = {part.title: part for part in parts(Comparison("x", {"x": tree}), None, rng)}
    assert [image[0] for image in found["Energy"].images] == ["energy"]
    assert "as the tree holds them" in found["Prior and posterior predictive check"].text
    assert found["Convergence gates"].text == ""
    assert "no vessel was given" in found["Coefficients"].images[0][2]


@pytest.mark.slow
@pytest.mark.parametrize("case", ["one chain", "one coefficient", "stuck"])
def test_a_poor_posterior_is_still_reported(tmp_path, case):
    """What cannot be drawn is said; nothing is warned of, and a posterior that cannot be judged fails its gates."""
    rng = np.random.default_rng(0)
    X = rng.standard_normal((50, 1 if case == "one coefficient" else 2))
    labels = {"coefficients": ("Yv", "Yr")[: X.shape[1]], "dof": "sway", "vessel": "raft"}
    data = ps.RegressionData.from_arrays(X, X.sum(axis=1) + 0.1 * rng.standard_normal(50), **labels)
    chains = 1 if case == "one chain" else 4
    tree = ps.conjugate_posterior(data, ps.ConjugatePrior(), draws=2400, chains=chains, rng=rng)
    if case == "stuck":
        still = tree["posterior"].to_dataset().copy(deep=True)
        still["coefficients"][:] = 1.0
        tree = tree.assign({"posterior": xr.DataTree(still)})
    page = ps.diagnostic_report({"x": tree}, tmp_path).read_text(encoding="utf-8")
    said = {
        "one chain": "Ranks are not drawn: they need two chains.",
        "one coefficient": "Not shown: there is no pair of coefficients that vary.",
        "stuck": "<td>does not vary</td>",
    }
    assert said[case] in page
    assert ("(a gate fails)" in page) == (case != "one coefficient")


# several methods


def test_draws_of_one_posterior_share_a_section_and_others_do_not():
    """Exact draws first, wherever they stand; other data, another prior and other errors stand alone."""
    data, prior = regression()
    trees = three_ways()
    others = {
        "prior": ps.gibbs_posterior(data, ps.ConjugatePrior(kappa=9.0), draws=100, rng=np.random.default_rng(0)),
        "data": ps.gibbs_posterior(regression(12)[0], prior, draws=100, rng=np.random.default_rng(0)),
        "errors": three_ways(errors="student_t")["c"],
        "bare": without(trees["b"], "constant_data"),
        "other exact": three_ways()["a"],
    }
    found = comparisons({"c": trees["c"], **others, "a": trees["a"], "b": trees["b"]})
    assert [one.name for one in found] == ["other exact, c, b", "prior", "data", "errors", "bare", "a"]
    assert [one.agreement is None for one in found] == [False, True, True, True, True, True]
    together = found[0]
    assert list(together.trees) == ["exact", "nuts", "gibbs"]
    assert together.posterior is others["other exact"]
    assert together.sampler == "nuts"


def test_saved_draws_are_compared_with_the_exact_posterior_itself():
    """Data and prior read from the exact draws give the agreement of the posterior they were drawn from."""
    trees, exact = three_ways(), ps.conjugate(*regression())
    (found,) = comparisons(trees)
    xr.testing.assert_allclose(found.agreement, ps.agreement(exact, {"gibbs": trees["b"], "nuts": trees["c"]}))
    assert found.agreement["agrees"].all()
    assert (found.failed_gates, found.disagreements) == ([], [])


def test_draws_of_one_method_twice_are_told_apart_by_their_names():
    trees = three_ways()
    (found,) = comparisons({**trees, "d": trees["b"]})
    assert list(found.trees) == ["a", "b", "c", "d"]
    assert found.agreement["method"].values.tolist() == ["b", "c", "d"]


@pytest.mark.parametrize(
    ("trees", "sentence"),
    [
        (lambda three: {"c": three["c"]}, "no exact posterior of the same data and prior is given"),
        (lambda three: {"a": three["a"]}, "no draws of the same data and prior by another method are given"),
        (lambda three: {"c": three_ways(errors="ar1")["c"]}, "the exact posterior is of normal errors, these are ar1"),
    ],
)
def test_why_there_is_no_agreement_is_said(monkeypatch, trees, sentence):
    (one,) = comparisons(trees(three_ways()))
    part = import_module("pymc_ship.diagnostics.parts")._agreement(one)
    assert (part.text, part.tables) == (f"Not shown: {sentence}.", [])


@pytest.fixture(scope="module")
def shared(tmp_path_factory):
    """Page of three methods, one of which is wrong."""
    trees = three_ways()
    page = ps.diagnostic_report(trees | {"b": shifted(trees["b"])}, tmp_path_factory.mktemp("shared"))
    return page.read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_section_of_several_methods_has_their_gates_agreement_and_the_chains_of_nuts(shared):
    assert re.findall(r"<h3>(.*)</h3>", shared) == TITLES
    cells = [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>.*?</tr>", shared)]
    gates = [row[:2] for row in cells if len(row) == 6 and row[0] in ("exact", "gibbs", "nuts")]
    assert [method for method, gate in gates if gate == "largest R-hat"] == ["exact", "gibbs", "nuts"]
    assert [method for method, gate in gates if gate == "divergences"] == ["nuts"]
    verdicts = {row[0]: (row[2], row[-1]) for row in cells if len(row) == 8 and row[-1] in ("yes", "NO")}
    assert verdicts == {"gibbs": ("4.15", "NO"), "nuts": ("4.15", "yes")}
    assert "The chains are those of nuts." in shared
    assert "Divergences and E-BFMI of exact and gibbs are not judged" in shared
    assert {f"posterior-1-{kind}" for kind in ("trace", "energy", "pit")} <= set(Tags(shared).ids)
    assert "exact, 4 chains of 1000 draws; gibbs, 4 chains of 1000 draws; nuts, 4 chains" in shared


@pytest.mark.slow
def test_a_disagreement_heads_the_section_and_the_contents(shared):
    assert "<li>All convergence gates hold.</li>" in shared
    assert re.search(r"<li>Against the exact posterior: gibbs DISAGREES \(largest \|z\| .*; nuts agrees", shared)
    assert "a, b, c</a> (methods disagree)</li>" in shared


# what cannot be reported


@pytest.mark.parametrize("vessel", [None, "container"])
def test_no_tree_and_no_posterior_are_refused(tmp_path, vessel):
    with pytest.raises(ValueError, match="needs at least one posterior, found none; give trees by name"):
        ps.diagnostic_report({}, tmp_path / "out", vessel)
    with pytest.raises(ValueError, match=r"^junk is no posterior of this package, it lacks coefficients"):
        ps.diagnostic_report({"junk": xr.DataTree()}, tmp_path / "out", vessel)
    assert list(tmp_path.iterdir()) == []


def test_another_vessel_is_refused(good, container, tmp_path):
    other = without(good)
    other.attrs["vessel"] = "ferry"
    with pytest.raises(ps.VesselError, match="is to be of 'container', found 'ferry' in x"):
        ps.diagnostic_report({"x": other}, tmp_path / "out", container)
    fewer = without(good, "log_likelihood", "constant_data")
    fewer = fewer.assign({"posterior": xr.DataTree(fewer["posterior"].to_dataset().isel(coefficient=[1, 0]))})
    with pytest.raises(ps.VesselError, match="coefficients of 'container' in order, found Yvv, Yv in x"):
        ps.diagnostic_report({"x": fewer}, tmp_path / "out", container)


# the command


@pytest.fixture
def quick(monkeypatch):
    """Leave the figures out, which have their own tests above."""
    monkeypatch.setattr(import_module("pymc_ship.diagnostics.page"), "parts", lambda *args: [])


@pytest.mark.usefixtures("quick")
def test_the_command_writes_the_page_and_prints_the_verdict(good, tmp_path, capsys):
    write_posterior(good, tmp_path / "sway.nc")
    words = ["report", str(tmp_path / "sway.nc"), "--vessel", "container", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    printed = capsys.readouterr()
    assert printed.out.splitlines() == ["sway", *verdict_on(good)]
    assert printed.err == f"diagnosing sway\nWritten to {tmp_path}/out/diagnostics.html.\n"


@pytest.mark.usefixtures("quick")
def test_a_failing_gate_is_status_3_and_the_page_is_written(good, tmp_path, capsys):
    (tmp_path / "a").mkdir()
    for path, tree in (("x.nc", good), ("a/x.nc", torn(good))):
        write_posterior(tree, tmp_path / path)
    words = ["report", str(tmp_path / "x.nc"), str(tmp_path / "a" / "x.nc"), "--quiet", "--out", str(tmp_path / "out")]
    assert main(words) == 3
    printed = capsys.readouterr()
    assert re.fullmatch(
        r"pymc-ship: A convergence gate or the agreement with the exact posterior fails in 1 of 2 posteriors, first in "
        r"\S+/a/x\.nc: largest R-hat [1-9.e+]+ \(Yv\), to be < 1\.01; .*; the page is written and names them all\.\n",
        printed.err,
    )
    assert printed.out.count("A convergence gate fails: largest R-hat") == 1
    page = (tmp_path / "out" / "diagnostics.html").read_text(encoding="utf-8")
    assert page.count('<section id="posterior-') == 2
    assert page.count("(a gate fails)") == 1


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("wrong", [False, True])
def test_a_disagreement_is_status_3_and_the_page_is_written(tmp_path, capsys, wrong):
    trees = three_ways()
    if wrong:
        trees["b"] = shifted(trees["b"])
    paths = [str(write_posterior(tree, tmp_path / f"{name}.nc")) for name, tree in trees.items()]
    assert main(["report", *paths, "--quiet", "--out", str(tmp_path / "out")]) == (3 if wrong else 0)
    printed = capsys.readouterr()
    assert printed.out.startswith("a, b, c\nAll convergence gates hold.\nAgainst the exact posterior: gibbs ")
    said = re.fullmatch(
        r"pymc-ship: A convergence gate or the agreement with the exact posterior fails in 1 of 1 posteriors, first in "
        r"a, b, c: gibbs DISAGREES \(largest \|z\| [\d.]+, largest R-hat [\d.]+\); the page is written .* all\.\n",
        printed.err,
    )
    assert bool(said) == wrong
    assert bool(printed.err) == wrong
    assert (tmp_path / "out" / "diagnostics.html").exists()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("{tmp}/none.nc", "found nothing at .*none.nc; check the path."),
        ("{tmp}/junk.nc", "junk.nc is no posterior written by this package"),
        ("{tmp}/x.nc --vessel raft", "A vessel is one of container"),
        ("{tmp}/x.nc --out {tmp}/junk.nc/below", "cannot be written: Not a directory; choose another place."),
        ("", "the following arguments are required: POSTERIOR"),
    ],
)
def test_what_cannot_be_reported_is_one_sentence(good, tmp_path, capsys, words, sentence):
    write_posterior(without(good, "log_likelihood"), tmp_path / "x.nc")
    (tmp_path / "junk.nc").write_text("no NetCDF")
    try:
        status = main(
            ["report", *words.format(tmp=tmp_path).split(), *([] if "--out" in words else ["--out", f"{tmp_path}/out"])]
        )
    except SystemExit as stop:
        status = stop.code
    printed = capsys.readouterr()
    assert (status, printed.out) == (2, "")
    assert printed.err.count("\n") == 1
    assert re.search(sentence, printed.err)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["junk.nc", "x.nc"]


def test_a_zarr_posterior_is_read_as_well(good, tmp_path):
    tree = read_posterior(write_posterior(without(good, "log_likelihood"), tmp_path / "x.zarr"))
    assert verdict_on(tree) == verdict_on(good)
