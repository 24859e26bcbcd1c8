from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.machine.errors import TrialError
from pymc_ship.records.files.columns import is_from_true_north, matched_columns, receiver_stand_ins
from pymc_ship.trial.channels import file_columns
from pymc_ship.trial.units import METRE
from tests.sentences import refused

DEG, KNOT = np.pi / 180.0, 1852.0 / 3600.0


def matched(*headings, units=None, **chosen):
    """Columns and remarks of a header behind the time."""
    headings = ("time", *headings)
    return matched_columns(headings, ["", *units] if units else [""] * len(headings), chosen, "run.csv")


@pytest.mark.parametrize(
    ("heading", "channel", "factor"),
    [
        ("u", "u", 1.0),
        ("u [m/s]", "u", 1.0),
        ("U kn", "u", KNOT),
        ("v_kn", "v", KNOT),
        ("v (km/h)", "v", 1.0 / 3.6),
        ("psi (deg)", "psi", DEG),
        ("PSI [°]", "psi", DEG),
        ("ψ [deg]", "psi", DEG),
        ("psi/deg", "psi", DEG),
        ("delta_deg", "delta", DEG),
        ("r_deg/s", "r", DEG),
        ("r [°/s]", "r", DEG),
        ("r_deg_s", "r", DEG),
        ("yaw_rate_deg_s", "r", DEG),
        ("Yaw rate [deg/s]", "r", DEG),
        ("ROT [deg/min]", "r", DEG / 60.0),
        ("p {rad/s}", "p", 1.0),
        ("Heading (deg)", "psi", DEG),
        ("yaw [deg]", "psi", DEG),
        ("yaw [deg/s]", "r", DEG),
        ("Roll angle (deg)", "phi", DEG),
        ("roll [deg/s]", "p", DEG),
        ("Rudder, deg", "delta", DEG),
        ("Surge velocity [m s-1]", "u", 1.0),
        ("sway_kn", "v", KNOT),
        ("X [km]", "x", 1e3),
        ("Northing [m]", "x", 1.0),
        ("n", "n", 1.0),
        ("n [rpm]", "n", 1.0 / 60.0),
        ("rpm", "n", 1.0 / 60.0),
        ("Propeller rpm", "n", 1.0 / 60.0),
        ("thrust [kN]", "thrust", 1e3),
        ("Torque [kN m]", "torque", 1e3),
        ("yaw rate [degree s-1]", "r", DEG),
        ("yaw rate [degrees sec-1]", "r", DEG),
        ("yaw rate [radian s-1]", "r", 1.0),
        ("ROT [degrees/minute]", "r", DEG / 60.0),
        ("heading [degrees_true]", "psi", DEG),
        ("heading [°T]", "psi", DEG),
        ("heading [º]", "psi", DEG),
        ("STW [m/sec]", "u", 1.0),
        ("STW [metres per second]", "u", 1.0),
        ("STW [kmh]", "u", 1.0 / 3.6),
        ("STW [knt]", "u", KNOT),
        ("Northing [nautical miles]", "x", 1852.0),
        ("rpm [min-1]", "n", 1.0 / 60.0),
        ("shaft speed [s-1]", "n", 1.0),
        ("lat [degree_north]", "latitude", DEG),
        ("lon [degree_east]", "longitude", DEG),
        ("heading [0.1 deg]", "psi", 0.1 * DEG),
        ("rudder [0.1 deg]", "delta", 0.1 * DEG),
        ("heading [gon]", "psi", 0.9 * DEG),
        ("yaw rate [0.1 deg/s]", "r", 0.1 * DEG),
        ("ROT [0.1 deg/min]", "r", DEG / 600.0),
        ("psi_dot [deg/s]", "r", DEG),
        ("Speed Log [kn]", "u", KNOT),
        ("SpeedLog(kts)", "u", KNOT),
        ("Rudder feedback [deg]", "delta", DEG),
        ("Rudder Position (deg)", "delta", DEG),
        ("RUD [deg]", "delta", DEG),
    ],
)
def test_a_heading_is_understood(heading, channel, factor):
    columns, notes = matched(heading)
    assert list(columns) == ["time", channel]
    assert columns[channel].factor == pytest.approx(factor, rel=1e-15)
    assert columns[channel].si(np.array([2.0]))[0] == pytest.approx(2.0 * factor, rel=1e-15)
    assert notes == (
        [] if heading == channel else [f"Columns read: {channel} from {heading!r} in {columns[channel].unit}."]
    )


