import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.physics.vessel.vessel import reference_coefficients
from pymc_ship.ships.ensemble.draws import fitted_motion, sensor_noise
from pymc_ship.ships.ensemble.scores import BANDS, quantiles
from pymc_ship.ships.forecasting.extrapolation import extrapolation
from pymc_ship.ships.forecasting.forecast import _median_draw, draws_text, has_roll, pooled_forecast
from pymc_ship.ships.forecasting.page import measured_doubts
from pymc_ship.trial.channels import SIMULATED
from pymc_ship.trial.record import OVER_GROUND
from tests.inference.trajectory.cases import unmodelled_roll_text
from tests.ships.ensemble.cases import posterior_forecast, ship_of
from tests.ships.forecasting.posteriors import joint, posterior, scattered

ZIGZAG = ps.zigzag(20.0, 20.0)
STEPS = ps.rudder_programme([0.0, 20.0, 60.0], [0.0, 0.3, -0.3])


@pytest.fixture(scope="module")
def fan(container):
    """41 ships with coefficients scattered by 1 %."""
    rng = np.random.default_rng(1)
    posteriors = {dof: scattered(container, dof, 41, rng) for dof in container.dofs}
    return posterior_forecast(container, posteriors, ZIGZAG, draws=41, rng=rng, duration=150.0)


SAME = {"rtol": 1e-11, "atol": 1e-12}
"""Up to the last bits: ships in a batch are computed in vector registers, one ship alone is not."""


@pytest.mark.parametrize("manoeuvre", [ZIGZAG, ps.turning_circle(35.0, side="starboard")], ids=lambda m: m.kind)
def test_certainty_about_the_reference_forecasts_the_reference_ship(container, manoeuvre):
    posteriors = {
        dof: posterior(container.coefficients(dof)["coefficient"].values, np.tile(container.coefficients(dof), (20, 1)))
        for dof in container.dofs
    }
    tree = posterior_forecast(container, posteriors, manoeuvre, draws=20, rng=np.random.default_rng(1), duration=300.0)
    ship = ps.simulate(container, manoeuvre, duration=300.0, step=0.02, record_interval=0.5)
    expected = ps.indices(ship)
    for band in BANDS:
        for name in SIMULATED:
            np.testing.assert_allclose(tree["bands"][name].sel(band=band), ship[name], **SAME)
        for name in expected.data_vars:
            np.testing.assert_allclose(tree["index_bands"][name].sel(band=band), expected[name], **SAME)
    assert tree.attrs["diverged_fraction"] == 0.0


def test_every_instant_of_every_channel_has_the_requested_band(fan):
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
    trees = (
        posterior_forecast(container, posteriors, ZIGZAG, rng=np.random.default_rng(3), ci_prob=prob, **settings)
        for prob in (0.5, 0.9)
    )
    half, most = (tree["bands"]["psi"] for tree in trees)
    assert float(most[2, -1] - most[0, -1]) > 1.5 * float(half[2, -1] - half[0, -1]) > 0.0
    np.testing.assert_array_equal(most[1], half[1])


def test_diverged_draws_are_counted_and_bands_are_of_the_others(container):
    reference = container.coefficients("surge")
    draws = np.tile(reference.values, (10, 1))
    draws[[1, 4, 8], 0] = 5.0
    draws[:, 0] *= 1.0 + 0.01 * np.arange(10)
    posteriors = {"surge": posterior(reference["coefficient"].values, draws)}
    tree = posterior_forecast(container, posteriors, ZIGZAG, draws=10, rng=np.random.default_rng(4), duration=200.0)
    ships = tree["trajectories"].to_dataset()
    assert tree.attrs["diverged_fraction"] == 0.3
    assert int(ships["diverged"].sum()) == 3
    assert int(np.isnan(ships["u"].isel(time=-1)).sum()) == 3
    expected = np.nanquantile(ships["u"], [0.05, 0.5, 0.95], axis=0)
    np.testing.assert_allclose(tree["bands"]["u"], expected, rtol=1e-12)
    assert np.isfinite(tree["bands"]["u"]).all()


