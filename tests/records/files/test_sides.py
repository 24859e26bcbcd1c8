from __future__ import annotations

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.machine.errors import TrialError
from pymc_ship.records.files import sides
from pymc_ship.records.files.sides import check_one_side, rudder_middle
from tests.records.files.cases import columns, written
from tests.records.files.rudder_sides import noisy_records, shown_side
from tests.sentences import refused


@pytest.fixture(scope="module")
def zigzag():
    return ps.simulate("kvlcc2", ps.zigzag(20, 20), duration=600, step=1.0)


def unstated(table, sign=1.0):
    """Text of a table without the line on the rudder."""
    return written({**table, "delta": sign * table["delta"]}).replace("# rudder_positive", "# note")


@pytest.mark.parametrize(("sign", "side"), [(1.0, "port"), (-1.0, "starboard")])
@pytest.mark.parametrize("dropped", [(), ("r",), ("psi", "u", "v", "x", "y")])
def test_the_side_is_that_of_the_record(run, read, sign, side, dropped):
    table = {name: values for name, values in columns(run).items() if name not in dropped}
    trial = read(unstated(table, sign))
    np.testing.assert_array_equal(trial["delta"], run["delta"])
    assert f"turns to {side} for positive angles, by" in trial.attrs["reading"]
    assert trial.attrs["rudder_positive"] == side


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_stated_side_needs_no_evidence(run, read, sign):
    table = columns(run.isel(time=slice(15)))
    text = unstated(table, sign)
    with refused(TrialError, "rudder_positive"):
        read(text)
    stated = {"frame": {"rudder_positive": "port" if sign > 0 else "starboard"}}
    np.testing.assert_array_equal(read(text, format=stated)["delta"], table["delta"])


def test_files_of_this_package_state_their_side(run, read, tmp_path):
    short = run.isel(time=slice(15))
    back = ps.read_trial(ps.write_trial(short, tmp_path / "run.csv"))
    np.testing.assert_array_equal(back["delta"], short["delta"])
    opposite = {"frame": {"rudder_positive": "starboard"}}  # the format precedes the file
    np.testing.assert_array_equal(ps.read_trial(tmp_path / "run.csv", format=opposite)["delta"], -short["delta"])


@pytest.mark.parametrize("delta", [0.0, np.deg2rad(0.5)])
def test_a_rudder_amidships_shows_nothing(read, delta):
    """A straight run with an offset gyro, whose constant rudder correlates with the rate."""
    table = {"time": np.arange(200.0), "u": np.full(200, 5.0), "r": np.full(200, 1e-4), "delta": np.full(200, delta)}
    text = unstated(table)
    if delta:
        with refused(TrialError, "rudder_positive"):
            read(text)
    else:
        assert not read(text)["delta"].values.any()


@pytest.mark.parametrize(("scale", "middle"), [(1.0 / 20.0, 2.5), (8.0 / 45.0, 12.0), (-2048.0 / 70.0, 2048.0)])
@pytest.mark.parametrize("dropped", [(), ("r",)])
def test_a_rudder_in_volts_milliamperes_or_counts_is_named(zigzag, read, scale, middle, dropped):
    """Without the middle the refusal would ask for a side, which does not help."""
    raw = zigzag.assign(delta=("time", np.deg2rad(np.rad2deg(zigzag["delta"].values) * scale + middle)))
    found = rudder_middle(raw)
    assert found == pytest.approx(middle, rel=0.03)
    table = {name: values for name, values in columns(raw).items() if name not in dropped}
    with refused(TrialError, float(f"{found:.3g}")):
        read(unstated(table))


def test_a_rudder_about_zero_to_one_side_or_without_its_sign_is_no_raw_signal(zigzag):
    delta = zigzag["delta"].values
    circle = ps.simulate("kvlcc2", ps.turning_circle(35), duration=900, step=1.0)
    others = [zigzag.assign(delta=("time", values)) for values in (np.abs(delta), delta + 0.03)]
    steps = np.deg2rad([5.0, 20.0, 8.0, 25.0, 6.0, 15.0, 5.0, 20.0])
    one_side = ps.simulate("container", ps.rudder_programme(75.0 * np.arange(8.0), steps), duration=600, step=1.0)
    for trial in (zigzag, circle, one_side, *others):
        assert rudder_middle(trial) == 0.0


def test_records_of_one_logger_agree(run, read):
    one, other = (read(unstated(columns(run), sign)) for sign in (1.0, -1.0))
    check_one_side({"a.csv": one, "b.csv": one})
    with refused(TrialError, "b.csv"):
        check_one_side({"a.csv": one, "b.csv": other, "c.csv": one})


def test_no_noisy_record_shows_the_wrong_side():
    """A seventh of ``python -m tests.records.files.rudder_sides``."""
    sides = [shown_side(trial) for _, trial in noisy_records(1, every=7)]
    assert len(sides) > 40
    assert "starboard" not in sides
    assert sides.count("") < 0.05 * len(sides)


def test_half_a_standard_error_would_show_wrong_sides(run, monkeypatch):
    """The broken twin: a rudder and a rate without connection."""
    rng = np.random.default_rng(3)
    noise = [
        run.assign({name: ("time", 1e-3 * rng.standard_normal(run.sizes["time"])) for name in ("r", "delta")})
        for _ in range(20)
    ]
    assert {shown_side(trial) for trial in noise} == {""}
    monkeypatch.setattr(sides, "SIGNIFICANT", 0.5)
    assert {"port", "starboard"} <= {shown_side(trial) for trial in noise}