@pytest.mark.parametrize(
    ("heading", "factor"),
    [
        ("Time", 1),
        ("t", 1),
        ("t [ms]", 1e-3),
        ("Time (min)", 60),
        ("time_s", 1),
        ("Elapsed [s]", 1),
        ("Time since start [s]", 1),
        ("Clock [min]", 60),
    ],
)
def test_time_is_understood(heading, factor):
    columns, _ = matched_columns([heading, "u"], ["", ""], {}, "run.csv")
    assert columns["time"].factor == factor


@pytest.mark.parametrize("name", ["Time", "UTC", "DateTime", "Time of day", "Timestamp"])
@pytest.mark.parametrize(
    "bracket", ["UTC", "UTC+1", "CET", "local", "ISO 8601", "hh:mm:ss", "HH:MM:SS.sss", "dd/mm/yy hh:mm"]
)
def test_a_zone_or_a_pattern_is_no_unit_of_time(name, bracket):
    for heading, below in ((f"{name} ({bracket})", ""), (name, bracket)):
        columns, _ = matched_columns([heading, "u"], [below, "m/s"], {}, "run.csv")
        assert not columns["time"].stated
        chosen = {"time": {"column": heading}}
        assert not matched_columns([heading, "u"], [below, "m/s"], chosen, "run.csv")[0]["time"].stated
    with refused(TrialError, "psi", bracket.split(" ")[0]):
        matched(f"psi [{bracket}]")


@pytest.mark.parametrize(("letter", "write"), [("P", "P [rad/s]"), ("N", "N [rev/s]"), ("X", "X [m]")])
def test_a_capital_letter_needs_a_unit(letter, write):
    """P may be power, N the number of a row or the northing."""
    columns, notes = matched("u", "psi", letter)
    assert list(columns) == ["time", "u", "psi"]
    assert notes == [
        f"Columns left out: {letter} (a capital letter without a unit; for the channel {letter.lower()}, "
        f"write '{write}')."
    ]
    unit = write.split("[")[1][:-1]
    for columns, _ in (
        matched("psi", f"{letter} [{unit}]"),
        matched("psi", letter, units=["rad", unit]),
        matched("psi", letter.lower()),
        matched("psi", letter, **{letter.lower(): {"column": letter}}),
    ):
        assert set(columns) == {"time", "psi", letter.lower()}


def test_capital_letters_of_a_state_or_a_track_are_channels_together():
    columns, notes = matched("U", "V", "R", "X", "Y", "P", "N")
    assert list(columns) == ["time", "u", "v", "r", "x", "y"]
    assert "P (a capital" in notes[-1]


class TestSpeedOfTheShip:
    """V is its symbol by ITTC, and the sway velocity beside U."""

    @pytest.mark.parametrize(("heading", "unit"), [("V [kn]", ""), ("V_kn", ""), ("V", "kn")])
    def test_a_capital_v_with_a_unit_is_u_where_no_other_speed_is(self, heading, unit):
        columns, notes = matched(heading, "psi", units=[unit, ""])
        assert list(columns) == ["time", "u", "psi"]
        assert columns["u"].factor == KNOT
        assert f"'{heading}' taken as the speed of the ship" in notes[1]

    @pytest.mark.parametrize("pair", [("U [kn]", "V [kn]"), ("u", "v"), ("V [m/s]", "U [m/s]")])
    def test_in_a_pair_it_is_sway(self, pair):
        columns, notes = matched(*pair)
        assert list(columns) == ["time", "u", "v"]
        assert "speed of the ship" not in " ".join(notes)

    @pytest.mark.parametrize("other", ["u", "STW [kn]", "SOG [kn]"])
    def test_beside_another_speed_it_is_left_out(self, other):
        columns, notes = matched(other, "V [kn]")
        assert not {"v"} & set(columns)
        assert columns.get("u", columns.get("sog")).heading == other
        assert notes[-1] == "Columns left out: V [kn] (the speed of the ship; for the channel v, write 'v [m/s]')."

    def test_without_a_unit_it_is_left_out(self):
        for others, write in ((["u"], "for the channel v, write 'v [m/s]'"), ([], "write 'V [m/s]'")):
            columns, notes = matched("psi", *others, "V")
            assert set(columns) == {"time", "psi", *others}
            assert notes[-1].startswith("Columns left out: V (")
            assert write in notes[-1]

    def test_a_format_says_what_it_is(self):
        columns, _ = matched("psi", "V [kn]", v={"column": "V [kn]"})
        assert list(columns) == ["time", "v", "psi"]

    @pytest.mark.parametrize("symbol", ["u [m/s]", "r [deg/s]", "x [m]", "n [rpm]"])
    def test_a_symbol_as_written_precedes_its_capital(self, symbol):
        capital = symbol[0].upper() + symbol[1:]
        columns, notes = matched("psi", capital, symbol)
        assert columns[symbol[0]].heading == symbol
        assert f"Columns left out: {capital}" in notes[-1]


