"""Curves of the forces over the motion: draws, reference and what the record covers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from pymc_ship.physics.forces.propeller import Propeller
from pymc_ship.physics.forces.terms import SYMBOLS
from pymc_ship.ships.forecasting.force_curves import force_curves, force_draws
from tests.inference.trajectory.cases import unmodelled_roll_text
from tests.ships.forecasting.cases import legend, scattered


class TestForceCurves:
    def test_a_curve_is_the_sum_of_the_terms_of_its_quantity(self, container):
        """N' along v' of the container ship is N_v v' + N_vvv v'^3 and the like, all else zero."""
        draws, v = scattered(container, 3), np.array([-0.2, 0.1])
        forces = force_draws(container, draws, "yaw", "v", v)
        names = [name for dof in container.dofs for name in container.coefficients(dof)["coefficient"].values]
        expected = 0.0
        for name, values in zip(names, draws.T, strict=True):
            factor = {"N0": 1.0 + 0.0 * v, "Nv": v, "Nvv": v**2, "Nvvv": v**3, "Nv|v|": v * np.abs(v)}.get(name)
            expected = expected + (0.0 if factor is None else np.outer(values, factor))
        assert forces.shape == (3, 2)
        np.testing.assert_allclose(forces, expected, rtol=1e-12)

    def test_bands_hold_the_share_and_structures_are_pooled(self, container):
        flat = unmodelled_roll_text(container)
        models = [(container, scattered(container, 30)), (flat, 1.5 * scattered(flat, 10))]
        ax = force_curves(models).axes[4]
        v = ax.get_lines()[0].get_xdata()
        curves = 1e3 * np.concatenate([force_draws(vessel, draws, "sway", "r", v) for vessel, draws in models])
        np.testing.assert_allclose(ax.get_lines()[0].get_ydata(), np.median(curves, axis=0))
        path = ax.collections[0].get_paths()[0].vertices
        lower, upper = np.quantile(curves, [0.025, 0.975], axis=0)
        assert path[:, 1].min() == pytest.approx(lower.min())
        assert path[:, 1].max() == pytest.approx(upper.max())

    def test_the_range_of_the_record_is_shaded_in_the_unit_of_its_axis(self, container):
        values = np.zeros((2, len(SYMBOLS)))
        for symbol, ends in {"v": (-0.1, 0.05), "r": (-0.9, 0.3), "delta": np.deg2rad((-20.0, 10.0))}.items():
            values[:, SYMBOLS.index(symbol)] = ends
        record = xr.DataArray(values, dims=("row", "symbol"), coords={"symbol": list(SYMBOLS)})
        fig = force_curves([(container, scattered(container, 5))], record)
        for ax, ends in zip(fig.axes[:3], ((-0.1, 0.05), (-0.9, 0.3), (-20.0, 10.0)), strict=True):
            (span,) = ax.patches
            assert (span.get_x(), span.get_x() + span.get_width()) == pytest.approx(ends)
        assert fig.axes[1].get_xlim() == pytest.approx((-1.35, 1.35))
        assert fig.axes[2].get_xlim() == pytest.approx((-40.0, 40.0))
        assert "range of the training record" in legend(fig)
        assert not force_curves([(container, scattered(container, 5))]).axes[0].patches

    def test_rudder_forces_behind_a_propeller_are_those_at_the_nominal_speed(self, container):
        propeller = Propeller(D=6.5, n=1.5, wake_fraction=0.3, k_0=0.4, k_1=-0.3, k_2=-0.1, eta=0.8, kappa=0.5)
        terms = {"surge": ("X0", "XT"), "sway": ("Yv", "Ygsincos"), "yaw": ("Nv", "Ngsincos")}
        coefficient = container.forces["sway"][0]
        forces = {dof: tuple(replace(coefficient, name=name) for name in names) for dof, names in terms.items()}
        vessel = replace(container, forces=forces, propeller=propeller)
        forces = force_draws(vessel, np.arange(1.0, 7.0)[None], "yaw", "delta", np.array([0.2]))
        assert forces[0, 0] == pytest.approx(6.0 * np.sin(0.2) * np.cos(0.2))
        assert force_draws(vessel, np.arange(1.0, 7.0)[None], "surge", "delta", np.array([0.2]))[0, 0] == pytest.approx(
            1.0
        )
