import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.stats import invgamma

import pymc_ship as ps
from pymc_ship.inference.regression.cross_validation import cross_validation
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.replication.measurements import (
    PUBLISHED_PRIORS,
    differencing_rows,
    discretisation_rows,
    full_conditional_rows,
    level_of_error,
    level_rows,
    printed_error_rows,
    prior_rows,
)
from tests.replication.cases import DOFS

CONTAINER = Path(__file__).parents[2] / "models" / "container.toml"


@pytest.fixture(scope="module")
def costs(zigzag_trial, container):
    """Rows by the first word of their name: Euler, forward, central."""
    return {row["differences"].split()[0]: row for row in discretisation_rows(zigzag_trial, container)}


def test_euler_differences_at_the_step_return_every_coefficient(costs):
    """The record is an Euler run, so nothing but rounding is left."""
    assert costs["Euler"]["differences"] == "Euler difference at 0.02 s"
    assert costs["Euler"]["worst"] < 1e-6
    assert max(costs["Euler"][dof] for dof in DOFS) <= costs["Euler"]["worst"]


@pytest.mark.parametrize(
    ("differences", "dof", "percent", "rounding"),
    [
        ("forward", "surge", 38, 0.5),
        ("forward", "sway", 197, 0.5),
        ("forward", "yaw", 130, 0.5),
        ("forward", "roll", 34, 0.5),
        ("central", "surge", 10, 0.5),
        ("central", "sway", 13, 0.5),
        ("central", "yaw", 7.5, 0.05),
        ("central", "roll", 8, 0.5),
    ],
)
def test_differences_each_second_cost_what_was_measured(costs, differences, dof, percent, rounding):
    assert costs[differences][dof] == pytest.approx(percent, abs=rounding)
    assert costs[differences]["differences"] == f"{differences} difference at 1 s"


def test_the_worst_coefficient_is_no_better_than_a_median(costs):
    for row in costs.values():
        assert row["worst"] >= max(row[dof] for dof in DOFS)


def test_a_shorter_interval_costs_less(zigzag_trial, container, costs):
    """Forward differences are of first order: a fifth of the interval, about a fifth of the error."""
    forward = discretisation_rows(zigzag_trial, container, interval=0.2)[1]
    assert forward["differences"] == "forward difference at 0.2 s"
    for dof in DOFS:
        assert 0.1 < forward[dof] / costs["forward"][dof] < 0.4


@pytest.mark.slow
def test_differencing_of_a_clean_euler_run_is_exact_for_euler_only(zigzag_trial, container):
    rows = differencing_rows(zigzag_trial, container, ("euler", "central"), (1.0, 2.0))
    assert [(row["derivative"], row["interval"]) for row in rows] == [
        ("euler", "1 s"),
        ("euler", "2 s"),
        ("central", "1 s"),
        ("central", "2 s"),
    ]
    assert {row["dof"] for row in rows} == {"all"}
    assert {row["family"] for row in rows} == {"conjugate"}
    euler, central = rows[0]["median"], rows[2]["median"]
    assert euler < 0.01 < central


@pytest.mark.slow
def test_level_rows_hold_every_dof_at_every_level_and_errors_grow_with_noise(zigzag_trial, container):
    said = []
    levels = (1e-5, 1e-2)
    rng = np.random.default_rng(5)
    rows = level_rows(zigzag_trial, container, levels, rng=rng, progress=said.append)
    assert [(row["level"], row["dof"]) for row in rows] == [(level, dof) for level in levels for dof in (*DOFS, "all")]
    assert len(said) == 2
    median = {(row["level"], row["dof"]): row["median"] for row in rows}
    for dof in (*DOFS, "all"):
        assert median[1e-2, dof] > 3.0 * median[1e-5, dof]


LEVELS = 10.0 ** np.arange(-6.0, 0.0)


def power_law(factor=300.0, exponent=0.7):
    """Sweep whose median error over all DOFs is a power of the level; single DOFs lie elsewhere."""
    overall = [{"level": level, "dof": "all", "median": factor * level**exponent} for level in LEVELS]
    return [{**row, "dof": "surge", "median": 1e3} for row in overall] + overall


@pytest.mark.parametrize("level", [1.1e-6, 3e-5, 1e-4, 4.5e-3, 0.099])
def test_level_of_error_inverts_a_power_law(level):
    assert level_of_error(power_law(), 300.0 * level**0.7) == pytest.approx(level, rel=1e-12)


