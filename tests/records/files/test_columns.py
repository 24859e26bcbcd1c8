from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.records.files.columns import matched_columns
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
    ("heading", "factor"), [("Time", 1), ("t", 1), ("t [ms]", 1e-3), ("Time (min)", 60), ("time_s", 1)]
)
def test_time_is_understood(heading, factor):
    columns, _ = matched_columns([heading, "u"], ["", ""], {}, "run.csv")
    assert columns["time"].factor == factor


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
