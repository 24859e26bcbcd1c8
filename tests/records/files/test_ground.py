from __future__ import annotations

import numpy as np
import pytest

from pymc_ship.machine.errors import TrialError
from tests.records.files.cases import columns, written
from tests.sentences import refused

LATITUDE, LONGITUDE = 53.5, 8.1  # deg
RADIUS = 6.378137e6  # m, WGS 84
FLATTENING = 1.0 / 298.257223563


def fixes(x, y):
    """Latitude and longitude [deg] by the radii of curvature of the ellipsoid, to first order."""
    e2, sine = FLATTENING * (2.0 - FLATTENING), np.sin(np.deg2rad(LATITUDE))
    across = RADIUS / np.sqrt(1.0 - e2 * sine**2)
    along = across * (1.0 - e2) / (1.0 - e2 * sine**2)
    longitude = LONGITUDE + np.rad2deg(y / (across * np.cos(np.deg2rad(LATITUDE))))
    return LATITUDE + np.rad2deg(x / along), longitude


def received(run):
    """Table of a gyro, a rudder indicator and a satellite receiver."""
    u, v, psi = (run[name].values for name in ("u", "v", "psi"))
    flow = (u + 1j * v) * np.exp(1j * psi)
    latitude, longitude = fixes(run["x"].values - run["x"].values[0], run["y"].values - run["y"].values[0])
    return {
        "time": run["time"].values,
        "SOG [kn]": np.abs(flow) * 3600.0 / 1852.0,
        "COG [deg]": np.rad2deg(np.angle(flow)) % 360.0,
        "HDT [deg]": np.rad2deg(psi) % 360.0,
        "RSA [deg]": -np.rad2deg(run["delta"].values),
        "Latitude [deg]": latitude,
        "lon [degrees_east]": longitude,
    }


def test_a_receiver_gives_velocities_and_track(run, read):
    trial = read(written(received(run)))
    for name in ("u", "v", "psi", "delta"):
        np.testing.assert_allclose(trial[name], run[name], atol=1e-9, err_msg=name)
    for name in ("x", "y"):
        np.testing.assert_allclose(trial[name], run[name] - run[name][0], atol=0.05, err_msg=name)
    assert trial.attrs["speeds"] == "over ground"
    assert (
        "x, y from latitude and longitude, origin 53.500000, 8.100000 deg; flat to 0.001 m." in trial.attrs["reading"]
    )


def test_a_log_precedes_the_receiver(run, read):
    trial = read(written(received(run) | {"STW [m/s]": run["u"].values}))
    np.testing.assert_array_equal(trial["u"], run["u"])
    assert "speeds" not in trial.attrs


@pytest.mark.parametrize(("latitude", "words"), [(5000.0, "90"), (60.0, "100")])
def test_positions_of_no_trial_are_refused(run, read, latitude, words):
    table = received(run)
    table["Latitude [deg]"][3] = latitude
    with refused(TrialError, float(words)):
        read(written(table))


def test_all_missing_units_are_named_at_once(run, read):
    table = {"time": run["time"].values, "HDT": run["psi"].values, "SOG": run["u"].values, "RSA": run["delta"].values}
    with refused(TrialError, "HDT", "SOG", "RSA"):
        read(written(table))


def test_a_file_without_a_header_is_named(run, read):
    text = "\n".join(written(columns(run)).splitlines()[1:-1])
    with refused(TrialError, "header"):
        read(text)


def test_columns_of_the_esso_osaka_records_are_known(run, read):
    names = ["t [s]", "u_velo [m/s]", "vm_velo [m/s]", "r_angvelo [rad/s]", "p", "phi", "psi_hat [rad]"]
    names += ["x_position_mid [m]", "y_position_mid [m]", "delta_rudder [rad]"]
    trial = read(written(columns(run), header=names))
    for name in ("u", "v", "r", "psi", "x", "y", "delta"):
        np.testing.assert_array_equal(trial[name], run[name])
