"""The numbers of a posterior of whole trajectories against its fit, known draws and series whose nature is known."""

import numpy as np
import pytest
import xarray as xr

from pymc_ship.diagnostics import trajectory as d
from pymc_ship.diagnostics.page import posterior_kind
from pymc_ship.diagnostics.posterior_statistics import convergence_diagnostics, cross_validation, quantities
from pymc_ship.diagnostics.regression_subsections import REGRESSION
from pymc_ship.diagnostics.trajectory_subsections import TRAJECTORIES
from pymc_ship.inference.identifiability.information import UNKNOWN
from pymc_ship.inference.regression.tree import read_posterior, write_posterior
from tests.diagnostics.cases import changed, sampled, short_mode, short_posterior, with_attrs
from tests.inference.identifiability.information import fitted_identifiability

pytestmark = pytest.mark.filterwarnings("error")


def scattered(tree, spread, seed=0):
    """Tree whose coefficients scatter independently by a factor of their prior sd, each its own."""
    rng = np.random.default_rng(seed)
    sd = tree["constant_data"]["prior_sd"].values
    return changed(
        tree,
        "posterior/coefficients",
        lambda draws: draws.__setitem__(..., sd * spread * rng.standard_normal(draws.shape)),
    )


# the layout


def test_the_prior_sd_is_laid_out_with_its_factors_and_infinite_where_flat(tmp_path):
    problem = short_mode().choice.fit.problem
    tree = read_posterior(write_posterior(short_posterior(), tmp_path / "x.nc"))
    eta = np.log(tree["posterior"]["scale_factor"].median(("chain", "draw")).values)
    factor = np.sqrt(2.0) * np.exp(problem.prior.law.exponents @ eta)  # the sd of Student's t is sqrt(2) of its scale
    np.testing.assert_allclose(tree["constant_data"]["prior_sd"], problem.prior.scale * factor, rtol=1e-3)
    assert np.ptp(factor) > 0.1
    assert np.isinf(short_posterior("flat")["constant_data"]["prior_sd"]).all()


def test_posteriors_of_trajectories_are_known_by_their_method():
    assert posterior_kind(short_posterior()) is TRAJECTORIES
    assert posterior_kind(sampled()) is TRAJECTORIES
    assert posterior_kind(with_attrs(short_posterior(), method="conjugate")) is REGRESSION
    assert posterior_kind(xr.DataTree()) is REGRESSION


def test_a_sampler_needs_no_pareto_khat():
    d.check_trajectory(sampled())


# convergence diagnostics


@pytest.mark.parametrize(("khat", "holds"), [(0.3, True), (0.7, True), (0.71, False), (np.nan, False)])
def test_the_diagnostic_of_the_normal_approximation_is_pareto_khat(khat, holds):
    (row,) = convergence_diagnostics(with_attrs(short_posterior(), pareto_khat=khat))
    assert (row["diagnostic"], row["limit"], row["passes"]) == ("Pareto k-hat", "≤ 0.7", holds)


def test_the_diagnostics_of_a_sampler_watch_every_unknown():
    diagnostics = {row["diagnostic"]: row for row in convergence_diagnostics(sampled())}
    assert list(diagnostics) == ["largest R-hat", "least bulk ESS", "least tail ESS", "divergences", "least E-BFMI"]
    assert all(row["passes"] for row in diagnostics.values())
    torn = changed(sampled(), "posterior/initial_state", lambda v: v[3, :, 1, 1].__iadd__(1.0))
    failed = [row for row in convergence_diagnostics(torn) if not row["passes"]]
    assert failed[0]["where"] == "initial v, run 2"
    diverged = changed(sampled(), "sample_stats/diverging", lambda v: v[0].__setitem__(slice(2), True))
    assert [(g["diagnostic"], g["value"]) for g in convergence_diagnostics(diverged) if not g["passes"]] == [
        ("divergences", 2.0)
    ]


