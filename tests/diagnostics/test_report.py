"""The command that writes the diagnostic page, and how it ends."""

import re
from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.diagnostics import figures
from pymc_ship.diagnostics import page as page_module
from pymc_ship.diagnostics.agreement import comparisons
from pymc_ship.diagnostics.regression_subsections import REGRESSION
from pymc_ship.inference.regression.tree import write_posterior
from pymc_ship.pages import drawing
from tests.diagnostics.cases import without
from tests.diagnostics.regressions import shifted, three_ways, torn, verdict_on

pytestmark = pytest.mark.filterwarnings("error")


@pytest.fixture
def quick(monkeypatch):
    """Leave the figures out, which have their own tests above."""
    bare = replace(REGRESSION, subsections=lambda *args: [])
    monkeypatch.setattr(page_module, "posterior_kind", lambda tree: bare)


@pytest.mark.usefixtures("quick")
def test_the_command_writes_the_page_and_prints_the_verdict(good, tmp_path, capsys):
    write_posterior(good, tmp_path / "sway.nc")
    words = ["report", str(tmp_path / "sway.nc"), "--vessel", "container", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    printed = capsys.readouterr()
    assert printed.out.splitlines() == ["sway", *verdict_on(good)]
    assert printed.err == f"diagnosing sway\nWritten to {tmp_path}/out/diagnostics.html.\n"


@pytest.mark.usefixtures("quick")
def test_a_failing_diagnostic_is_status_3_and_the_page_is_written(good, tmp_path, capsys):
    (tmp_path / "a").mkdir()
    for path, tree in (("x.nc", good), ("a/x.nc", torn(good))):
        write_posterior(tree, tmp_path / path)
    words = ["report", str(tmp_path / "x.nc"), str(tmp_path / "a" / "x.nc"), "--quiet", "--out", str(tmp_path / "out")]
    assert main(words) == 3
    printed = capsys.readouterr()
    assert re.fullmatch(
        r"pymc-ship: A convergence diagnostic or the agreement with the exact posterior fails in 1 of 2 posteriors, "
        r"first in \S+/a/x\.nc: largest R-hat [1-9.e+]+ \(Yv\), to be < 1\.01; .*; the page is written and names them "
        r"all\.\n",
        printed.err,
    )
    assert printed.out.count("A convergence diagnostic fails: largest R-hat") == 1
    page = (tmp_path / "out" / "diagnostics.html").read_text(encoding="utf-8")
    assert page.count('<section id="posterior-') == 2
    assert page.count("(a convergence diagnostic fails)") == 1


@pytest.mark.usefixtures("quick")
@pytest.mark.parametrize("wrong", [False, True])
def test_a_disagreement_is_status_3_and_the_page_is_written(tmp_path, capsys, wrong):
    trees = three_ways()
    if wrong:
        trees["b"] = shifted(trees["b"])
    paths = [str(write_posterior(tree, tmp_path / f"{name}.nc")) for name, tree in trees.items()]
    assert main(["report", *paths, "--quiet", "--out", str(tmp_path / "out")]) == (3 if wrong else 0)
    printed = capsys.readouterr()
    assert printed.out.startswith("a, b, c\nAll convergence diagnostics pass.\nAgainst the exact posterior: gibbs ")
    said = re.fullmatch(
        r"pymc-ship: A convergence diagnostic or the agreement with the exact posterior fails in 1 of 1 posteriors, "
        r"first in a, b, c: gibbs DISAGREES \(largest \|z\| [\d.]+, largest R-hat [\d.]+\); the page is written .* "
        r"all\.\n",
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
        ("{tmp}/x.nc --out {tmp}/junk.nc/below", "cannot be written: Not a directory; choose another path."),
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


def test_a_report_is_of_the_coefficients_that_were_not_fixed(container, tmp_path, monkeypatch):
    """Also after predictive checks, whose response has the part of the fixed ones; without the images, to save time."""
    monkeypatch.setattr(drawing, "html_image", lambda *_: "")
    for name in ("forest", "trace", "rank", "effective_sample_size", "noise_variance", "predictive", "pair", "loo_pit"):
        monkeypatch.setattr(figures, name, lambda *_: None)
    names = [str(name) for name in container.coefficients("sway")["coefficient"].values]
    rng, value = np.random.default_rng(1), float(container.coefficients("sway")[1])
    X = rng.standard_normal((60, len(names)))
    response = X @ container.coefficients("sway").values + 1e-4 * rng.standard_normal(60)
    data = ps.RegressionData.from_arrays(X, response, names, dof="sway", vessel="container")
    free, prior = ps.hold_fixed(data, {names[1]: value}), ps.ConjugatePrior()
    tree = ps.exact_posterior(free, prior, draws=400, rng=1)
    whole = ps.restore_fixed(tree, {names[1]: value}, names)
    checked = ps.with_predictive(whole, data, prior, rng=1)
    given = {"whole": (whole, None), "checked": (checked, None), "checked ship": (checked, container)}
    given |= {"ship": (whole, container), "free": (tree, None)}
    pages = {}
    for name, (posterior, vessel) in given.items():
        page = ps.diagnostic_report({"one": posterior}, tmp_path / name, vessel)
        pages[name] = page.read_text(encoding="utf-8")
    fixed = f"; {names[1]} fixed at {value:.3g}"
    for name in ("whole", "checked"):
        assert pages[name].count(fixed) == 1
        assert pages[name].replace(fixed, "").split("<figure")[0] == pages["free"].split("<figure")[0]
    for name in ("ship", "checked ship"):
        assert pages[name].count(fixed) == 1
        assert "the prior is of the free coefficients alone" in pages[name]
        assert f"of {len(names)} coefficients are determined" not in pages[name]
    compared = comparisons({"exact": tree, "gibbs": ps.restore_fixed(gibbs(free, prior), {names[1]: value}, names)})
    assert [len(one.trees) for one in compared] == [2]


def gibbs(data, prior):
    return ps.gibbs_posterior(data, prior, draws=400, rng=2)