def test_level_of_error_depends_on_the_law():
    assert level_of_error(power_law(factor=330.0), 300.0 * 1e-4**0.7) != pytest.approx(1e-4, rel=0.05)


@pytest.mark.parametrize("level", [1e-7, 0.2, 10.0])
def test_level_of_error_is_unknown_beyond_the_sweep(level):
    assert np.isnan(level_of_error(power_law(), 300.0 * level**0.7))


def test_level_of_an_unknown_error_is_unknown():
    assert np.isnan(level_of_error(power_law(), float("nan")))


def test_level_of_error_is_the_first_crossing():
    medians = [1.0, 4.0, 1.0, 4.0]
    rows = [{"level": 10.0**k, "dof": "all", "median": m} for k, m in zip(range(-4, 0), medians, strict=True)]
    assert level_of_error(rows, 2.0) == pytest.approx(10.0**-3.5)


def printed_in_the_file():
    """Number of printed errors of each DOF beside coefficients that are not zero, read from the file itself."""
    coefficients = tomllib.loads(CONTAINER.read_text(encoding="utf-8"))["coefficients"]
    return {
        dof: sum(len(c.get("published_error", {})) for c in table.values() if isinstance(c, dict) and c["value"] != 0.0)
        for dof, table in coefficients.items()
    }


def test_in_surge_more_printed_errors_fit_the_other_family_elsewhere_their_own(container):
    rows = {row["dof"]: row for row in printed_error_rows(container, tuple(FAMILIES))}
    assert tuple(rows) == DOFS
    assert {dof: row["printed"] for dof, row in rows.items()} == printed_in_the_file()
    assert (rows["surge"]["fit_own"], rows["surge"]["fit_other"], rows["surge"]["printed"]) == (18, 32, 35)
    for dof in ("sway", "yaw", "roll"):
        assert rows[dof]["fit_own"] > 3 * rows[dof]["fit_other"]
        assert rows[dof]["fit_own"] >= 0.8 * rows[dof]["printed"]


def exchanged(vessel, dof):
    """Vessel whose two columns of printed errors of a DOF are exchanged."""
    other = dict(zip(FAMILIES, reversed(FAMILIES), strict=True))
    force = tuple(
        replace(c, published_error={other[family]: value for family, value in c.published_error.items()})
        for c in vessel.forces[dof]
    )
    return replace(vessel, forces=vessel.forces | {dof: force})


@pytest.mark.parametrize("dof", DOFS)
def test_exchanging_the_columns_exchanges_the_counts(container, dof):
    before, after = (
        {row["dof"]: row for row in printed_error_rows(vessel, tuple(FAMILIES))}
        for vessel in (container, exchanged(container, dof))
    )
    assert after[dof] == before[dof] | {"fit_own": before[dof]["fit_other"], "fit_other": before[dof]["fit_own"]}
    assert {k: row for k, row in after.items() if k != dof} == {k: row for k, row in before.items() if k != dof}


N_ROWS, N_TERMS = 60, 8


@pytest.fixture(scope="module")
def plain():
    """Conjugate posterior of a plain regression as an identification with one DOF."""
    rng = np.random.default_rng(8)
    X = rng.normal(size=(N_ROWS, N_TERMS))
    data = ps.RegressionData.from_arrays(X, X.sum(axis=1) + rng.normal(size=N_ROWS), scaling="none")
    exact = ps.ConjugatePrior(kappa=10.0, shape=3.0, scale=2.0).exact(data)
    return SimpleNamespace(exact={"conjugate": {"plain": exact}})


def row_of(plain, shape, seed=1):
    """The row for independent draws of sigma2 from an inverse gamma of some shape and the posterior's scale."""
    exact = plain.exact["conjugate"]["plain"]
    draws = invgamma(shape, scale=exact.scale).rvs((4, 5000), random_state=np.random.default_rng(seed))
    tree = xr.DataTree.from_dict({"posterior": xr.Dataset({"noise_variance": (("chain", "draw"), draws)})})
    (row,) = full_conditional_rows(plain, {"plain": tree})
    return row, draws


def test_draws_of_the_marginal_fit_it_and_not_the_full_conditional(plain):
    exact = plain.exact["conjugate"]["plain"]
    assert exact.shape == 3.0 + 0.5 * N_ROWS
    row, draws = row_of(plain, exact.shape)
    assert row["dof"] == "plain"
    assert row["mcmc"] == pytest.approx(draws.mean())
    assert row["mcse"] == pytest.approx(draws.std() / np.sqrt(draws.size), rel=0.1)
    assert abs(row["z_marginal"]) < 4.0
    assert row["z_full_conditional"] > 50.0


