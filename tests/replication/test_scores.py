from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.replication.scores import (
    coefficient_rows,
    error_summary,
    forecast_row,
    published_rows,
    relative_error,
    statistic_and_error,
    summary_rows,
)
from pymc_ship.ships.ensemble.scores import BANDS

SCORED = ("u", "v", "r", "phi", "psi")
ZIGZAG = ps.zigzag(20.0, 20.0)


def posterior(mean, sd=None):
    """Posterior with 5 and 95 % quantiles one sd from the mean."""
    mean = np.asarray(mean, dtype=float)
    sd = np.zeros(mean.size) if sd is None else sd
    sides = {0.05: -1.0, 0.95: 1.0}
    return SimpleNamespace(
        mean=mean, sd=sd, quantiles=lambda probabilities: [mean + sides[p] * sd for p in probabilities]
    )


def off_by(vessel, percent):
    """Posteriors whose means are all off by a percentage."""
    return {dof: posterior((1.0 + percent / 100.0) * vessel.coefficients(dof).values) for dof in vessel.dofs}


def shifted_bands(ship, found, shift, width):
    """Forecast whose median is off by ``shift`` ranges of each channel, in bands of half ``width`` ranges."""
    offsets = xr.DataArray([shift - width, shift, shift + width], coords={"band": list(BANDS)})
    channels = ship[list(SCORED)]
    bands = (channels + offsets * (channels.max() - channels.min())).transpose("band", "time")
    index_bands = found + xr.DataArray([-1.0, 0.0, 1.0], coords={"band": list(BANDS)})
    attrs = {"label": "zigzag", "diverged_fraction": 0.25, "extrapolated_fraction": 0.5, "extrapolation": "Half of it."}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs=attrs), "bands": bands, "index_bands": index_bands})


@pytest.fixture(scope="module")
def ship(container):
    return ps.simulate(container, ZIGZAG, duration=300.0, record_interval=0.5)


def test_relative_error_is_in_percent_and_unknown_for_zero():
    estimate, reference = np.array([1.1, -1.8, 0.3, np.nan]), np.array([1.0, -2.0, 0.0, 1.0])
    np.testing.assert_allclose(relative_error(estimate, reference), [10.0, 10.0, np.nan, np.nan])


def test_error_summary_counts_known_errors_only():
    summary = error_summary(np.array([1.0, 4.9, 5.0, 19.0, 51.0, np.nan]))
    assert summary == {"coefficients": 5, "median": 5.0, "under_5": 40.0, "under_20": 80.0, "under_50": 80.0}


def test_error_summary_of_nothing_known_is_nan():
    summary = error_summary(np.full(3, np.nan))
    assert summary.pop("coefficients") == 0
    assert np.isnan(list(summary.values())).all()
    assert len(summary) == 4


def test_coefficient_rows_put_estimates_times_1e5_beside_reference_and_print(container):
    mean = 1.02 * container.coefficients("surge").values
    exact = {"conjugate": posterior(mean, sd=0.5 * np.abs(mean)), "semiconjugate": posterior(mean)}
    rows = coefficient_rows(container, "surge", exact)
    assert [row["coefficient"] for row in rows] == container.coefficients("surge")["coefficient"].values.tolist()
    row = rows[1]
    assert row["coefficient"] == "Xuu"
    assert row["sign_source"] == "perez-blanke"
    assert row["reference"] == pytest.approx(-64.5)
    assert row["mean_conjugate"] == pytest.approx(1.02 * -64.5)
    assert row["sd_conjugate"] == pytest.approx(0.51 * 64.5)
    assert row["error_conjugate"] == pytest.approx(2.0)
    assert row["published_conjugate"] == pytest.approx(-67.5)
    assert row["published_error_conjugate"] == pytest.approx(100.0 * 3.0 / 64.5)
    assert row["published_error_semiconjugate"] == pytest.approx(100.0 * 0.3 / 64.5)


def test_summary_rows_have_every_dof_and_the_whole(container):
    rows = summary_rows(
        container, {"conjugate": off_by(container, 3.0), "semiconjugate": off_by(container, 30.0)}, level=0.01
    )
    assert [(row["family"], row["dof"]) for row in rows] == [
        (family, dof) for family in ("conjugate", "semiconjugate") for dof in (*container.dofs, "all")
    ]
    counts = {row["dof"]: row["coefficients"] for row in rows}
    zeros = sum(int((container.coefficients(dof) == 0.0).sum()) for dof in container.dofs)
    assert counts["all"] == sum(counts[dof] for dof in container.dofs)
    assert counts["all"] == sum(container.coefficients(dof).size for dof in container.dofs) - zeros
    assert zeros > 0
    for row in rows:
        expected = (3.0, 100.0, 100.0) if row["family"] == "conjugate" else (30.0, 0.0, 0.0)
        assert (row["median"], row["under_5"], row["under_20"]) == pytest.approx(expected)
        assert row["level"] == 0.01