def test_the_same_generator_gives_the_same_forecast(container):
    posteriors = {"yaw": scattered(container, "yaw", 100, np.random.default_rng(9))}
    one, two, other = (
        posterior_forecast(container, posteriors, ZIGZAG, draws=20, rng=np.random.default_rng(seed), duration=40.0)
        for seed in (10, 10, 11)
    )
    xr.testing.assert_identical(one, two)
    assert not one["bands"].to_dataset().equals(other["bands"].to_dataset())


def test_a_rudder_programme_has_bands_but_no_indices(container):
    programme = ps.rudder_programme([0.0, 10.0, 20.0], [0.0, 0.2, -0.1])
    posteriors = {"yaw": scattered(container, "yaw", 4, np.random.default_rng(12))}
    tree = posterior_forecast(container, posteriors, programme, draws=4, rng=np.random.default_rng(1), duration=30.0)
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
        quantiles(values, probabilities), np.nanquantile(values, probabilities, axis=0), rtol=1e-13
    )
    values[:, 2, 2] = np.nan
    assert np.isnan(quantiles(values, probabilities)[:, 2, 2]).all()


def read_back(tree, sd, instants):
    """Half the width of the measured bands of a channel over what its noise makes of it, mean over the instants."""
    bands = tree["measured_bands"]["v"].isel(time=instants)
    return float((bands.sel(band="upper") - bands.sel(band="lower")).mean()) / (2.0 * 1.6448536 * sd)


@pytest.mark.parametrize(("factor", "holds"), [(1.0, True), (1.05, False)])
def test_measured_bands_of_known_coefficients_are_those_of_the_noise(container, factor, holds):
    """The 5 and 95 % quantiles of n normal draws have the sd (p (1 - p) / n)^(1/2) / density: 0.067 sd for n = 1000.

    The mean of 2 x 160 of them has 0.0037 sd, that is 0.0023 of 1.645 sd; that order statistics lie a little inside
    adds 0.003.
    """
    tree = joint(container, 50, np.random.default_rng(18), spread=0.0)
    settings = {"draws": 1000, "duration": 80.0, "step": 0.1, "noise_sd": {"v": 0.05 * factor}}
    result = posterior_forecast(container, tree, STEPS, rng=np.random.default_rng(19), **settings)
    assert (abs(read_back(result, 0.05, slice(None)) - 1.0) < 4.0 * 0.0023 + 0.003) == holds
    assert list(result["measured_bands"].data_vars) == ["v"]
    assert result["measured_bands"]["v"].attrs["units"] == "m/s"
    ship = result["bands"]["v"]
    np.testing.assert_allclose(ship.sel(band="upper"), ship.sel(band="lower"), **SAME)


def test_noise_of_sensors_adds_to_the_uncertainty_of_the_coefficients_in_squares(container):
    """Where both are alike: widths of normal bands add in squares, within the error of 600 draws."""
    tree = joint(container, 600, np.random.default_rng(20))
    settings = {"draws": 600, "duration": 140.0, "step": 0.1}
    known = posterior_forecast(container, tree, STEPS, rng=np.random.default_rng(21), noise_sd={}, **settings)
    late = slice(120.0, None)
    sd = float(known["trajectories"]["psi"].sel(time=late).std("draw").mean())
    result = posterior_forecast(container, tree, STEPS, rng=np.random.default_rng(21), noise_sd={"psi": sd}, **settings)
    only, both = (
        (result[group]["psi"].sel(band="upper") - result[group]["psi"].sel(band="lower")).sel(time=late)
        for group in ("bands", "measured_bands")
    )
    expected = np.sqrt(only**2 + (2.0 * 1.6448536 * sd) ** 2)
    assert float((both / expected).mean()) == pytest.approx(1.0, abs=0.04)
    assert float((only / expected).mean()) < 0.8