def test_draws_of_the_full_conditional_are_told_apart(plain):
    """The broken twin: the same scale, c/2 more shape."""
    row, _ = row_of(plain, plain.exact["conjugate"]["plain"].shape + 0.5 * N_TERMS)
    assert abs(row["z_full_conditional"]) < 4.0
    assert row["z_marginal"] < -50.0


def test_the_two_z_scores_differ_by_the_two_means(plain):
    exact = plain.exact["conjugate"]["plain"]
    row, _ = row_of(plain, exact.shape, seed=2)
    between = (
        invgamma(exact.shape, scale=exact.scale).mean() - invgamma(exact.shape + N_TERMS / 2, scale=exact.scale).mean()
    )
    assert row["z_full_conditional"] - row["z_marginal"] == pytest.approx(between / row["mcse"])


@pytest.fixture(scope="module")
def tuned(zigzag_trial, container):
    """A DOF as if tuned: the two points of the search are made up, the evidence maximum is real."""
    noisy = ps.pollute(zigzag_trial, level=0.001, rng=np.random.default_rng(3))
    data = {dof: ps.regression_data(noisy, container, dof, interval=4.0, derivative="savgol") for dof in ("sway",)}
    chosen = {
        family: {
            dof: SimpleNamespace(
                evaluated_prior=prior(kappa=5.0, shape=4.0, scale=0.5),
                surrogate_prior=prior(kappa=50.0, shape=2.0, scale=0.1),
                evidence_prior=ps.maximise_evidence(rows, family)[0],
            )
            for dof, rows in data.items()
        }
        for family, prior in FAMILIES.items()
    }
    return SimpleNamespace(data=data, tuned=chosen)


CHOICES = ["best point evaluated", "optimum of the surrogate", "evidence maximum", "published"]


@pytest.fixture(scope="module")
def priors(container, tuned):
    return prior_rows(container, tuned)


def test_prior_rows_hold_every_choice_of_every_dof_and_family(priors):
    found = [(row["family"], row["dof"], row["choice"]) for row in priors]
    assert found == [(family, "sway", choice) for family in FAMILIES for choice in CHOICES]
    numbers = [[row[key] for key in ("shape", "scale", "kappa", "score", "score_se", "log_evidence")] for row in priors]
    assert np.isfinite(numbers).all()
    assert (np.array(numbers)[:, [0, 1, 2, 4]] > 0.0).all()


def test_prior_rows_score_and_weigh_the_prior_they_show(priors, tuned):
    for row in priors:
        data = tuned.data[row["dof"]]
        prior = FAMILIES[row["family"]](**{name: row[name] for name in ("shape", "scale", "kappa")})
        score = cross_validation(data).score(prior)
        assert (row["score"], row["score_se"]) == pytest.approx((score.mean, score.se))
        assert row["log_evidence"] == pytest.approx(prior.exact(data).log_evidence)


def test_no_choice_has_more_evidence_than_the_evidence_maximum(priors):
    for k in range(0, len(priors), len(CHOICES)):
        block = {row["choice"]: row["log_evidence"] for row in priors[k : k + len(CHOICES)]}
        assert block["evidence maximum"] == max(block.values())


def test_the_published_scale_is_the_reciprocal_of_the_printed_one(priors):
    published = {(row["family"], row["dof"]): row for row in priors if row["choice"] == "published"}
    for family, dof in published:
        shape, printed, kappa = PUBLISHED_PRIORS[family][dof]
        row = published[family, dof]
        assert (row["shape"], row["kappa"]) == (shape, kappa)
        assert row["scale"] * printed == pytest.approx(1.0)
    sway = published["conjugate", "sway"]
    assert (sway["shape"], sway["scale"], sway["kappa"]) == pytest.approx((3192.0, 1.87970e-6, 13.4e12), rel=1e-5)


def test_a_vessel_without_published_estimates_shows_no_published_prior(container, tuned):
    forces = {dof: tuple(replace(c, published={}) for c in force) for dof, force in container.forces.items()}
    one_family = SimpleNamespace(data=tuned.data, tuned={"conjugate": tuned.tuned["conjugate"]})
    rows = prior_rows(replace(container, forces=forces), one_family)
    assert [row["choice"] for row in rows] == CHOICES[:3]