def test_coverage_is_the_share_of_references_inside_the_interval(container):
    """Intervals reach the reference for all of sway, for all but the first two of yaw and for none of the others."""
    exact = {}
    for dof in container.dofs:
        reference = container.coefficients(dof).values
        reach = np.full(reference.size, 1.001 if dof in ("sway", "yaw") else 0.999)
        reach[:2] = 0.999 if dof == "yaw" else reach[0]
        exact[dof] = posterior(reference + 1.0, sd=reach)
    rows = {row["dof"]: row["coverage"] for row in summary_rows(container, {"conjugate": exact})}
    sizes = {dof: container.coefficients(dof).size for dof in container.dofs}
    inside = {"surge": 0, "sway": sizes["sway"], "yaw": sizes["yaw"] - 2, "roll": 0}
    expected = {dof: 100.0 * inside[dof] / sizes[dof] for dof in sizes}
    expected["all"] = 100.0 * sum(inside.values()) / sum(sizes.values())
    assert rows == pytest.approx(expected)


def test_published_rows_are_the_summary_of_the_printed_estimates(container):
    rows = published_rows(container, ("conjugate",))
    printed = {dof: posterior(container.published_estimates(dof, "conjugate")) for dof in container.dofs}
    expected = summary_rows(container, {"conjugate": printed}, level="published")
    assert rows == [pytest.approx(row | {"coverage": np.nan}, nan_ok=True) for row in expected]
    assert rows[-1]["dof"] == "all"
    assert 0.0 < rows[-1]["median"] < 100.0


def test_published_rows_of_a_vessel_without_print_are_nan(container):
    bare = {dof: tuple(replace(c, published={}) for c in force) for dof, force in container.forces.items()}
    rows = published_rows(replace(container, forces=bare), ("conjugate",))
    assert [row["coefficients"] for row in rows] == [0] * 5
    assert np.isnan([row["median"] for row in rows]).all()


@pytest.mark.parametrize(("shift", "width", "coverage"), [(0.0, 0.1, 100.0), (0.02, 0.1, 100.0), (-0.2, 0.1, 0.0)])
def test_forecast_row_measures_error_in_ranges_and_coverage(ship, shift, width, coverage):
    found = ps.indices(ship)
    row = forecast_row(ship, found, shifted_bands(ship, found, shift, width), family="conjugate")
    assert row["error"] == pytest.approx(100.0 * abs(shift), abs=1e-9)
    assert row["coverage"] == coverage
    assert (row["diverged"], row["extrapolated"], row["extrapolation"]) == (25.0, 50.0, "Half of it.")
    assert (row["family"], row["manoeuvre"]) == ("conjugate", "zigzag")
    angle = float(found["first_overshoot_angle"])
    names = ("reference", *BANDS)
    values = [row[f"first_overshoot_angle_{name}"] for name in names]
    np.testing.assert_allclose(values, [angle, angle - 1.0, angle, angle + 1.0])


def test_coverage_is_the_share_of_instants(ship):
    found = ps.indices(ship)
    tree = shifted_bands(ship, found, 0.0, 0.1)
    upper = tree["bands"]["psi"].values
    quarter = ship.sizes["time"] // 4
    upper[BANDS.index("upper"), :quarter] = upper[BANDS.index("lower"), :quarter]
    row = forecast_row(ship, found, tree)
    assert row["coverage"] == pytest.approx(100.0 - 25.0 / len(SCORED))


def test_a_channel_that_never_moves_is_not_scored(ship):
    """The roll angle of a vessel without roll has no range to measure errors in."""
    still = ship.assign(phi=0.0 * ship["phi"])
    found = ps.indices(still)
    row = forecast_row(still, found, shifted_bands(still, found, 0.05, 0.1))
    assert row["error"] == pytest.approx(5.0)
    assert row["coverage"] == 100.0


def test_the_error_of_a_mean_is_its_standard_error():
    values = np.random.default_rng(0).standard_normal(200)
    assert statistic_and_error(values, "mean")[1] == pytest.approx(values.std() / np.sqrt(200), rel=0.15)