def test_noise_changes_only_the_measured_bands(container, zigzag_trial):
    rng = np.random.default_rng(22)
    tree = joint(container, 40, rng, trial=zigzag_trial, noise_sd={"u": 0.1, "r": 1e-3})
    settings = {"draws": 20, "duration": 60.0}
    with_noise, without, other, again = (
        posterior_forecast(container, tree, ZIGZAG, rng=np.random.default_rng(23), **settings, **noise)
        for noise in ({}, {"noise_sd": {}}, {"noise_sd": {"r": 2e-3, "u": 0.1}}, {"noise_sd": {"u": 0.1, "r": 1e-3}})
    )
    assert sensor_noise(tree) == {"u": 0.1, "r": 1e-3}
    assert sensor_noise({"sway": tree}) == {}
    assert "measured_bands" not in without.children
    xr.testing.assert_identical(with_noise, again)
    xr.testing.assert_identical(with_noise["measured_bands"]["u"], other["measured_bands"]["u"])
    assert not with_noise["measured_bands"]["r"].equals(other["measured_bands"]["r"])
    for group in without.children:
        xr.testing.assert_identical(without[group].to_dataset(), with_noise[group].to_dataset())


def test_a_turn_from_a_gentle_zigzag_is_flagged_and_the_zigzag_itself_is_not(container):
    gentle = ps.zigzag(10.0, 10.0)
    trial = ps.simulate(container, gentle, duration=300.0)
    tree = joint(container, 60, np.random.default_rng(24), spread=0.002, trial=trial)
    turn, zigzag = (
        posterior_forecast(container, tree, manoeuvre, draws=60, rng=np.random.default_rng(25), duration=300.0)
        for manoeuvre in (ps.turning_circle(35.0), gentle)
    )
    assert turn.attrs["extrapolated_fraction"] > 0.9
    assert zigzag.attrs["extrapolated_fraction"] < 0.3
    assert float(turn["extrapolation"]["distance"].max()) > 2.0
    assert float(zigzag["extrapolation"]["distance"].max()) < 0.01
    assert "speed falls to" in turn.attrs["extrapolation"]
    assert "speed falls to" not in zigzag.attrs["extrapolation"]
    assert draws_text(turn).startswith("60 draws, 0 % diverged, 9")
    assert turn["extrapolation"]["outside_fraction"].dims == ("time",)
    assert turn["extrapolation"]["above"].dims == ("symbol",)


def test_the_fraction_outside_counts_draws_that_have_not_diverged(container, zigzag_trial):
    """Three of ten ships diverge; the shares are of the others from then on."""
    tree = joint(container, 10, np.random.default_rng(26), trial=zigzag_trial)
    tree["posterior"]["coefficients"][0, [1, 4, 8], 0] = 5.0
    result = posterior_forecast(container, tree, ZIGZAG, draws=10, rng=np.random.default_rng(27), duration=200.0)
    ships = result["trajectories"].to_dataset()
    each = extrapolation(container, ships, fitted_motion(tree))
    running = ships["u"].notnull()
    assert result.attrs["diverged_fraction"] == 0.3
    assert int(running.isel(time=-1).sum()) == 7
    over_time = result["extrapolation"].to_dataset()
    np.testing.assert_allclose(over_time["outside_fraction"], each["outside"].where(running).mean("draw"))
    np.testing.assert_allclose(over_time["distance"], each["distance"].median("draw"))
    np.testing.assert_allclose(over_time["highest"], each["highest"].median("draw"))
    assert result.attrs["extrapolated_fraction"] == pytest.approx(float(each["outside"].where(running).mean()))
    assert 0.02 < result.attrs["extrapolated_fraction"] < 0.9
    assert 0.0 < float(over_time.attrs["median_distance"]) == each["distance"].where(each["outside"]).median()


