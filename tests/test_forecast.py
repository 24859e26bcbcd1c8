import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.forecast import _quantiles, coefficient_draws, forecast
from pymc_ship.trial import CHANNELS

ZIGZAG = ps.zigzag(20.0, 20.0)
BANDS = ("lower", "median", "upper")


def posterior(names, values, chains=1):
    """Posterior of draws, shape (n_draws, n_terms), dealt to chains."""
    values = np.asarray(values, dtype=float)
    sample = xr.Dataset(
        {"coefficients": (("chain", "draw", "coefficient"), values.reshape(chains, -1, values.shape[1]))},
        {"coefficient": list(names)},
    )
    return xr.DataTree.from_dict({"posterior": sample})


def scattered(vessel, dof, draws, rng, spread=0.01):
    """Draws around the reference values, with a relative spread."""
    reference = vessel.coefficients(dof)
    noise = 1.0 + spread * rng.standard_normal((draws, reference.size))
    return posterior(reference["coefficient"].values, reference.values * noise)


def reference_row(vessel):
    return np.concatenate([vessel.coefficients(dof).values for dof in vessel.dofs])


@pytest.fixture(scope="module")
def fan(container):
    """41 ships with coefficients scattered by 1 %."""
    rng = np.random.default_rng(1)
    posteriors = {dof: scattered(container, dof, 41, rng) for dof in container.dofs}
    return forecast(container, posteriors, ZIGZAG, draws=41, rng=rng, duration=150.0)


SAME = {"rtol": 1e-11, "atol": 1e-12}
"""Up to the last bits: ships in a batch are computed in vector registers, one ship alone is not."""


@pytest.mark.parametrize("manoeuvre", [ZIGZAG, ps.turning_circle(35.0, side="starboard")], ids=lambda m: m.kind)
def test_certainty_about_the_reference_forecasts_the_reference_ship(container, manoeuvre):
    posteriors = {
        dof: posterior(container.coefficients(dof)["coefficient"].values, np.tile(container.coefficients(dof), (20, 1)))
        for dof in container.dofs
    }
    tree = forecast(container, posteriors, manoeuvre, draws=20, rng=np.random.default_rng(1), duration=300.0)
    ship = ps.simulate(container, manoeuvre, duration=300.0, step=0.02, record_interval=0.5)
    found = ps.indices(ship)
    for band in BANDS:
        for name in CHANNELS:
            np.testing.assert_allclose(tree["bands"][name].sel(band=band), ship[name], **SAME)
        for name in found.data_vars:
            np.testing.assert_allclose(tree["index_bands"][name].sel(band=band), found[name], **SAME)
    assert tree.attrs["share_diverged"] == 0.0


def test_every_instant_of_every_channel_has_the_band_asked_for(fan):
    """The 5 and 95 % quantiles of 41 ships are the third from either end, so 37 lie between; the median is the 21st."""
    moving = fan["trajectories"].to_dataset().sel(time=slice(60.0, None))
    bands = fan["bands"].to_dataset().sel(time=slice(60.0, None))
    for name in ("u", "v", "r", "p", "phi", "psi", "x", "y"):
        lower, median, upper = (bands[name].sel(band=band) for band in BANDS)
        assert (lower < median).all()
        assert (median < upper).all()
        inside = ((moving[name] >= lower - 1e-12) & (moving[name] <= upper + 1e-12)).sum("draw")
        below = (moving[name] <= median + 1e-12).sum("draw")
        np.testing.assert_array_equal(inside, 37)
        np.testing.assert_array_equal(below, 21)


def test_index_bands_are_quantiles_of_the_ships(fan):
    angles = fan["indices"]["first_overshoot_angle"]
    assert angles.sizes == {"draw": 41}
    expected = np.quantile(angles, [0.05, 0.5, 0.95])
    np.testing.assert_allclose(fan["index_bands"]["first_overshoot_angle"], expected, rtol=1e-12)
    assert np.ptp(expected) > 0.1
    assert fan["index_bands"]["first_overshoot_angle"].attrs["units"] == "deg"


def test_a_wider_probability_gives_wider_bands(container):
    posteriors = {"yaw": scattered(container, "yaw", 40, np.random.default_rng(2))}
    settings = {"draws": 40, "duration": 60.0}
    half, most = (
        forecast(container, posteriors, ZIGZAG, rng=np.random.default_rng(3), ci_prob=prob, **settings)["bands"]["psi"]
        for prob in (0.5, 0.9)
    )
    assert float(most[2, -1] - most[0, -1]) > 1.5 * float(half[2, -1] - half[0, -1]) > 0.0
    np.testing.assert_array_equal(most[1], half[1])


def test_the_share_of_diverged_ships_is_counted_and_bands_are_of_the_others(container):
    reference = container.coefficients("surge")
    draws = np.tile(reference.values, (10, 1))
    draws[[1, 4, 8], 0] = 5.0
    draws[:, 0] *= 1.0 + 0.01 * np.arange(10)
    posteriors = {"surge": posterior(reference["coefficient"].values, draws)}
    tree = forecast(container, posteriors, ZIGZAG, draws=10, rng=np.random.default_rng(4), duration=200.0)
    ships = tree["trajectories"].to_dataset()
    assert tree.attrs["share_diverged"] == 0.3
    assert int(ships["diverged"].sum()) == 3
    assert int(np.isnan(ships["u"].isel(time=-1)).sum()) == 3
    expected = np.nanquantile(ships["u"], [0.05, 0.5, 0.95], axis=0)
    np.testing.assert_allclose(tree["bands"]["u"], expected, rtol=1e-12)
    assert np.isfinite(tree["bands"]["u"]).all()


