from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pymc_ship as ps
from tests.motion import plain_hull

CONTAINER = Path(__file__).parents[2] / "models" / "container.toml"
DOFS = ("surge", "sway", "yaw", "roll")
LETTER = dict(zip(DOFS, "XYNK", strict=True))
ROWS = plain_hull.printed_rows()
ADDED = [row for row in ROWS if row["term"].endswith("dot")]
FORCES = {dof: [row for row in ROWS if row["dof"] == dof and row not in ADDED] for dof in DOFS}


def signed(row, column):
    """A printed number with the sign of its row; NaN where the print has none."""
    return int(row["sign"]) * float(row[column]) * 1e-5 if row[column] else np.nan


@pytest.fixture
def vessel_file(tmp_path):
    """Write container.toml with one regular expression replaced, once; return its path."""

    def write(pattern, replacement):
        text, count = re.subn(pattern, lambda _: replacement, CONTAINER.read_text(), count=1, flags=re.MULTILINE)
        assert count == 1, f"{pattern} is not in container.toml"
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return path

    return write


def error_of(path):
    with pytest.raises(ps.VesselError) as error:
        ps.load_vessel(path)
    message = str(error.value)
    assert str(path) in message
    assert message.endswith(".")
    assert "\n" not in message
    return message.replace(str(path), "FILE")


class TestContainer:
    def test_the_print_has_102_coefficients_and_10_acceleration_derivatives(self):
        assert [len(FORCES[dof]) for dof in DOFS] == [18, 28, 28, 28]
        assert len(ADDED) == 10

    @pytest.mark.parametrize("dof", DOFS)
    def test_coefficients_are_those_of_the_print_in_its_order(self, container, dof):
        found = container.coefficients(dof)
        assert found["coefficient"].values.tolist() == [LETTER[dof] + row["term"] for row in FORCES[dof]]
        assert found["term"].values.tolist() == [row["term"] for row in FORCES[dof]]
        assert found["sign_source"].values.tolist() == [row["sign_source"] for row in FORCES[dof]]
        expected = [signed(row, "rpmm_magnitude_1e5") for row in FORCES[dof]]
        np.testing.assert_allclose(found.values, expected, rtol=1e-15)

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
        np.testing.assert_allclose(container.published(dof, family), expected, rtol=1e-15)
        errors = [float(row[f"published_{column}_are_percent"] or np.nan) for row in FORCES[dof]]
        np.testing.assert_array_equal(container.published_error(dof, family), errors)

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

    def test_the_rigid_body_part_of_the_inertia_matrix_is_symmetric_and_positive(self, vessel_file):
        vessel = ps.load_vessel(vessel_file(r"^\[added_mass\][\s\S]*?(?=^\[coefficients.surge\])", ""))
        np.testing.assert_array_equal(vessel.inertia_matrix, vessel.inertia_matrix.T)
        assert (np.linalg.eigvalsh(vessel.inertia_matrix) > 0.0).all()

    def test_container_is_shipped(self):
        assert "container" in ps.shipped_vessels()