@pytest.mark.parametrize("heading", ["Heading (T)", "HDG(T)", "Heading [°T]", "Heading °T", "HDG (true)", "COG (T)"])
def test_a_true_direction_is_in_degrees(heading):
    columns, _ = matched("u", heading)
    assert columns["cog" if "COG" in heading else "psi"].factor == DEG
    assert is_from_true_north(heading)


@pytest.mark.parametrize("heading", ["Heading (T) [deg]", "True heading [deg]", "HDG_true_deg", "COG T [deg]"])
def test_a_true_direction_with_a_unit(heading):
    columns, _ = matched("u", heading)
    assert columns["cog" if "COG" in heading else "psi"].unit == "deg"
    assert is_from_true_north(heading)


@pytest.mark.parametrize(
    "heading",
    ["Heading (M)", "HDG(M)", "Heading [°M]", "HDM", "HDM [deg]", "Magnetic heading [deg]", "Heading (mag) [deg]"],
)
def test_a_magnetic_heading_needs_its_declination(heading):
    with refused(TrialError, *heading.split(" "), "psi", "offset"):
        matched("u", heading)
    columns, notes = matched("u", "HDT [deg]", heading)
    assert columns["psi"].heading == "HDT [deg]"
    assert heading in notes[-1]
    stated = {"column": heading, "unit": "deg", "offset": 2.5}
    columns, _ = matched("u", heading, psi=stated)
    assert columns["psi"].si(np.array([10.0]))[0] == pytest.approx(12.5 * DEG)
    assert not is_from_true_north(heading)


def test_degrees_and_minutes_in_one_number():
    """As NMEA 0183 writes them, 53 degrees and 29.9996 minutes."""
    columns, _ = matched("Latitude [ddmm.mmmm]", "Longitude [dddmm.mmmm]")
    cells = np.array([5329.9996, -5329.9996, 0.6, 12.0])
    for name in ("latitude", "longitude"):
        assert columns[name].choice() == {"column": columns[name].heading, "unit": "deg", "code": "ddmm"}
        np.testing.assert_allclose(
            columns[name].si(cells) / DEG, [53.49999333, -53.49999333, 0.01, 0.2], rtol=0.0, atol=1e-8
        )


def test_a_row_of_units_below_the_header():
    columns, notes = matched("Heading", "u", "x", units=["deg", "kn", ""])
    assert [columns[name].factor for name in ("psi", "u", "x")] == [DEG, KNOT, 1.0]
    assert notes == ["Columns read: u from 'u' in kn, psi from 'Heading' in deg."]


@pytest.mark.parametrize(
    "heading", ["current [kn]", "pitch [deg]", "x [N]", "P [kW]", "T [°C]", "surge [m]", "vibration", "u2"]
)
def test_columns_of_other_quantities_are_left_out_and_named(heading):
    columns, notes = matched("u", heading)
    assert list(columns) == ["time", "u"]
    assert notes == [f"Columns left out: {heading}."]


def test_a_unit_that_cannot_be_told_matters_only_where_no_other_column_has_the_channel():
    columns, notes = matched("ROT", "r", "Heading [gon]", "psi")
    assert [columns[name].heading for name in ("r", "psi")] == ["r", "psi"]
    assert notes == ["Columns left out: ROT, Heading [gon]."]