def test_extrapolation_is_unknown_where_the_fitted_motion_is(container, zigzag_trial):
    rng = np.random.default_rng(28)
    settings = {"draws": 4, "duration": 10.0}
    fitted = joint(container, 4, rng, trial=zigzag_trial)
    other = joint(container, 4, rng, trial=zigzag_trial.isel(time=slice(5000)))
    assert fitted_motion({}) is None
    alone = {"sway": scattered(container, "sway", 4, rng)}
    unknown = (alone, joint(container, 4, rng), {"sway": scattered(container, "sway", 4, rng), "yaw": fitted})
    for posteriors in (*unknown, {"sway": fitted, "yaw": other}):
        assert fitted_motion(posteriors) is None
        result = posterior_forecast(container, posteriors, ZIGZAG, rng=np.random.default_rng(1), **settings)
        assert "extrapolation" not in result.children
        assert np.isnan(result.attrs["extrapolated_fraction"])
        assert result.attrs["extrapolation"].startswith("Extrapolation is not assessed: ")
        assert draws_text(result) == "4 draws, 0 % diverged"
    for posteriors in (fitted, {"sway": fitted, "yaw": fitted}):
        xr.testing.assert_identical(fitted_motion(posteriors), fitted["constant_data"]["motion"])
        result = posterior_forecast(container, posteriors, ZIGZAG, rng=np.random.default_rng(1), **settings)
        assert np.isfinite(result.attrs["extrapolated_fraction"])


class TestMedianDraw:
    def test_it_has_the_median_indices(self, container):
        """The median of ordered draws is the middle one, in any order."""
        factors = np.array([1.04, 0.98, 1.0, 1.02, 0.96])
        draws = np.outer(factors, reference_coefficients(container))
        turn = ps.turning_circle(35.0)
        tree = pooled_forecast([(container, draws)], turn, duration=300.0, ci_prob=0.9, rng=np.random.default_rng(1))
        advance = tree["indices"]["advance"].values
        assert advance[tree.attrs["median_draw"]] == np.median(advance)

    def test_model_error_of_the_indices_does_not_matter(self, container):
        draws = reference_coefficients(container) * np.linspace(0.95, 1.05, 11)[:, None]
        settings = {"duration": 200.0, "ci_prob": 0.9, "rng": np.random.default_rng(1)}
        errors = dict.fromkeys(("angle", "time", "distance", "roll"), 0.5)
        bare, erring = (
            pooled_forecast([(container, draws)], ZIGZAG, errors=given, **settings) for given in (None, errors)
        )
        assert not np.allclose(bare["indices"]["first_overshoot_angle"], erring["indices"]["first_overshoot_angle"])
        assert erring.attrs["median_draw"] == bare.attrs["median_draw"]

    def test_it_goes_by_the_indices_where_there_are_any(self, container):
        """The twin of the same draws by the track alone is another one."""
        draws = reference_coefficients(container) * (1.0 + 0.02 * np.random.default_rng(1).standard_normal((24, 102)))
        settings = {"duration": 200.0, "step": 0.25, "ci_prob": 0.9, "rng": np.random.default_rng(1)}
        tree = pooled_forecast([(container, draws)], ZIGZAG, **settings)
        running, track = np.ones(24, dtype=bool), tree["trajectories"].to_dataset()[["x", "y", "psi"]]
        assert tree.attrs["median_draw"] == _median_draw(tree["indices"].to_dataset(), running)
        assert tree.attrs["median_draw"] != _median_draw(track.isel(time=slice(None, None, 20)), running)

    def test_it_has_not_diverged_unless_all_have(self):
        values = xr.Dataset({"advance": ("draw", [1.0, 2.0, 4.0, np.nan])})
        assert _median_draw(values, np.array([True, True, True, False])) == 1
        assert _median_draw(values, np.array([True, False, True, False])) == 0
        assert _median_draw(values, np.zeros(4, dtype=bool)) == 1

    def test_manoeuvres_without_indices_go_by_the_track(self, container):
        draws = reference_coefficients(container) * (1.0 + 0.02 * np.random.default_rng(1).standard_normal((24, 102)))
        settings = {"duration": 100.0, "ci_prob": 0.9, "rng": np.random.default_rng(1)}
        tree = pooled_forecast([(container, draws)], STEPS, **settings)
        ends = tree["trajectories"]["y"].values[:, -1]
        assert abs(ends[tree.attrs["median_draw"]] - np.median(ends)) < 0.5 * np.std(ends)


