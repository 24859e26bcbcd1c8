from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import pymc_ship as ps
from tests.sentences import refused

CONTAINER = Path(__file__).parents[3] / "models" / "container.toml"


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
            "[added_mass]\nXudot = -0.001\nYvdot = -0.01\nNrdot = -0.0005\n"
            "[coefficients.surge]\nXu = -0.002\n"
            "[coefficients.sway]\nYv = -0.01\nYdelta = 0.002\n"
            "[coefficients.yaw]\nNr = -0.002\nNdelta = -0.001\n"
        )
        vessel = ps.load_vessel(path)
        assert vessel.dofs == ("surge", "sway", "yaw")
        assert vessel.terms("sway") == ("v", "delta")
        assert vessel.title == "barge"
        expected = [[0.013, 0, 0, 0], [0, 0.022, 0.00012, 0], [0, 0.00012, 0.0012, 0], [0, 0, 0, 1]]
        np.testing.assert_allclose(vessel.inertia_matrix, expected, rtol=1e-15)
        with refused(ps.VesselError, "roll"):
            vessel.coefficients("roll")


class TestErrors:
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
            (r"^I_xx = .*$", "inertia.I_xx"),
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
        before = line[0].removesuffix(line[1])
        rest = line[1][line[1].index(",") :] if pattern.count("{") == 1 else ""
        rest = " } }" if pattern.count("{") == 2 else rest
        message = error_of(vessel_file(re.escape(line[0]), f"{before}{value}{rest}"))
        assert f"{key} must be a finite number" in message

    @pytest.mark.parametrize("term", ["Yw", "Yv|v", "Y", "Yvbeta", '"Yv v"'])
    def test_an_unknown_term_is_named(self, vessel_file, term):
        message = error_of(vessel_file(r"^Yv =", f"{_quoted(term)} = 1.0\nYv ="))
        assert f"coefficients.sway.{term.strip(chr(34))} must name a coefficient" in message

    @pytest.mark.parametrize(
        ("first", "second"), [("Yvvr", "Yvrv"), ("Yr|p|", "Y|p|r"), ("Yupp", "Y0upp"), ("Y|vr|", "Y|r||v|")]
    )
    def test_two_spellings_of_a_term_are_refused(self, vessel_file, first, second):
        own = re.search(rf"^\"?{re.escape(first)}\"? =", CONTAINER.read_text(), re.MULTILINE)
        lines = f"{_quoted(second)} = 1.0\nYv =" if own else f"{_quoted(first)} = 1.0\n{_quoted(second)} = 1.0\nYv ="
        message = error_of(vessel_file(r"^Yv =", lines))
        assert re.search(rf"(?<!\w){re.escape(second)}(?!\w)", message)
        assert re.search(rf"(?<!\w){re.escape(first)}(?!\w)", message)

    def test_a_wrong_first_letter_is_named(self, vessel_file):
        message = error_of(vessel_file(r"^Yv =", "Nv ="))
        assert "coefficients.sway.Nv must begin with Y" in message

    def test_a_force_without_coefficients(self, vessel_file):
        path = vessel_file(r"^\[coefficients.yaw\][\s\S]*?(?=^\[coefficients.roll\])", "[coefficients.yaw]\n")
        assert "coefficients.yaw is empty" in error_of(path)

    @pytest.mark.parametrize(
        ("pattern", "replacement", "key"),
        [
            (r"^\[inertia\][\s\S]*?(?=^\[added_mass\])", "", "inertia.I_xx is missing"),
            (r"^\[particulars\]", "[[particulars]]", "particulars must be a table"),
            (r"^\[coefficients.roll\][\s\S]*", "[coefficients]\nroll = 3", "coefficients.roll must be a table"),
            (r"published = \{[^}]*\}", "published = 3", "published must be a table"),
            (r"^name = .*$", "name = 3", "name must be a text"),
            (r"^L = 230.66", "L = { value = 230.66, source = 3 }", "particulars.L.source must be a text, found 3"),
            (r"^\[inertia\][^\n]*\nsource = .*$", "[inertia]\nsource = []", "inertia.source must be a text, found []"),
            (r"^Yv = \{", "Yv = { note = {}, ", "coefficients.sway.Yv.note must be a text, found {}"),
            (r"^sources = \[", "sources = [3,", "sources must be a list of texts"),
        ],
    )
    def test_a_value_in_place_of_a_table_or_text(self, vessel_file, pattern, replacement, key):
        assert key in error_of(vessel_file(pattern, replacement))

    def test_files_that_cannot_be_read(self, tmp_path):
        assert "cannot be read: No such file" in error_of(tmp_path / "absent.toml")
        (tmp_path / "folder.toml").mkdir()
        assert "cannot be read: Is a directory" in error_of(tmp_path / "folder.toml")

    @pytest.mark.parametrize("content", [b"name = ", b"[particulars\n", b"L = 1\nL = 2\n"])
    def test_files_that_are_not_toml(self, tmp_path, content):
        path = tmp_path / "broken.toml"
        path.write_bytes(content)
        assert "is not valid TOML" in error_of(path)

    @pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"a = 1\x00"])
    def test_files_that_are_not_utf_8(self, tmp_path, content):
        path = tmp_path / "broken.toml"
        path.write_bytes(content)
        assert "cannot be read: it is UTF-16 text" in error_of(path)


def _quoted(key):
    return key if key.startswith('"') else f'"{key}"'
