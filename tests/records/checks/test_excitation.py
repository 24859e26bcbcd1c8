"""What a record lacks before and during the run: a steady approach, turning, directions above the noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.records.checks.excitation import STEADY, _excitation
from tests.records.checks.cases import changed, checks_by_name, noisy, simulated


@pytest.mark.parametrize(
    ("name", "words"), [("r", "r is"), ("v", "v is"), ("phi", "phi is"), ("u", "the speed changes by")]
)
def test_an_approach_that_is_not_straight_or_steady_is_doubted(container, approached, name, words):
    straight = approached["time"].values <= 40.0
    largest = np.abs(approached[name].values).max()
    slope = np.linspace(-1.0, 0.0, straight.sum()) if name == "u" else 1.0
    values = approached[name].values + np.where(straight, 0.0, 0.0)
    values[straight] += 0.2 * largest * slope
    check = checks_by_name(changed(approached, **{name: values}), container)["approach"]
    assert check.verdict == "doubtful"
    assert words in check.sentence


def test_a_drift_on_the_approach_shows_beyond_the_error_of_its_mean(container, approached):
    """A fifth of the largest v, amid noise of 6 % of it."""
    v, straight = approached["v"].values.copy(), approached["time"].values <= 40.0
    largest = np.abs(v).max()
    v += 0.06 * largest * np.random.default_rng(2).standard_normal(v.size)
    v[straight] += 0.2 * largest
    assert "v is" in checks_by_name(changed(approached, v=v), container)["approach"].sentence


def test_a_trend_of_the_speed_counts_only_beyond_its_error(container, approached):
    """Noise of 1.5 m/s: its trends are of per cents in L/U and mean nothing."""
    changes = []
    for seed in range(5):
        u = approached["u"].values
        u = u + 1.5 * np.random.default_rng(seed).standard_normal(u.size)
        check = checks_by_name(changed(approached, u=u), container)["approach"]
        changes.append(abs(check.value("change of speed in L/U")))
        assert "the speed changes" not in check.sentence
    assert max(changes) > STEADY


@pytest.mark.parametrize(("noise_ratio", "expected"), [(0.4, 1.0), (0.8, 0.0)])
@pytest.mark.parametrize("size", [1, 9])
def test_the_noise_of_a_direction_is_that_of_the_mean_of_a_block(noise_ratio, expected, size):
    """One constant term amid white noise: significant where the noise of a block is below half of it."""
    noise = noise_ratio * np.sqrt(size) * np.random.default_rng(1).standard_normal((9000, 1))
    check = _excitation("yaw", ("v",), 1.0 + noise, size)
    assert check.value("directions above noise") == expected


def test_the_condition_number_is_that_of_the_forces(flat):
    """In SI, and without blocks: v U, r U and delta U^2 of a ship that loses speed in its turn."""
    trial = simulated(flat, ps.turning_circle(35.0))
    U = np.hypot(trial["u"].values, trial["v"].values)
    columns = np.column_stack([trial["v"].values * U, trial["r"].values * U, trial["delta"].values * U**2])
    expected = np.linalg.cond(columns / np.sqrt(np.mean(columns**2, axis=0)))
    assert checks_by_name(trial, flat)["excitation yaw"].value("condition number") == pytest.approx(expected, rel=0.05)


@pytest.mark.parametrize(("angle", "verdict"), [(15.0, "good"), (3.0, "doubtful"), (0.2, "bad")])
def test_a_run_that_hardly_turns_is_told(flat, angle, verdict):
    time = np.arange(0.0, 400.0, 40.0)
    programme = ps.rudder_programme(time, np.deg2rad(angle) * np.resize([1.0, 1.0, -1.0, -1.0], time.size))
    checks = checks_by_name(noisy(simulated(flat, programme), level=0.001), flat)
    assert checks["ranges"].verdict == verdict


def test_directions_above_the_noise_are_counted(flat, container):
    few = checks_by_name(noisy(simulated(flat, ps.zigzag(20.0, 20.0))), flat)
    assert all(few[f"excitation {dof}"].verdict == "good" for dof in flat.dofs)
    assert few["excitation yaw"].value("directions above noise") == 3.0
    turn = checks_by_name(noisy(simulated(container, ps.turning_circle(35.0)), level=0.1), container)["excitation sway"]
    assert turn.verdict in ("doubtful", "bad")
    assert turn.value("directions above noise") < 20.0
    assert turn.value("condition number") > 100.0 * few["excitation sway"].value("condition number")
    assert checks_by_name(simulated(flat, ps.zigzag(20.0, 20.0)))["excitation"].verdict == "not checked"


def test_terms_that_stay_zero_are_named(container, zigzag):
    still = changed(zigzag, p=0.0 * zigzag["p"].values + 1e-30)
    check = checks_by_name(still, container)["excitation roll"]
    assert check.verdict == "bad"
    assert "Kp" in check.sentence


def test_a_force_without_terms_is_not_judged(flat):
    unknown = replace(flat, forces=flat.forces | {"sway": (), "yaw": ()})
    trial = noisy(simulated(flat, ps.zigzag(20.0, 20.0)))
    checks, known = checks_by_name(trial, unknown), checks_by_name(trial, flat)
    for name in ("excitation sway", "excitation yaw"):
        check = checks.pop(name)
        assert (check.verdict, known.pop(name).verdict) == ("not checked", "good")
        assert "the vessel file has no terms of it" in check.sentence
    assert checks == known