def test_a_dof_left_out_keeps_the_reference(container):
    rng = np.random.default_rng(5)
    draws = coefficient_draws(container, {"sway": scattered(container, "sway", 30, rng)}, 20, rng)
    n_surge, n_sway = (container.coefficients(dof).size for dof in ("surge", "sway"))
    sway = slice(n_surge, n_surge + n_sway)
    others = np.delete(np.arange(draws.shape[1]), np.arange(draws.shape[1])[sway])
    reference = reference_row(container)
    np.testing.assert_array_equal(draws[:, others], np.tile(reference[others], (20, 1)))
    moving = reference[sway] != 0.0
    assert (draws[:, sway][:, moving] != reference[sway][moving]).all()
    np.testing.assert_array_equal(coefficient_draws(container, {}, 3, rng), np.tile(reference, (3, 1)))


def test_draws_are_whole_vectors_in_the_vessels_order(container):
    """Chains and draws are stacked, the posterior's order of coefficients does not matter, and no vector is split."""
    names = container.coefficients("yaw")["coefficient"].values
    number = np.arange(12.0)[:, None] + 0.001 * np.arange(len(names))
    straight = posterior(names, number, chains=3)
    shuffled = np.random.default_rng(6).permutation(len(names))
    mixed = posterior(names[shuffled], number[:, shuffled], chains=3)
    first = sum(container.coefficients(dof).size for dof in ("surge", "sway"))
    for tree in (straight, mixed):
        yaw = coefficient_draws(container, {"yaw": tree}, 12, np.random.default_rng(7))[:, first : first + len(names)]
        np.testing.assert_array_equal(np.sort(yaw[:, 0]), np.arange(12.0))
        np.testing.assert_allclose(yaw - yaw[:, :1], np.tile(0.001 * np.arange(len(names)), (12, 1)), atol=1e-12)


def test_draws_repeat_only_where_the_posterior_has_too_few(container):
    names = container.coefficients("surge")["coefficient"].values
    tree = posterior(names, np.arange(10.0)[:, None] + np.zeros(len(names)))
    few, many = (coefficient_draws(container, {"surge": tree}, n, np.random.default_rng(8))[:, 0] for n in (10, 25))
    assert len(set(few)) == 10
    assert many.size == 25
    assert set(many) <= set(range(10))


def test_the_same_generator_gives_the_same_forecast(container):
    posteriors = {"yaw": scattered(container, "yaw", 100, np.random.default_rng(9))}
    one, two, other = (
        forecast(container, posteriors, ZIGZAG, draws=20, rng=np.random.default_rng(seed), duration=40.0)
        for seed in (10, 10, 11)
    )
    xr.testing.assert_identical(one, two)
    assert not one["bands"].to_dataset().equals(other["bands"].to_dataset())


def test_a_rudder_programme_has_bands_but_no_indices(container):
    programme = ps.rudder_programme([0.0, 10.0, 20.0], [0.0, 0.2, -0.1])
    posteriors = {"yaw": scattered(container, "yaw", 4, np.random.default_rng(12))}
    tree = forecast(container, posteriors, programme, draws=4, rng=np.random.default_rng(1), duration=30.0)
    assert sorted(tree.children) == ["bands", "trajectories"]
    assert tree["bands"].sizes == {"band": 3, "time": 60}


def test_quantiles_leave_nan_out_like_numpy():
    rng = np.random.default_rng(13)
    values = rng.standard_normal((31, 6, 5))
    values[rng.random(values.shape) < 0.4] = np.nan
    values[:, 0, 0] = [1.0, *[np.nan] * 30]
    values[:, 1, 1] = [*[np.nan] * 29, 2.0, 1.0]
    probabilities = [0.0, 0.05, 0.5, 0.77, 1.0]
    np.testing.assert_allclose(
        _quantiles(values, probabilities), np.nanquantile(values, probabilities, axis=0), rtol=1e-13
    )
    values[:, 2, 2] = np.nan
    assert np.isnan(_quantiles(values, probabilities)[:, 2, 2]).all()


def test_posteriors_that_do_not_fit_the_vessel_are_refused(container):
    rng = np.random.default_rng(14)
    names = container.coefficients("sway")["coefficient"].values
    lacking = posterior(names[2:], np.zeros((4, len(names) - 2)))
    expected = ", ".join(sorted(names[:2]))
    with pytest.raises(ps.VesselError, match=rf"The sway posterior lacks {expected} of 'container'; use its own terms"):
        coefficient_draws(container, {"sway": lacking}, 4, rng)
    with pytest.raises(ps.VesselError, match="surge, sway, yaw, roll; found 'heave'"):
        coefficient_draws(container, {"heave": lacking}, 4, rng)


@pytest.mark.parametrize("settings", [{"draws": 1}, {"ci_prob": 0.0}, {"ci_prob": 1.0}, {"ci_prob": np.nan}])
def test_settings_without_meaning_are_refused(container, settings):
    with pytest.raises(ValueError, match=r"needs two draws and 0 < ci_prob < 1, found"):
        forecast(container, {}, ZIGZAG, rng=np.random.default_rng(1), duration=10.0, **settings)