def test_the_unknowns_are_coefficients_initial_states_and_offsets():
    tree = short_posterior(noise="ar1")
    tree = changed(tree, "posterior/sensor_offset", lambda v: v[:, :, 1, 2].fill(np.nan))
    found = quantities(tree)
    names = found["quantity"].values.tolist()
    assert names[:53] == tree["posterior"]["coefficient"].values.tolist()
    assert names[53:] == [
        *(f"initial {state}, run {run}" for run in (1, 2) for state in ("u", "v", "r", "p", "phi")),
        *(f"offset of {name}" for name in ("u, run 1", "v, run 1", "r, run 1", "u, run 2", "v, run 2")),
    ]
    offset = tree["posterior"]["sensor_offset"].sel(run=1, channel="v")
    np.testing.assert_array_equal(found.sel(quantity="offset of v, run 2"), offset)
    assert quantities(short_posterior()).sizes["quantity"] == 63


# what the records determine


def test_the_contraction_is_that_of_the_fit():
    """Within the Monte Carlo error of a variance from 400 draws: z-scores of all 53."""
    fit, found = short_mode("fixed").choice.fit, d.contraction(short_posterior("fixed"))
    exact = (fit.sd / found["prior_sd"].values) ** 2
    z = ((1.0 - found["contraction"].values) / exact - 1.0) / np.sqrt(2.0 / 400)
    assert np.abs(z).max() < 3.9
    assert found["dof"].values.tolist() == [
        dof for dof in ("surge", "sway", "yaw") for _ in fit.problem.vessel.terms(dof)
    ]
    sizes = np.abs(found["mean"]) / found["sd"]
    assert found["is_contracted"].equals(found["contraction"] > 0.9)
    assert found["determined"].equals(found["is_contracted"] & (sizes > 1.96))
    assert 5 < int(found["determined"].sum()) < 53 - 5


def test_under_a_flat_prior_every_coefficient_is_contracted_and_no_direction_has_a_unit():
    found, along = d.contraction(short_posterior("flat")), d.directions(short_posterior("flat"))
    assert (found["contraction"] == 1.0).all()
    assert not found["determined"].all()
    assert along.sizes["direction"] == 0
    assert along.attrs == {"n_unknown": 0, "n_effective": 0.0, "n_flat": 53}


def test_directions_are_those_of_the_fit():
    along, exact = d.directions(short_posterior("fixed")), fitted_identifiability(short_mode("fixed").choice.fit)
    assert abs(along.attrs["n_unknown"] - exact.sizes["direction"]) <= 2
    assert along.attrs["n_effective"] == pytest.approx(53 - (1.0 - exact["contraction"].values).sum(), abs=1.5)
    assert (np.diff(along["remaining_variance"].values) <= 0.0).all()


def test_draws_of_the_prior_leave_every_direction_unknown():
    """A tenth as many coefficients as draws: sample eigenvalues would spread from 0.4 to 1.9, these do not."""
    tree = scattered(short_posterior(), 1.0)
    share = d.directions(tree)["remaining_variance"].values
    sampling_error = np.sqrt(2.0 / 200)
    assert np.abs(share - 1.0).max() < 4.0 * sampling_error
    scaled = tree["posterior"]["coefficients"].values.reshape(400, -1) / tree["constant_data"]["prior_sd"].values
    plain = np.linalg.eigvalsh(np.cov(scaled.T))
    assert np.abs(plain - 1.0).max() > 5.0 * sampling_error


def test_the_loadings_name_the_one_direction_that_is_left():
    spread = np.full(53, 0.01)
    spread[20] = 0.9
    along = d.directions(scattered(short_posterior(), spread))
    name = short_posterior()["posterior"]["coefficient"].values[20]
    assert along.attrs["n_unknown"] == 1
    assert along["remaining_variance"][0] == pytest.approx(0.81, rel=0.3)
    assert along["remaining_variance"][1] < 1e-3 < UNKNOWN
    assert str(along["text"].values[0]).startswith(f"+1.00 {name} ")


def test_a_flat_coefficient_is_left_out_of_the_directions():
    tree = changed(short_posterior(), "constant_data/prior_sd", lambda v: v.__setitem__(0, np.inf))
    along = d.directions(tree)
    assert (along.sizes["direction"], along.attrs["n_flat"]) == (52, 1)
    assert not any(" Xu " in f" {text} " for text in along["text"].values)


