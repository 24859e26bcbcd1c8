from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.physics.vessel.reading import shipped_vessels
from tests.physics.motion import plain_hull
from tests.sentences import refused

CONTAINER = Path(__file__).parents[3] / "models" / "container.toml"
DOFS = ("surge", "sway", "yaw", "roll")
LETTER = dict(zip(DOFS, "XYNK", strict=True))
ROWS = plain_hull.printed_rows()
ADDED = [row for row in ROWS if row["term"].endswith("dot")]
FORCES = {dof: [row for row in ROWS if row["dof"] == dof and row not in ADDED] for dof in DOFS}


def signed(row, column):
    """A printed number with the sign of its row; NaN where the print has none."""
    return int(row["sign"]) * float(row[column]) * 1e-5 if row[column] else np.nan


class TestContainer:
    def test_the_print_has_102_coefficients_and_10_acceleration_derivatives(self):
        assert [len(FORCES[dof]) for dof in DOFS] == [18, 28, 28, 28]
        assert len(ADDED) == 10

    @pytest.mark.parametrize("dof", DOFS)
    def test_coefficients_are_those_of_the_print_in_its_order(self, container, dof):
        reference = container.coefficients(dof)
        assert reference["coefficient"].values.tolist() == [LETTER[dof] + row["term"] for row in FORCES[dof]]
        assert reference["term"].values.tolist() == [row["term"] for row in FORCES[dof]]
        assert reference["sign_source"].values.tolist() == [row["sign_source"] for row in FORCES[dof]]
        expected = [signed(row, "rpmm_magnitude_1e5") for row in FORCES[dof]]
        np.testing.assert_allclose(reference.values, expected, rtol=1e-15)

    def test_acceleration_derivatives_are_those_of_the_print_in_its_order(self, container):
        table = tomllib.loads(CONTAINER.read_text())["added_mass"]
        del table["source"]
        assert list(table) == [LETTER[row["dof"]] + row["term"] for row in ADDED]
        assert [entry["sign_source"] for entry in table.values()] == [row["sign_source"] for row in ADDED]
        values = [container.added_mass[name] for name in table]
        np.testing.assert_allclose(values, [signed(row, "rpmm_magnitude_1e5") for row in ADDED], rtol=1e-15)

    def test_sign_sources_are_of_four_kinds_and_zero_means_zero(self):
        assert {row["sign_source"] for row in ROWS} == {"perez-blanke", "physics", "assumed", "zero"}
        for row in ROWS:
            assert (row["sign_source"] == "zero") == (float(row["rpmm_magnitude_1e5"]) == 0.0)

    @pytest.mark.parametrize("dof", DOFS)
    @pytest.mark.parametrize(("family", "column"), [("conjugate", "con"), ("semiconjugate", "semi")])
    def test_published_estimates_carry_the_sign_of_their_reference(self, container, dof, family, column):
        expected = [signed(row, f"published_{column}_1e5") for row in FORCES[dof]]
        np.testing.assert_allclose(container.published_estimates(dof, family), expected, rtol=1e-15)
        errors = [float(row[f"published_{column}_are_percent"] or np.nan) for row in FORCES[dof]]
        np.testing.assert_array_equal(container.published_errors(dof, family), errors)

    def test_particulars_and_inertia_are_those_of_the_print(self, container):
        s = container.particulars
        assert (s.L, s.B, s.volume, s.nominal_speed, s.GM, s.BM) == (230.66, 32.0, 46070.0, 12.7, 0.83, 9.0)
        assert (s.x_G, s.z_G, s.rudder_rate_deg) == (-0.46, -3.54, 2.3)
        np.testing.assert_allclose([container.m, container.I_xx, container.I_zz], [750.81e-5, 1.30e-5, 43.25e-5])

    def test_the_mass_fits_the_displacement(self, container):
        """m' = m / (1/2 rho L^3) = 2 volume / L^3: the same ship, from two rows of the print."""
        s = container.particulars
        assert container.m == pytest.approx(2.0 * s.volume / s.L**3, rel=1e-3)

    def test_inertia_matrix_is_that_of_the_equations(self, container):
        np.testing.assert_allclose(container.inertia_matrix, plain_hull.J, rtol=1e-14)

    def test_the_rigid_body_part_of_the_inertia_matrix_is_symmetric_and_positive(self, container):
        vessel = replace(container, added_mass=dict.fromkeys(container.added_mass, 0.0))
        np.testing.assert_array_equal(vessel.inertia_matrix, vessel.inertia_matrix.T)
        assert (np.linalg.eigvalsh(vessel.inertia_matrix) > 0.0).all()

    def test_container_is_shipped(self):
        assert "container" in shipped_vessels()


class TestText:
    """What a vessel shows of itself where a notebook or a debugger prints it."""

    def test_particulars_and_numbers_of_terms_stand_in_a_few_lines(self):
        lines = repr(ps.load_vessel("kvlcc2")).splitlines()
        assert lines[0].startswith("<Vessel 'kvlcc2': KVLCC2 tanker, 320 m, full load")
        assert lines[1:] == [
            "  L = 320 m, B = 58 m, d = 20.8 m, nominal speed 7.974 m/s",
            "  surge: 5 terms",
            "  sway: 12 terms",
            "  yaw: 12 terms",
            "  propeller: yes>",
        ]

    def test_what_a_ship_does_not_have_is_said(self, container):
        text = repr(container)
        assert len(text.splitlines()) < 12
        assert "draught not stated" in text
        assert f"roll: {len(container.terms('roll'))} terms" in text
        assert text.endswith("propeller: none>")

    def test_a_title_that_repeats_the_name_is_left_out(self, container):
        assert repr(replace(container, title="container")).splitlines()[0] == "<Vessel 'container'"


class TestCoefficients:
    def test_with_coefficients_changes_values_and_nothing_else(self, container):
        twice = container.with_coefficients({"yaw": 2.0 * container.coefficients("yaw").values})
        np.testing.assert_array_equal(twice.coefficients("yaw"), 2.0 * container.coefficients("yaw"))
        assert twice.coefficients("sway").identical(container.coefficients("sway"))
        assert twice.terms("yaw") == container.terms("yaw")
        with refused(ps.VesselError, "container", 28, 3):
            container.with_coefficients({"yaw": np.zeros(3)})

    def test_a_degree_of_freedom_without_coefficients_says_what_to_do(self, container):
        vessel = replace(container, forces=container.forces | {"sway": ()})
        for use in (vessel.terms, vessel.coefficients, lambda _: ps.simulate(vessel, ps.zigzag(10, 10), duration=10.0)):
            with refused(ps.VesselError, "container", "sway"):
                use("sway")