class TestText:
    """What a vessel shows of itself where a notebook or a debugger prints it."""

    def test_particulars_and_numbers_of_terms_stand_in_a_few_lines(self):
        lines = repr(ps.load_vessel("kvlcc2")).splitlines()
        assert lines[0].startswith("<Vessel 'kvlcc2': KVLCC2 tanker, 320 m, full load")
        assert lines[1:] == [
            "  L = 320 m, B = 58 m, d = 20.8 m, nominal speed 7.974 m/s",
            "  surge: 5 terms",
            "  sway: 10 terms",
            "  yaw: 10 terms",
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


class TestUsersFile:
    def test_a_copy_with_one_value_changed_differs_in_that_value_only(self, container, vessel_file):
        vessel = ps.load_vessel(vessel_file(r"^Yv = \{ value = -725e-5", "Yv = { value = -800e-5"))
        assert vessel.coefficients("sway").sel(coefficient="Yv") == -800e-5
        changed = vessel.coefficients("sway") != container.coefficients("sway")
        assert changed["coefficient"].values[changed].tolist() == ["Yv"]
        for dof in ("surge", "yaw", "roll"):
            assert vessel.coefficients(dof).identical(container.coefficients(dof))

    def test_plain_numbers_do_as_well_as_tables(self, vessel_file):
        vessel = ps.load_vessel(vessel_file(r"^Yv = .*$", "Yv = -0.007"))
        assert vessel.coefficients("sway").sel(coefficient="Yv") == -0.007

    def test_a_vessel_without_roll_needs_nothing_of_roll(self, tmp_path):
        path = tmp_path / "barge.toml"
        path.write_text(
            'name = "barge"\n'
            "[particulars]\nL = 100\nB = 20.0\nvolume = 6000.0\nnominal_speed = 5.0\nrudder_rate_deg = 3\nx_G = 1.0\n"
            "[inertia]\nm = 0.012\nI_zz = 0.0007\n"
            "[coefficients.surge]\nXu = -0.002\n"
            "[coefficients.sway]\nYv = -0.01\nYdelta = 0.002\n"
            "[coefficients.yaw]\nNr = -0.002\nNdelta = -0.001\n"
        )
        vessel = ps.load_vessel(path)
        assert vessel.dofs == ("surge", "sway", "yaw")
        assert vessel.terms("sway") == ("v", "delta")
        assert vessel.title == "barge"
        expected = [[0.012, 0, 0, 0], [0, 0.012, 0.00012, 0], [0, 0.00012, 0.0007, 0], [0, 0, 0, 1]]
        np.testing.assert_allclose(vessel.inertia_matrix, expected, rtol=1e-15)
        with pytest.raises(ps.VesselError, match="surge, sway, yaw; found 'roll'"):
            vessel.coefficients("roll")

    def test_with_coefficients_changes_values_and_nothing_else(self, container):
        twice = container.with_coefficients({"yaw": 2.0 * container.coefficients("yaw").values})
        np.testing.assert_array_equal(twice.coefficients("yaw"), 2.0 * container.coefficients("yaw"))
        assert twice.coefficients("sway").identical(container.coefficients("sway"))
        assert twice.terms("yaw") == container.terms("yaw")
        with pytest.raises(ps.VesselError, match="yaw of 'container' has 28 coefficients, found 3 values"):
            container.with_coefficients({"yaw": np.zeros(3)})


class TestErrors:
    def test_an_unknown_vessel_names_the_known_ones(self):
        with pytest.raises(ps.VesselError, match=r"container.*found 'tanker'"):
            ps.load_vessel("tanker")

    @pytest.mark.parametrize(
        ("pattern", "replacement", "key"),
        [
            (r"^name =", 'colour = "red"\nname =', "unknown key colour"),
            (r"^L =", "length = 3.0\nL =", "unknown key particulars.length"),
            (r"^m =", "mass = 3.0\nm =", "unknown key inertia.mass"),
            (r"^Xudot =", "Xvdot = 3.0\nXudot =", "unknown key added_mass.Xvdot"),
            (r"^\[coefficients.roll\]", "[coefficients.heave]", "unknown key coefficients.heave"),
            (r"^L = 230.66", "L = { value = 230.66, unit = 'm' }", "unknown key particulars.L.unit"),
            (r"^Xudot = \{", "Xudot = { sing = 1,", "unknown key added_mass.Xudot.sing"),
            (r"^Yv = \{", "Yv = { sing = 1,", "unknown key coefficients.sway.Yv.sing"),
        ],
    )
    def test_an_unknown_key_is_named_with_its_place(self, vessel_file, pattern, replacement, key):
        assert key in error_of(vessel_file(pattern, replacement))

    @pytest.mark.parametrize(
        ("pattern", "key"),
        [
            (r"^name = .*$", "name"),
            (r"^L = .*$", "particulars.L"),
            (r"^rudder_rate_deg = .*$", "particulars.rudder_rate_deg"),
            (r"^x_G = .*$", "particulars.x_G"),
            (r"^z_G = .*$", "particulars.z_G"),
            (r"^GM = .*$", "particulars.GM"),
            (r"^m = .*$", "inertia.m"),
            (r"^I_xx = .*$", "inertia.I_xx"),
            (r"^\[coefficients.surge\][\s\S]*?(?=^\[coefficients.sway\])", "coefficients.surge"),
            (r"^\[coefficients.yaw\][\s\S]*?(?=^\[coefficients.roll\])", "coefficients.yaw"),
            (r"value = -725e-5, ", "coefficients.sway.Yv.value"),
        ],
    )
    def test_a_missing_key_is_named_with_its_place(self, vessel_file, pattern, key):
        assert f"{key} is missing" in error_of(vessel_file(pattern, ""))

    @pytest.mark.parametrize("value", ["nan", "inf", "-inf", "true", '"12.7"', "[12.7]", "2026-01-01", "1" + 400 * "0"])
    @pytest.mark.parametrize(
        ("pattern", "key"),
        [
            ("^nominal_speed = ", "particulars.nominal_speed"),
            ("^I_zz = ", "inertia.I_zz"),
            ("^Nrdot = ", "added_mass.Nrdot"),
            ("^Nrdot = { value = ", "added_mass.Nrdot.value"),
            ("^Yv = ", "coefficients.sway.Yv"),
            ("^Yv = { value = ", "coefficients.sway.Yv.value"),
            ("^Yv = { .* published = { conjugate = ", "coefficients.sway.Yv.published.conjugate"),
        ],
    )
    def test_a_value_that_is_no_finite_number_is_named_with_its_place(self, vessel_file, pattern, key, value):
        line = re.search(f"{pattern}(.*)$", CONTAINER.read_text(), flags=re.MULTILINE)
        kept = line[0].removesuffix(line[1])
        rest = line[1][line[1].index(",") :] if pattern.count("{") == 1 else ""
        rest = " } }" if pattern.count("{") == 2 else rest
        message = error_of(vessel_file(re.escape(line[0]), f"{kept}{value}{rest}"))
        assert f"{key} must be a finite number" in message

    @pytest.mark.parametrize("key", ["L", "B", "volume", "nominal_speed", "rudder_rate_deg"])
    def test_a_particular_that_cannot_be_negative(self, vessel_file, key):
        assert f"particulars.{key} must be positive, found -1.0" in error_of(
            vessel_file(rf"^{key} = .*$", f"{key} = -1")
        )

    @pytest.mark.parametrize(("d", "block"), [(-10.0, "-0.624"), (6.0, "1.04")])
    def test_a_draught_at_which_the_hull_is_fuller_than_its_box(self, vessel_file, d, block):
        assert ps.load_vessel(vessel_file(r"^B = 32.0 ", "d = 6.3\nB = 32.0 ")).particulars.d == 6.3
        assert f"found d = {d} with a block coefficient of {block}; correct it." in error_of(
            vessel_file(r"^B = 32.0 ", f"d = {d}\nB = 32.0 ")
        )

    @pytest.mark.parametrize("term", ["Yw", "Yv|v", "Y", "Yvbeta", '"Yv v"'])
    def test_an_unknown_term_is_named(self, vessel_file, term):
        message = error_of(vessel_file(r"^Yv =", f"{_quoted(term)} = 1.0\nYv ="))
        assert f"coefficients.sway.{term.strip(chr(34))} is no coefficient" in message

    def test_a_wrong_first_letter_is_named(self, vessel_file):
        message = error_of(vessel_file(r"^Yv =", "Nv ="))
        assert "coefficients.sway.Nv must begin with Y" in message

    def test_a_force_without_coefficients(self, vessel_file):
        path = vessel_file(r"^\[coefficients.yaw\][\s\S]*?(?=^\[coefficients.roll\])", "[coefficients.yaw]\n")
        assert "coefficients.yaw is empty" in error_of(path)

    @pytest.mark.parametrize(
        ("pattern", "replacement", "key"),
        [
            (r"^\[inertia\][\s\S]*?(?=^\[added_mass\])", "", "inertia is missing"),
            (r"^\[particulars\]", "[[particulars]]", "particulars must be a table"),
            (r"^\[coefficients.roll\][\s\S]*", "[coefficients]\nroll = 3", "coefficients.roll must be a table"),
            (r"published = \{[^}]*\}", "published = 3", "published must be a table"),
            (r"^name = .*$", "name = 3", "name must be a text"),
            (r"^sources = \[", "sources = [3,", "sources must be a list of texts"),
        ],
    )
    def test_a_value_in_place_of_a_table_or_text(self, vessel_file, pattern, replacement, key):
        assert key in error_of(vessel_file(pattern, replacement))

    def test_an_inertia_matrix_that_cannot_be_inverted(self, vessel_file):
        message = error_of(vessel_file(r"^Xudot = .*$", "Xudot = 750.81e-5"))
        assert "inertia matrix must be invertible" in message

    def test_files_that_cannot_be_read(self, tmp_path):
        assert "cannot be read: No such file" in error_of(tmp_path / "absent.toml")
        (tmp_path / "folder.toml").mkdir()
        assert "cannot be read: Is a directory" in error_of(tmp_path / "folder.toml")

    @pytest.mark.parametrize(
        "content", [b"name = ", b"[particulars\n", b"L = 1\nL = 2\n", b"\xff\xfe\x00", b"a = 1\x00"]
    )
    def test_files_that_are_not_toml(self, tmp_path, content):
        path = tmp_path / "broken.toml"
        path.write_bytes(content)
        assert "is not valid TOML" in error_of(path)


def _quoted(key):
    return key if key.startswith('"') else f'"{key}"'
