"""The page of posteriors of whole trajectories: right, wrong or incomplete, alone or beside those of regressions."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.diagnostics import page as page_module
from pymc_ship.diagnostics import trajectory_subsections
from pymc_ship.diagnostics.agreement import Comparison, comparisons, failure_sentence
from pymc_ship.diagnostics.trajectory_subsections import TRAJECTORIES
from pymc_ship.inference.regression.tree import write_posterior
from tests.diagnostics.cases import changed, hull, sampled, short_posterior, with_attrs, without

pytestmark = pytest.mark.filterwarnings("error")

TITLES = [
    "Convergence diagnostics",
    "Measured and fitted motion",
    "Residuals",
    "Coefficients",
    "Contraction",
    "Directions that stay unknown",
    "Correlation of the coefficients",
    "Leave-one-out by block",
    "Sensitivity to prior and likelihood",
    "Ships of the prior and of the posterior",
]


def section(tree):
    return Comparison("x", {"x": tree})


def parts_of(tree):
    return {part.title: part for part in TRAJECTORIES.subsections(section(tree), None, np.random.default_rng(0))}


def part(name, tree, *ship):
    return getattr(trajectory_subsections, name)(tree, *ship)


def regression():
    """Posterior of a raft with two coefficients."""
    X = np.random.default_rng(1).standard_normal((60, 2))
    response = X.sum(axis=1) + 0.1 * np.random.default_rng(2).standard_normal(60)
    data = ps.RegressionData.from_arrays(X, response, ("Yv", "Yr"), dof="sway", vessel="raft", scaling="none")
    return ps.exact_posterior(data, ps.ConjugatePrior(), draws=2400, chains=4, rng=np.random.default_rng(3))


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = ps.diagnostic_report({"trials": short_posterior()}, tmp_path_factory.mktemp("page"), hull())
    return path.read_text(encoding="utf-8")


# the verdict


def test_the_verdict_says_what_is_known_how_noise_was_treated_and_how_far_to_trust_it():
    convergence_diagnostics, khat, determined, along, noise, white, starts = TRAJECTORIES.verdict(
        section(short_posterior())
    )
    assert convergence_diagnostics == "All convergence diagnostics pass."
    assert khat == "Pareto k-hat 0.30 (limit 0.7): the normal approximation can be trusted."
    determined, *rest = map(int, re.findall(r"(\d+) (?:of 53|follow|ha)", determined))
    assert determined + sum(rest) == 53
    assert re.fullmatch(
        r"Of 53 directions of the coefficients \d+ follow the prior \(more than 0\.5 of its variance is left\); the "
        r"data determine \d+\.\d effectively\.",
        along,
    )
    assert noise == short_posterior().attrs["noise_sentence"]
    assert re.match(r"Under this noise the residuals pass for white \(least Ljung-Box p = 0\.\d+ of 6, r1 = ", white)
    assert (
        starts == "2 of 2 starts of the fit ended at this mode; with 0 % of the draws the ship diverged on the records."
    )


def test_the_verdict_on_a_normal_approximation_that_fails():
    failing = with_attrs(short_posterior(), pareto_khat=0.85, diverged_fraction=0.125)
    convergence_diagnostics, khat, *_, starts = TRAJECTORIES.verdict(section(failing))
    assert convergence_diagnostics == (
        "A convergence diagnostic fails: Pareto k-hat 0.85 (importance weights of the draws), to be ≤ 0.7. Do not rely "
        "on the numbers below."
    )
    assert khat.startswith("Pareto k-hat 0.85 (limit 0.7): the normal approximation is not to be trusted")
    assert "with 12.5 % of the draws the ship diverged" in starts


def test_the_verdict_on_residuals_that_are_not_white():
    def wave(response):
        response[:, 0] += 0.05 * np.sin(np.arange(len(response)) / 8.0)

    white = TRAJECTORIES.verdict(section(changed(short_posterior(), "observed_data/response", wave)))[5]
    assert re.match(
        r"Under this noise the residuals are still autocorrelated \(least .*channel u of run 1\): int", white
    )
    assert white.endswith("intervals are too narrow.")


def test_the_verdict_on_flat_priors():
    lines = TRAJECTORIES.verdict(section(short_posterior("flat")))
    assert "follow" not in lines[2].split(". ")[0]
    assert lines[2].endswith("Every coefficient has a flat prior, which nothing can follow.")
    one = changed(short_posterior(), "constant_data/prior_sd", lambda v: v.__setitem__(0, np.inf))
    assert TRAJECTORIES.verdict(section(one))[3].startswith("Of 52 directions of the coefficients ")
    assert TRAJECTORIES.verdict(section(one))[3].endswith(" 1 coefficient with a flat prior is left out.")


def test_the_verdict_without_records_and_prior_says_so():
    lines = TRAJECTORIES.verdict(section(without(short_posterior(), "observed_data", "constant_data/prior_sd")))
    assert lines[2] == "What the records determine is not known: the tree has no constant_data/prior_sd."
    assert lines[4] == "The residuals are not known: the tree has no observed_data/response."


def test_the_verdict_on_a_sampler_names_its_diagnostics_and_no_khat():
    lines = TRAJECTORIES.verdict(section(sampled()))
    assert (lines[0], len(lines)) == ("All convergence diagnostics pass.", 6)
    assert "k-hat" not in " ".join(lines)
    assert lines[-1].endswith("0 transitions of the sampler diverged.")
    torn = changed(sampled(), "posterior/coefficients", lambda v: v[3, :, 0].__iadd__(1.0))
    said = TRAJECTORIES.verdict(section(torn))[0]
    assert re.match(
        r"A convergence diagnostic fails: largest R-hat [\d.e+]+ \(Xu\), to be < 1\.01; least bulk ESS", said
    )


# the page


@pytest.mark.slow
def test_the_page_has_every_part_and_figure_and_states_its_defaults(page):
    assert re.findall(r"<h3[^>]*>(.*)</h3>", page) == TITLES
    figures = re.findall(r'<figure id="posterior-1-(.*?)">', page)
    forests = ["forest-surge", "forest-sway", "forest-yaw"]
    rest = ["contraction", "directions", "pair", "correlation", "pareto", "ships"]
    assert figures == ["motion-1", "motion-2", "autocorrelation", "quantiles", *forests, *rest]
    for text in (
        "ci_prob 0.95",
        "ci_kind eti",
        "Pareto k-hat ≤ 0.7",
        "more than 0.5 of its prior variance",
        "NASA RP-1168",
    ):
        assert text in page
    assert "method trajectory: 4 chains of 100 draws of the approximation at the mode; 53 coeff" in page
    assert re.search(
        r"order_damped prior with median factors tau surge hull [\d.]+, tau surge [\d.]+, .*; noise model white", page
    )
    assert "Not shown" not in page
    assert "https://" not in page


def test_the_coefficients_stand_beside_reference_and_published_values():
    tree = short_posterior()
    found = part("_coefficients", tree, hull())
    surge, caption = found.tables[0]
    of_vessel, of_prior = ["reference", "publ. conj.", "publ. semiconj."], ["contraction", "evidence"]
    of_posterior = ["prior mean", "prior sd", "mean", "sd", "2.5 %", "97.5 %"]
    assert surge.heads == ["coefficient", *of_vessel, *of_posterior, *of_prior]
    assert surge.cells[0][:2] == ["Xu", "−226.2"]
    assert caption == "Surge, prime values times 1e5; equal-tailed (eti) intervals of 95 %."
    held = int(re.search(r"The 95 % intervals cover (\d+) of 53 reference values\.", found.text)[1])
    tails = tree["posterior"]["coefficients"].quantile([0.025, 0.975], ("chain", "draw")).values
    reference = np.concatenate([hull().coefficients(dof).values for dof in hull().dofs])
    assert held == np.sum((tails[0] <= reference) & (reference <= tails[1])) > 40
    bare = part("_coefficients", tree, None)
    assert "reference" not in bare.text + " ".join(bare.tables[0][0].heads)


def test_prior_means_that_are_not_zero_are_tabulated():
    prior = json.loads(short_posterior().attrs["prior"])
    tables = []
    for mean in ([1e-5] + 52 * [0.0], 53 * [0.0]):
        tree = with_attrs(short_posterior(), prior=json.dumps(prior | {"mean": mean}))
        tables.append(part("_coefficients", tree, None).tables[0][0])
    assert (tables[0].heads[1], tables[0].cells[0][1], tables[0].cells[1][1]) == ("prior mean", "1", "0")
    assert "prior mean" not in tables[1].heads


def test_leave_one_out_warns_that_neighbours_are_not_exchangeable():
    text = part("_leave_one_out", short_posterior()).text
    assert re.match(r"elpd [−\d.]+ ± [\d.]+, p_loo [\d.]+\. \d+ of 360 blocks have a Pareto k above", text)
    assert "Neighbouring blocks of a trajectory are not exchangeable" in text


def test_the_sensitivity_lists_what_moves_most_with_the_prior():
    found = part("_sensitivity", short_posterior())
    assert re.match(r"\d+ of 53 coefficients move with the prior at the median factors of its scales\.", found.text)
    moved = [float(row[1]) for row in found.tables[0][0].cells]
    assert len(moved) == 12
    assert moved == sorted(moved, reverse=True)


def test_directions_show_all_that_stay_unknown():
    rows = part("_directions", short_posterior()).tables[0][0].cells
    unknown = int(re.search(r"coefficients (\d+) follow", TRAJECTORIES.verdict(section(short_posterior()))[3])[1])
    assert len(rows) == max(8, unknown)
    assert part("_directions", short_posterior("flat")).text.startswith("Not shown: every coefficient has a flat prior")


def test_students_t_is_said_to_scatter_more():
    student = with_attrs(short_posterior(), noise_model="student_t + offsets")
    assert "Under Student's t" in part("_residuals", student).text
    assert "Student" not in part("_residuals", short_posterior()).text


def test_draws_that_diverged_do_not_spoil_the_page():
    tree = changed(short_posterior(), "log_likelihood/response", lambda v: v[0, :7].fill(np.nan))
    assert "–" not in part("_leave_one_out", tree).text
    assert "does not vary" not in str(part("_sensitivity", tree).tables)


def test_a_part_whose_variables_are_missing_says_so_in_one_sentence():
    groups = ("log_likelihood", "log_prior", "observed_data", "constant_data")
    found = parts_of(without(short_posterior(), *groups))
    assert list(found) == TITLES
    said = [
        found[title].text
        for title in TITLES
        if title not in ("Convergence diagnostics", "Correlation of the coefficients")
    ]
    assert len(said) == 8
    assert all(re.fullmatch(r"Not shown: the tree has no [\w/]+( and no [\w/]+)*\.", text) for text in said)
    assert said[-2] == "Not shown: the tree has no log_prior/coefficients and no log_likelihood/response."


def test_a_sampler_shows_chains_and_energy():
    tree = without(sampled(), "log_likelihood", "constant_data")
    found = parts_of(tree)
    assert list(found) == [TITLES[0], "Chains", "Energy", *TITLES[1:]]
    assert [image[0] for image in found["Chains"].images] == ["trace", "rank", "ess"]
    assert found["Chains"].tables[0][0].heads == ["quantity", "R-hat", "bulk ESS", "tail ESS"]
    assert len(found["Chains"].tables[0][0].cells) == 12
    assert [image[0] for image in found["Energy"].images] == ["energy"]


# several posteriors, and those of another vessel


@pytest.mark.usefixtures("undrawn")
@pytest.mark.slow
def test_regressions_and_trajectories_share_a_page(tmp_path):
    bare = without(short_posterior(), "log_likelihood", "log_prior", "observed_data", "constant_data")
    trees = {"raft": without(regression(), "log_likelihood", "log_prior"), "trials": bare}
    text = ps.diagnostic_report(trees, tmp_path).read_text(encoding="utf-8")
    assert re.findall(r"<h2>(.*)</h2>", text) == ["1 raft", "2 trials", "Versions and sources"]
    assert [one.name for one in comparisons(trees)] == ["raft", "trials"]
    assert "Singular directions of the design</h3>" in text
    assert "Directions that stay unknown</h3>" in text


# the command


@pytest.mark.parametrize("khat", [0.3, 0.85])
def test_a_failing_diagnostic_is_status_3_and_the_page_is_written(monkeypatch, tmp_path, capsys, khat):
    bare = replace(TRAJECTORIES, subsections=lambda *args: [])
    monkeypatch.setattr(page_module, "posterior_kind", lambda tree: bare)
    tree = with_attrs(short_posterior(), pareto_khat=khat)
    path = write_posterior(tree, tmp_path / "trials.nc")
    assert main(["report", str(path), "--quiet", "--out", str(tmp_path / "out")]) == (0 if khat < 0.7 else 3)
    printed = capsys.readouterr()
    assert printed.out.splitlines() == ["trials", *TRAJECTORIES.verdict(section(tree))]
    sentence = (
        "A convergence diagnostic or the agreement with the exact posterior fails in 1 of 1 posteriors, first in "
        "trials: Pareto k-hat 0.85 (importance weights of the draws), to be ≤ 0.7; the page is written and names "
        "them all."
    )
    assert printed.err == ("" if khat < 0.7 else f"pymc-ship: {sentence}\n")
    assert failure_sentence([Comparison("trials", {"trials": tree})]) == ("" if khat < 0.7 else sentence)
    assert (tmp_path / "out" / "diagnostics.html").exists()


def test_a_file_without_coefficients_is_one_sentence_and_status_2(tmp_path, capsys):
    tree = without(short_posterior(), "posterior/coefficients")
    assert main(["report", str(write_posterior(tree, tmp_path / "x.nc")), "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    assert re.fullmatch(r"pymc-ship: x is no posterior of this package, it lacks coefficients; .*\.\n", printed.err)
    assert not (tmp_path / "out").exists()