class TestShipsThatRollAndShipsThatDoNot:
    """Term sets with roll have few draws: these give a band once one draw is beyond either end of it."""

    @pytest.fixture(scope="class")
    @classmethod
    def pooled(cls, container):
        flat, rng = unmodelled_roll_text(container), np.random.default_rng(14)
        noise = {"v": 0.01, "phi": 0.001}

        def of(rolling, ci_prob):
            models = [
                (ship, np.tile(reference_coefficients(ship), (n, 1))) for ship, n in ((container, rolling), (flat, 30))
            ]
            return pooled_forecast(models, ZIGZAG, duration=80.0, ci_prob=ci_prob, noise=noise, rng=rng)

        return of

    @pytest.mark.parametrize(("rolling", "ci_prob"), [(20, 0.9), (10, 0.8)])
    def test_enough_of_them_make_the_forecast_of_roll(self, pooled, rolling, ci_prob):
        tree = pooled(rolling, ci_prob)
        assert has_roll(tree)
        assert int(np.isfinite(tree["trajectories"]["phi"].isel(time=-1)).sum()) == rolling
        assert {"p", "phi"} < set(tree["bands"].data_vars)
        assert "phi" in tree["measured_bands"]
        assert int(np.isfinite(tree["indices"]["maximum_roll_angle"]).sum()) == rolling

    @pytest.mark.parametrize(("rolling", "ci_prob"), [(19, 0.9), (20, 0.95), (1, 0.5)])
    def test_too_few_make_none(self, pooled, rolling, ci_prob):
        tree = pooled(rolling, ci_prob)
        assert not has_roll(tree)
        assert not {"p", "phi"} & set(tree["bands"].data_vars)
        assert set(tree["measured_bands"].data_vars) == {"v"}
        assert "maximum_roll_angle" not in tree["indices"]
        assert tree["indices"].sizes["draw"] == rolling + 30
        assert float(tree["index_bands"]["first_overshoot_angle"].sel(band="median")) > 0.0


class TestSentencesOnWhatIsSimulated:
    """Term sets that do not depend on revolutions are left out with them, and hold one speed without them."""

    @pytest.fixture(scope="class")
    @classmethod
    def ship(cls):
        terms = ps.load_vessel("kvlcc2")
        models = [(one, np.tile(reference_coefficients(one), (n, 1))) for one, n in ((terms, 30), (modular(terms), 10))]
        return ship_of(*models)

    def test_term_sets_that_are_left_out_are_counted(self, ship):
        tree = ps.forecast(ship, ZIGZAG, rng=1, duration=200.0, n=1.5)
        assert tree.attrs["term_sets"] == 1
        assert "1 of 2 term sets, with 75 % of the draws" in tree.attrs["steering"]
        without = ps.forecast(ship, ZIGZAG, rng=1, duration=200.0)
        assert without.attrs["term_sets"] == 2
        assert "left out" not in without.attrs["steering"]

    @pytest.mark.parametrize(("speed", "held"), [(4.0, False), (7.6, True), (None, True)])
    def test_terms_hold_the_nominal_speed_alone(self, ship, speed, held):
        slow = ps.zigzag(20.0, 20.0, approach_speed=speed)
        tree = ps.forecast(ship, slow, rng=1, duration=200.0)
        assert ("hold 7.974 m/s alone: from" in tree.attrs["steering"]) != held
        parts = ps.forecast(modular(ps.load_vessel("kvlcc2")), slow, rng=1, duration=200.0)
        assert "alone" not in parts.attrs["steering"]

    def test_what_a_measured_trial_has_and_its_forecast_has_not_is_named(self, ship):
        tree = ps.forecast(ship, ZIGZAG, rng=1, duration=200.0)
        trial = ps.simulate("kvlcc2", ZIGZAG, duration=400.0, step=0.5)
        wind = {"wind_speed": ("time", np.full(800, 9.0)), "wind_direction": ("time", np.full(800, np.deg2rad(40.0)))}
        (windy,) = measured_doubts({"a": trial.assign(wind)}, {"a": tree})
        assert "9 m/s from 40 deg off the bow" in windy
        (ground,) = measured_doubts({"a": trial.assign_attrs(speeds=OVER_GROUND)}, {"a": tree})
        assert "over ground" in ground
        assert measured_doubts({"a": trial}, {"a": tree}) == []


def modular(vessel):
    """The vessel as a modular model."""
    return ps.with_terms(vessel, "modular")