# residuals


def test_residuals_are_those_of_the_fit():
    fit, found = short_mode().choice.fit, d.residuals(short_posterior())
    for run, exact in enumerate(fit.residuals):
        mine = found.isel(row=found["run"].values == run)
        np.testing.assert_allclose(mine["white"].values.T, exact, atol=1e-6)
        np.testing.assert_array_equal(mine["white"], mine["residual"])
        np.testing.assert_allclose(mine["time"], fit.problem.runs[run].time)


def test_offsets_and_correlation_of_the_noise_are_taken_out():
    """Up to the Monte Carlo error of a mean offset, the whitened residuals are those of the fit."""
    tree, fit = short_posterior(noise="ar1"), short_mode(noise="ar1").choice.fit
    found, constant = d.residuals(tree), tree["constant_data"]
    assert np.abs(constant["correlation"]).max() > 0.01
    spread = tree["posterior"]["sensor_offset"].std(("chain", "draw")).values / constant["block_sd"].values
    for run, exact in enumerate(fit.residuals):
        mine = found.isel(row=found["run"].values == run)["white"].values.T
        assert (np.abs(mine - exact).max(axis=1) < 5.0 * spread[run] / np.sqrt(400)).all()


def test_channel_rows_state_noise_offset_and_tests_in_shown_units():
    tree = short_posterior(noise="ar1")
    rows, constant = d.channel_rows(tree), tree["constant_data"]
    assert [(row["run"], row["channel"], row["unit"]) for row in rows] == [
        (run, *channel) for run in (1, 2) for channel in (("u", "m/s"), ("v", "m/s"), ("r", "deg/s"))
    ]
    last, offset = rows[-1], tree["posterior"]["sensor_offset"].isel(run=1).sel(channel="r")
    assert last["block_sd"] == pytest.approx(np.rad2deg(float(constant["block_sd"][1, 2])))
    assert last["offset"] == pytest.approx(np.rad2deg(float(offset.mean())))
    assert last["correlation"] == pytest.approx(float(constant["correlation"][1, 2]))
    white = d.residuals(tree).isel(row=constant["run"].values == 1)["white"].sel(channel="r").values
    assert (last["blocks"], last["chi2"]) == (white.size, pytest.approx(np.mean(white**2)))
    assert last["inside"] == np.mean(np.abs(white) <= 1.96)
    assert last["p_value"] > 1e-4
    assert 2.0 < last["largest"] < 5.0
    assert np.isnan(d.channel_rows(short_posterior())[0]["offset"])


def test_a_slow_wave_in_the_residuals_is_found_and_a_channel_that_is_not_there_left_out():
    tree = short_posterior()
    run, time = tree["constant_data"]["run"].values, tree["constant_data"]["time"].values
    wave = 0.05 * np.sin(time / 5.0)

    def spoil(response):
        response[run == 0, 0] += wave[run == 0]
        response[run == 1, 2] = np.nan

    rows = {(row["run"], row["channel"]): row for row in d.channel_rows(changed(tree, "observed_data/response", spoil))}
    assert rows[1, "u"]["p_value"] < 1e-6
    assert rows[1, "u"]["r1"] > 0.3
    assert rows[1, "v"]["p_value"] > 1e-3
    assert (2, "r") not in rows
    assert len(rows) == 5


# draws that diverge


def test_draws_that_diverged_are_left_out_of_what_weighs_draws():
    tree = short_posterior()
    assert d.without_diverged_draws(tree) is tree
    fewer = d.without_diverged_draws(changed(tree, "log_likelihood/response", lambda v: v[1, 3:5].fill(np.nan)))
    kept = np.delete(tree["posterior"]["coefficients"].values.reshape(400, -1), [103, 104], axis=0)
    assert fewer["posterior"]["coefficients"].dims == ("chain", "draw", "coefficient")
    np.testing.assert_array_equal(fewer["posterior"]["coefficients"].values, kept[None])
    assert np.isfinite(fewer["log_likelihood"]["response"]).all()
    assert fewer["log_prior"]["coefficients"].shape == (1, 398)
    assert np.isfinite(cross_validation(fewer).elpd)