@pytest.mark.parametrize(
    ("heading", "words"),
    [("Speed (kts)", "STW"), ("SPEED", "SOG"), ("Ship speed [kn]", "STW"), ("Rudder stbd (°)", "if it is delta")],
)
def test_a_heading_that_may_be_a_channel_has_a_remark(heading, words):
    """Ship speed is no shaft speed, to which its letters are near."""
    _, notes = matched("psi [deg]", heading)
    assert words in notes[-1]
    assert "did you mean" not in notes[-1]
    _, notes = matched("psi [deg]", "STW [kn]", "delta [deg]", heading)
    assert notes[-1].endswith(f"left out: {heading}.")


def test_a_date_is_the_clock_where_no_other_column_is():
    def clock(*headings):
        return matched_columns(headings, [""] * len(headings), {}, "run.csv")[0]["time"].heading

    assert clock("psi [deg]", "Date") == "Date"
    assert clock("Date", "UTC", "psi [deg]") == "UTC"


def test_a_file_without_time_is_not_asked_about_another_channel():
    for headings, asked in ((("Zeit", "Ruder [deg]", "psi"), False), (("tyme", "psi"), True)):
        with refused(TrialError, "time") as caught:
            matched_columns(headings, [""] * len(headings), {}, "run.csv")
        assert ("did you mean" in str(caught.value)) == asked


def test_a_v_without_u_may_be_the_speed_of_the_ship():
    assert any("call it u" in note for note in matched("v [kn]", "psi [deg]")[1])
    assert not any("call it u" in note for note in matched("v [kn]", "u [kn]")[1])
    assert "u" in matched("Water speed (kn)")[0]


def test_two_columns_of_a_channel():
    """Neither is preferred unless it bears the very name; a format decides."""
    with refused(ps.TrialError, "psi", "yaw_deg"):
        matched("Heading [deg]", "yaw_deg")
    columns, notes = matched("Heading [deg]", "psi")
    assert columns["psi"].heading == "psi"
    assert notes == ["Columns left out: Heading [deg]."]
    columns, notes = matched("Heading [deg]", "yaw_deg", psi={"column": "yaw_deg"})
    assert columns["psi"].heading == "yaw_deg"
    assert notes == ["Columns read: psi from 'yaw_deg' in deg.", "Columns left out: Heading [deg]."]


def test_the_own_name_of_a_unit_is_among_its_spellings():
    assert all(channel.unit.factor(channel.unit.name) == 1.0 for channel in file_columns().values())
    assert METRE.factor("deg") is None


def test_channels_come_in_one_order():
    columns, _ = matched_columns(["delta", "v", "time", "u", "n"], [""] * 5, {}, "run.csv")
    assert list(columns) == ["time", "u", "v", "delta", "n"]


class TestStandInsOfReceivers:
    course = 350.0 + 15.0 * np.sin(np.linspace(0.0, 12.0, 400))

    def test_a_run_far_from_its_neighbours_is_one(self):
        cells = self.course % 360.0
        at = int(np.argmin(self.course))
        cells[at : at + 3] = 360.0
        assert {
            number: np.flatnonzero(found).tolist() for number, found in receiver_stand_ins("cog", cells).items()
        } == {360.0: [at, at + 1, at + 2]}

    @pytest.mark.parametrize("resolution", [0.1, 1.0])
    def test_north_is_none(self, resolution):
        cells = np.round(self.course / resolution) * resolution
        cells = np.where(cells > 360.0, cells - 360.0, cells)
        assert (cells == 360.0).any()
        assert receiver_stand_ins("cog", cells) == {}
        assert receiver_stand_ins("cog", np.where(np.arange(400) == 200, 360.0, 359.9)) == {}

    @pytest.mark.parametrize(
        ("name", "number", "value"),
        [("sog", 102.3, 15.0), ("latitude", 91.0, 53.5), ("longitude", 181.0, 8.1), ("psi", 511.0, 151.0)],
    )
    def test_other_numbers_and_cells_without_any(self, name, number, value):
        cells = value + 1e-3 * np.arange(100.0)
        cells[[3, 50, 98]], cells[49] = number, np.nan
        found = receiver_stand_ins(name, cells)
        assert np.flatnonzero(found.pop(number)).tolist() == [3, 50, 98]
        assert found == {}

    def test_a_ship_that_crosses_the_number_has_none(self):
        assert receiver_stand_ins("longitude", np.round(180.99 + 1e-4 * np.arange(200.0), 4)) == {}
        assert receiver_stand_ins("psi", np.round(480.0 + 0.5 * np.arange(200.0), 1)) == {}
