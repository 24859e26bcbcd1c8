"""A sensor that the package does not know is one entry of the table of channels, made outside the package."""

from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.trial.channels import CHANNELS, Channel
from pymc_ship.trial.units import RADIAN, Unit
from tests.sentences import refused

ACCELERATION = Unit("m/s2", {"m/s2": 1.0, "ms-2": 1.0, "g": 9.80665}, froude=0.0)
NEW = (
    Channel(
        "a_y",
        ACCELERATION,
        "lateral acceleration a_y",
        headings=("lateral acceleration", "sway acceleration"),
        noise_factor=0.5,
        denoised=True,
    ),
    Channel("gamma_a", RADIAN, "wind vane γ", headings=("wind vane", "apparent wind angle")),
    Channel("head", Unit("m2", {"m2": 1.0}, froude=2.0), "head of the log"),
)


@pytest.fixture
def default_channels():
    """The channels of the package and three more; the new ones are gone after the test."""
    before = dict(CHANNELS)
    for channel in NEW:
        ps.register_channel(channel)
    yield
    CHANNELS.clear()
    CHANNELS.update(before)


@pytest.fixture
def trial(default_channels, container):
    """20/20 zigzag whose record has the new channels, too."""
    run = ps.simulate(container, ps.zigzag(20.0, 20.0), duration=60.0, step=0.1, method="rk4")
    time = run["time"].values
    run = run.drop_vars([name for name in run.data_vars if name not in CHANNELS])
    values = {"a_y": np.gradient(run["v"].values, time), "gamma_a": 0.5 + 0.1 * np.sin(time), "head": 2.0 + time / 60.0}
    return run.assign({name: ("time", row, {"units": CHANNELS[name].unit.name}) for name, row in values.items()})


def file(tmp_path, text):
    path = tmp_path / "run.csv"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("heading", "channel", "factor"),
    [
        ("a_y", "a_y", 1.0),
        ("a_y [g]", "a_y", 9.80665),
        ("a_y_g", "a_y", 9.80665),
        ("Lateral acceleration (m/s2)", "a_y", 1.0),
        ("Wind vane [deg]", "gamma_a", np.pi / 180.0),
        ("gamma_a", "gamma_a", 1.0),
    ],
)
def test_its_column_is_read_by_heading_and_unit(default_channels, tmp_path, heading, channel, factor):
    trial = ps.read_trial(file(tmp_path, f"time,u,{heading}\n0,5,1\n1,5,2\n2,5,4\n"))
    np.testing.assert_array_equal(trial[channel], factor * np.array([1.0, 2.0, 4.0]))
    assert trial[channel].attrs["units"] == CHANNELS[channel].unit.name


def test_without_its_entry_it_is_left_out(tmp_path):
    trial = ps.read_trial(file(tmp_path, "time,u,a_y [g]\n0,5,1\n1,5,2\n2,5,4\n"))
    assert list(trial.data_vars) == ["u"]
    assert trial.attrs["reading"] == "Columns left out: a_y [g]."


def test_a_word_of_it_must_state_its_unit(default_channels, tmp_path):
    with refused(ps.TrialError, "vane", "[deg]"):
        ps.read_trial(file(tmp_path, "time,u,Wind vane\n0,5,1\n1,5,2\n"))


def test_a_format_names_its_column_and_its_unit(default_channels, tmp_path):
    path = file(tmp_path, "time,u,MRU 3\n0,5,1\n1,5,2\n")
    chosen = {"column": "MRU 3", "unit": "g", "sign": -1, "offset": 0.5}
    trial = ps.read_trial(path, format={"columns": {"a_y": chosen}})
    np.testing.assert_allclose(trial["a_y"], 9.80665 * np.array([-0.5, -1.5]))
    with refused(ps.TrialError, "columns.a_y.unit", "m/s2", "kn"):
        ps.read_trial(path, format={"columns": {"a_y": chosen | {"unit": "kn"}}})


def test_it_is_scaled_to_the_ship(default_channels, tmp_path):
    path = file(tmp_path, "time,u,a_y,gamma_a,head\n0,5,1,0.1,2\n1,5,2,0.2,3\n")
    model, ship = ps.read_trial(path), ps.read_trial(path, format={"scale": {"froude": 4.0}})
    for name, factor in {"u": 2.0, "a_y": 1.0, "gamma_a": 1.0, "head": 16.0}.items():
        np.testing.assert_array_equal(ship[name], factor * model[name])


def test_it_is_written_and_read_back(trial, tmp_path):
    back = ps.read_trial(ps.write_trial(trial, tmp_path / "run.csv"))
    assert list(back.data_vars)[-3:] == ["a_y", "gamma_a", "head"]
    for name in back.data_vars:
        np.testing.assert_array_equal(back[name], trial[name])
    assert back.attrs["reading"] == ""


def test_it_is_polluted_by_its_factor(trial):
    polluted = ps.pollute(trial, level=0.1, rng=np.random.default_rng(1))
    sd = 0.1 * 0.5 * float(np.abs(trial["a_y"]).max())
    assert polluted.attrs["noise_sd_a_y"] == pytest.approx(sd)
    assert float((polluted["a_y"] - trial["a_y"]).std()) == pytest.approx(sd, rel=0.15)
    np.testing.assert_array_equal(polluted["gamma_a"], trial["gamma_a"])


def test_its_noise_leaves_that_of_the_others_as_it_was(trial, monkeypatch):
    polluted = ps.pollute(trial, level=0.1, rng=np.random.default_rng(1))
    monkeypatch.delitem(CHANNELS, "a_y")
    without = ps.pollute(trial, level=0.1, rng=np.random.default_rng(1))
    for name in ("u", "v", "r", "p", "phi", "psi"):
        np.testing.assert_array_equal(polluted[name], without[name])


def test_it_is_denoised_and_shown(trial, tmp_path, capsys):
    path = ps.write_trial(ps.pollute(trial, level=0.1, rng=np.random.default_rng(1)), tmp_path / "run.csv")
    assert main(["denoise", str(path), "--out", str(tmp_path / "smooth.csv"), "--quiet"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()[1:]]
    assert [row[0] for row in rows] == ["channel", "u", "v", "r", "p", "phi", "psi", "a_y"]
    assert rows[-1][-1] == "m/s2"
    noisy, smooth = ps.read_trial(path), ps.read_trial(tmp_path / "smooth.csv")
    misfits = [float(np.sqrt(np.mean((record["a_y"] - trial["a_y"]) ** 2))) for record in (noisy, smooth)]
    assert misfits[1] < 0.5 * misfits[0]
    np.testing.assert_array_equal(smooth["gamma_a"], noisy["gamma_a"])


def test_it_has_a_label(default_channels):
    assert CHANNELS["a_y"].axis == "lateral acceleration a_y [m/s2]"
    assert CHANNELS["gamma_a"].short_axis == "wind vane γ [deg]"
    assert CHANNELS["gamma_a"].unit.display_factor == np.rad2deg(1.0)


def test_it_does_not_disturb_checks_and_fits(trial, container):
    plain = trial.drop_vars([channel.name for channel in NEW])
    assert ps.trial_checks(trial, container) == ps.trial_checks(plain, container)
    data = [ps.regression_data(one, container, "sway") for one in (trial, plain)]
    np.testing.assert_array_equal(data[0].design_matrix, data[1].design_matrix)


def test_a_trajectory_is_fitted_to_states_alone(trial, container):
    rng = np.random.default_rng(1)
    with refused(ps.TrialError, "a_y", "rk4"):
        ps.trajectory_posterior([trial], container, channels=["u", "a_y"], draws=40, rng=rng)
