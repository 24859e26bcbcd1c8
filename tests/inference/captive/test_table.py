"""Reading of captive tests."""

import warnings

import numpy as np
import pytest

import pymc_ship as ps
from tests.sentences import refused

HEADER = "beta(deg),delta(deg),r,Speed(m/s),rps,X',Y',N'"
ROWS = ("0,10,0,7.974,1.5,-1e-4,5e-4,-3e-4", "8,0,0.3,7.974,1.5,-2e-4,3e-3,1e-3")


def test_a_row_is_a_motion_and_its_forces(read):
    tests = read()
    U, beta = 7.974, np.deg2rad(8.0)
    np.testing.assert_allclose(tests["u"], [U, U * np.cos(beta)])
    np.testing.assert_allclose(tests["v"], [0.0, -U * np.sin(beta)])
    np.testing.assert_allclose(tests["r"], [0.0, 0.3 * U / 320.0])
    np.testing.assert_allclose(tests["delta"], np.deg2rad([10.0, 0.0]))
    np.testing.assert_allclose(tests["n"], 1.5)
    np.testing.assert_allclose(tests["N"], [-3e-4, 1e-3])


def test_a_model_is_brought_to_full_scale(read):
    tests = read(
        "8,0,0.3,1.2,9.9,-1e-4,3e-3,1e-3", "8,0,0.2,1.2,9.9,-1e-4,3e-3,1e-3", format={"scale": {"froude": 49.0}}
    )
    assert np.hypot(tests["u"], tests["v"]).values[0] == pytest.approx(8.4)
    assert tests["n"].values[0] == pytest.approx(9.9 / 7.0)
    assert tests["r"].values[0] == pytest.approx(0.3 * 8.4 / 320.0)


def test_a_yaw_rate_with_a_unit_is_of_the_model(read):
    tests = read(
        "0,3.0,1.2,3e-3,1e-3",
        "0,2.0,1.2,3e-3,1e-3",
        header="beta [deg],r [deg/s],speed [m/s],Y',N'",
        format={"scale": {"froude": 49.0}},
    )
    np.testing.assert_allclose(tests["r"], np.deg2rad([3.0, 2.0]) / 7.0)
    assert "n" not in tests
    assert "X" not in tests


def test_signs_area_and_reference_point_of_a_format(read):
    plain = read()
    layout = {"frame": {"rudder_positive": "starboard", "forces": "Ld", "reference": 16.0}}
    tests, slender = read(format=layout), 20.8 / 320.0
    np.testing.assert_allclose(tests["delta"], -plain["delta"])
    np.testing.assert_allclose(tests["v"], plain["v"] - 16.0 * plain["r"])
    turned = (plain["u"] ** 2 + plain["v"] ** 2) / (tests["u"] ** 2 + tests["v"] ** 2)
    np.testing.assert_allclose(tests["Y"], slender * plain["Y"] * turned)
    np.testing.assert_allclose(tests["N"], slender * (plain["N"] + 16.0 / 320.0 * plain["Y"]) * turned)


def test_rows_that_stand_there_twice_count_once(read):
    tests = read(*ROWS, ROWS[0])
    assert tests.sizes["test"] == 2
    assert "1 repeated rows" in tests.attrs["reading"]


def test_a_speed_in_knots_without_their_unit_is_refused(read):
    rows = ("0,15.5,3e-3", "8,15.5,2e-3")
    for unit in ("", " [m/s]"):
        with refused(ps.TrialError, "speed", 1.94):
            read(*rows, header=f"beta [deg],speed{unit},Y'")
    assert read(*rows, header="beta [deg],speed [kn],Y'").sizes["test"] == 2


def test_the_speed_of_a_model_needs_its_scale(read):
    rows = ("0,1.18,3e-3", "8,1.18,2e-3")
    with refused(ps.TrialError, "scale.froude", 1.18):
        read(*rows, header="beta [deg],speed [m/s],Y'")
    for froude in (46.4, 1.0):
        tests = read(*rows, header="beta [deg],speed [m/s],Y'", format={"scale": {"froude": froude}})
        assert tests["u"].values[0] == pytest.approx(1.18 * np.sqrt(froude))


@pytest.mark.parametrize("header", ["v [m/s],speed,Y'", "v [m/s],beta [deg],Y'"])
def test_a_velocity_of_sway_is_no_speed(read, header):
    with refused(ps.TrialError, "v"):
        read("7.9,7.9,3e-3", "7.9,7.8,2e-3", header=header)
    assert read("7.9,0,3e-3", "7.9,8,2e-3", header="V [m/s],beta [deg],Y'").sizes["test"] == 2


def test_a_speed_of_zero_is_refused_without_a_warning(read):
    with warnings.catch_warnings(), refused(ps.TrialError, "speed", 0):
        warnings.simplefilter("error")
        read("0,7.9,3e-3", "8,0,2e-3", header="beta [deg],speed,Y'")
