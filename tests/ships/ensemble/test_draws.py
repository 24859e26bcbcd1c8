import numpy as np
import pytest
import xarray as xr

from pymc_ship.ships.ensemble.draws import coefficient_draws
from tests.ships.forecasting.posteriors import joint, posterior, reference_row, scattered


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


@pytest.mark.filterwarnings("ignore:The yaw posterior needs chains")  # whose values are labels
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


def test_a_joint_posterior_is_drawn_in_whole_rows(container):
    """Two equal coefficients of different DOFs stay equal; drawn by DOF they are independent."""
    rng = np.random.default_rng(15)
    tree = joint(container, 60, rng, chains=3)
    draws = tree["posterior"]["coefficients"]
    names = draws["coefficient"].values
    draws.loc[{"coefficient": "Nv"}] = 2.0 * draws.sel(coefficient="Yv")
    shuffled = xr.DataTree.from_dict({"posterior": draws.isel(coefficient=rng.permutation(names.size)).to_dataset()})
    first, second = (int(np.flatnonzero(names == name)[0]) for name in ("Yv", "Nv"))
    for source, size in ((tree, 50), (shuffled, 50), (shuffled, 200)):
        drawn = coefficient_draws(container, source, size, np.random.default_rng(16))
        assert drawn.shape == (size, names.size)
        np.testing.assert_array_equal(drawn[:, second], 2.0 * drawn[:, first])
        rows = {tuple(row) for row in draws.values.reshape(60, -1)}
        assert {tuple(row) for row in drawn} <= rows
    independent = coefficient_draws(container, dict.fromkeys(container.dofs, tree), 50, np.random.default_rng(16))
    assert abs(np.corrcoef(independent[:, first], independent[:, second])[0, 1]) < 0.5
