"""Checks of a trial: each finds its fault and keeps quiet without it; corrections give the trial back."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.checks.kinematics import earth_velocity
from pymc_ship.checks.record_quality import spikes
from pymc_ship.checks.trial_checks import failed_checks
from pymc_ship.checks.verdicts import VERDICTS, Check
from pymc_ship.cli.main import main
from pymc_ship.trial.record import CHANNELS

TERMS = ("Xu", "Xrr", "Xdeltadelta", "Yv", "Yv|v|", "Yr", "Ydelta", "Nv", "Nr", "Ndelta")
"""Ten coefficients of the container ship, without roll."""

INTERVAL = 0.2


@pytest.fixture(scope="module")
def flat(container):
    """A ship that does not roll."""
    forces = {
        dof: tuple(c for c in force if c.name in TERMS) for dof, force in container.forces.items() if dof != "roll"
    }
    return replace(container, name="flat", forces=forces)


def simulated(vessel, manoeuvre, duration=400.0):
    return ps.simulate(vessel, manoeuvre, duration=duration, record_interval=INTERVAL)


def noisy(trial, seed=1, level=0.01):
    return ps.pollute(trial, level=level, rng=np.random.default_rng(seed))


def steered(vessel, first=0.0, **settings):
    """Straight for 40 s, then the rudder goes to both sides for 50 s at a time; ``first`` [deg] is held till then."""
    time, delta = [0.0, 40.0], np.deg2rad([first, first]).tolist()
    for k, side in enumerate((1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0)):
        time += [40.1 + 50.0 * k, 90.0 + 50.0 * k]
        delta += [side * np.deg2rad(15.0)] * 2
    return simulated(vessel, ps.rudder_programme(time, delta, **settings))


@pytest.fixture(scope="module")
def approached(container):
    """Noisy trial with a straight approach."""
    return noisy(steered(container))


@pytest.fixture(scope="module")
def zigzag(container):
    """Noisy 20/20 zigzag."""
    return noisy(simulated(container, ps.zigzag(20.0, 20.0)))


@pytest.fixture(scope="module")
def circle(container):
    """Noisy 35 deg turn."""
    return noisy(simulated(container, ps.turning_circle(35.0), 600.0))


def changed(trial, **channels):
    """Trial with other values of some channels."""
    return trial.assign({name: ("time", np.asarray(values), trial[name].attrs) for name, values in channels.items()})


def with_samples(trial, name, where, values):
    """Trial with other values at some samples of a channel."""
    channel = trial[name].values.copy()
    channel[where] = values
    return changed(trial, **{name: channel})


def found(trial, vessel=None):
    return {check.name: check for check in ps.trial_checks(trial, vessel)}


def alarms(checks):
    """Names of the checks that something is the matter with, without excitation, which a single run rarely suffices."""
    wrong = {name for name, check in checks.items() if check.verdict in ("doubtful", "bad")}
    return {name for name in wrong if not name.startswith("excitation")}


# without a fault


@pytest.mark.parametrize("ship", ["container", "flat"])
@pytest.mark.parametrize("turn", [False, True])
def test_a_clean_noisy_trial_raises_no_alarm(request, ship, turn):
    vessel = request.getfixturevalue(ship)
    rudder = 35.0 if ship == "container" else 20.0
    manoeuvre = ps.turning_circle(rudder) if turn else ps.zigzag(20.0, 20.0)
    clean = simulated(vessel, manoeuvre)
    assert not clean["diverged"]
    for seed in range(10):
        checks = found(noisy(clean, seed), vessel if seed < 7 else None)
        assert alarms(checks) == set()
        assert not any(check.mendable for check in checks.values())


def test_a_record_without_noise_raises_no_alarm(container, approached):
    for manoeuvre in (ps.zigzag(10.0, 10.0, side="starboard"), ps.turning_circle(35.0, side="starboard")):
        checks = found(simulated(container, manoeuvre), container)
        assert alarms(checks) == set()
    assert alarms(found(approached, container)) == set()
    assert found(approached, container)["approach"].verdict == "good"
    assert found(approached, container)["rudder zero"].verdict == "good"


def test_every_check_of_a_full_record_is_made(approached, container):
    trial = approached.assign(delta_command=approached["delta"]).assign_attrs(reading="comma")
    left = {name for name, check in found(trial, container).items() if check.verdict == "not checked"}
    assert left == {"rudder delay"}


@pytest.mark.parametrize("name", ["u", "v", "r", "p", "phi", "psi", "x", "y", "delta"])
def test_checks_that_lack_a_channel_say_so(zigzag, container, name):
    checks = found(zigzag.drop_vars(name), container)
    assert alarms(checks) == set()
    told = [check.sentence for check in checks.values() if check.verdict == "not checked"]
    assert any(name in sentence for sentence in told) or name == "phi"


@pytest.mark.parametrize("names", [["delta"], ["u"], ["x", "y"], ["psi", "r"], ["u", "v", "r", "delta"]])
def test_records_of_few_channels_are_checked(zigzag, container, names):
    for vessel in (container, None):
        assert alarms(found(zigzag[names], vessel)) == set()


# kinematic closure


def offset(trial):
    return changed(trial, r=trial["r"].values + np.deg2rad(0.005))


def roll_offset(trial):
    return changed(trial, p=trial["p"].values - np.deg2rad(0.01))


def earth_fixed(trial):
    return changed(trial, **dict(zip("uv", earth_velocity(trial), strict=True)))


def lever(trial):
    return changed(trial, v=trial["v"].values - 20.0 * trial["r"].values)


def wrapped(trial):
    return changed(trial, psi=(trial["psi"].values + 3.3 + np.pi) % (2.0 * np.pi) - np.pi - 3.3)


MENDABLE = {
    "gyro offset": (offset, "offset", 0.005, 5e-4),
    "roll rate offset": (roll_offset, "offset", -0.01, 1e-3),
    "velocity axes": (earth_fixed, "misfit earth-fixed", 0.0, 0.02),
    "lever arm": (lever, "lever arm", 20.0, 0.5),
}
"""Fault, and the number that tells its size, what it should be and how far it may be off."""


@pytest.mark.parametrize("name", MENDABLE)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_fault_of_the_velocities_is_found_alone_and_mended(container, approached, name, seed):
    fault, number, size, error = MENDABLE[name]
    trial = noisy(steered(container), seed)
    checks = ps.trial_checks(fault(trial), container)
    named = {check.name: check for check in checks}
    assert alarms(named) == {name}
    assert named[name].mendable
    assert named[name].value(number) == pytest.approx(size, abs=error)
    mended = ps.corrected_trial(fault(trial), checks)
    assert len(mended.attrs["corrections"]) == 1
    for channel in ("u", "v", "r", "p"):
        spread = np.std(trial[channel].values)
        assert np.abs(mended[channel].values - trial[channel].values).max() < 0.03 * spread
    assert alarms(found(mended, container)) == set()


def test_faults_that_come_together_are_told_apart(container, zigzag):
    """Gyro offset, lever arm and earth-fixed velocities, as one measured file has them."""
    trial = earth_fixed(lever(zigzag)).assign(r=zigzag["r"] + np.deg2rad(0.005))
    checks = ps.trial_checks(trial, container)
    named = {check.name: check for check in checks}
    assert alarms(named) == {"gyro offset", "velocity axes", "lever arm"}
    assert named["lever arm"].value("lever arm") == pytest.approx(20.0, abs=1.0)
    mended = ps.corrected_trial(trial, checks)
    assert np.abs(mended["v"].values - zigzag["v"].values).max() < 0.05
    assert len(mended.attrs["corrections"]) == 3


def test_a_lever_arm_needs_no_vessel_but_a_turn_that_changes(circle, zigzag):
    check = found(lever(zigzag))["lever arm"]
    assert (check.verdict, check.value("lever arm")) == ("doubtful", pytest.approx(20.0, abs=1.0))
    assert found(lever(circle))["lever arm"].verdict == "not checked"


def units(name, factor):
    return lambda trial: changed(trial, **{name: factor * trial[name].values})


def knots(trial):
    return changed(trial, u=trial["u"].values / 0.514444, v=trial["v"].values / 0.514444)


def all_in_degrees(trial):
    return changed(trial, psi=np.rad2deg(trial["psi"].values), r=np.rad2deg(trial["r"].values))


BAD = {
    "psi in deg": (units("psi", 180.0 / np.pi), "yaw rate", "psi is in deg"),
    "r in deg/s": (units("r", 180.0 / np.pi), "yaw rate", "r is in deg/s"),
    "r flipped": (units("r", -1.0), "yaw rate", "opposite sign"),
    "r of another scale": (units("r", 1.3), "yaw rate", "calibration"),
    "p in deg/s": (units("p", 180.0 / np.pi), "roll rate", "p is in deg/s"),
    "phi flipped": (units("phi", -1.0), "roll rate", "opposite sign"),
    "psi and r in deg": (all_in_degrees, "heading", "unit and sign of psi"),
    "speeds in knots": (knots, "speed", "knots taken for m/s"),
    "v flipped": (units("v", -1.0), "sway sign", "flip its sign"),
    "delta in deg": (units("delta", 180.0 / np.pi), "rudder unit", "it is in deg"),
    "delta flipped": (units("delta", -1.0), "rudder sign", "turns the ship to starboard"),
}


@pytest.mark.parametrize("fault", BAD)
@pytest.mark.parametrize("run", ["zigzag", "circle"])
def test_units_and_signs_that_are_wrong_are_bad_and_refused(request, container, fault, run):
    trial = request.getfixturevalue(run)
    spoil, name, words = BAD[fault]
    checks = ps.trial_checks(spoil(trial), container if run == "zigzag" else None)
    named = {check.name: check for check in checks}
    assert named[name].verdict == "bad"
    assert words in named[name].sentence
    with pytest.raises(ps.TrialError, match=f"cannot be fitted: .*{name}: "):
        ps.corrected_trial(spoil(trial), checks)


def test_a_gyro_that_is_two_per_cent_off_is_doubtful(zigzag, container):
    check = found(units("r", 1.05)(zigzag), container)["yaw rate"]
    assert (check.verdict, check.mendable) == ("doubtful", False)
    assert check.value("scale") == pytest.approx(1.0 / 1.05, abs=2e-3)


def test_a_current_is_told_and_not_mended(zigzag, container):
    trial = changed(zigzag, y=zigzag["y"].values + 0.3 * zigzag["time"].values)
    checks = found(trial, container)
    assert alarms(checks) == {"track closure"}
    assert checks["track closure"].verdict == "doubtful"
    assert "current or offset of 0.3 m/s" in checks["track closure"].sentence
    assert checks["track closure"].value("drift") == pytest.approx(0.3 * 400.0, rel=0.05)


def test_a_track_that_nothing_mends_is_refused(zigzag, container):
    """A track that sways as the ship does not."""
    sway = 120.0 * np.sin(2.0 * np.pi * zigzag["time"].values / 300.0)
    checks = ps.trial_checks(changed(zigzag, y=zigzag["y"].values + sway), container)
    assert alarms({check.name: check for check in checks}) >= {"track closure"}
    with pytest.raises(ps.TrialError, match=r"track closure: .* unexplained"):
        ps.corrected_trial(zigzag, checks)


# rudder


def test_the_rudders_zero_is_mended_where_approach_and_zigzag_agree(container, approached):
    trial = changed(approached, delta=approached["delta"].values + np.deg2rad(1.2))
    checks = ps.trial_checks(trial, container)
    assert alarms({check.name: check for check in checks}) == {"rudder zero"}
    mended = ps.corrected_trial(trial, checks)
    assert np.rad2deg(np.abs(mended["delta"].values - approached["delta"].values).max()) < 0.05
    assert mended.attrs["corrections"] == ["+1.20 deg subtracted from delta."]


def test_a_rudder_that_holds_the_ship_straight_is_told_and_not_mended(container):
    """An approach with 1 deg of rudder, as a ship needs whose propeller turns her."""
    trial = changed(noisy(steered(container, first=0.0)))
    delta = trial["delta"].values.copy()
    delta[trial["time"].values <= 40.0] = np.deg2rad(-0.8)
    checks = found(changed(trial, delta=delta), container)
    assert checks["rudder zero"].verdict == "doubtful"
    assert not checks["rudder zero"].mendable
    assert checks["rudder zero"].value("on the approach") == pytest.approx(-0.8)


@pytest.mark.parametrize("run", ["zigzag", "circle", "approached"])
def test_the_rudder_rate_is_that_of_the_vessel_or_told(request, container, run):
    trial = request.getfixturevalue(run)
    check = found(trial, container)["rudder rate"]
    assert (check.verdict, check.value("rudder rate")) == ("good", pytest.approx(2.3, rel=0.05))
    slow = replace(container, particulars=replace(container.particulars, rudder_rate_deg=5.0))
    assert found(trial, slow)["rudder rate"].verdict == "doubtful"
    assert found(trial)["rudder rate"].verdict == "not checked"


@pytest.mark.parametrize("delay", [0.0, 1.0, 3.0])
def test_the_delay_behind_the_command_is_measured(container, approached, delay):
    time = approached["time"].values + delay
    command = np.where(time < 40.1, 0.0, np.where((time - 40.1) // 50.0 % 2 == 0.0, 1.0, -1.0) * np.deg2rad(15.0))
    check = found(approached.assign(delta_command=("time", command)), container)["rudder delay"]
    assert check.verdict == "good"
    assert check.value("delay") == pytest.approx(delay, abs=2.0 * INTERVAL)


def test_a_command_that_comes_after_the_rudder_is_doubted(container, approached):
    command = np.roll(approached["delta"].values, 100)
    check = found(approached.assign(delta_command=("time", np.sign(command) * 0.26)), container)["rudder delay"]
    assert check.verdict in ("doubtful", "not checked")


# the record


@pytest.mark.parametrize(("every", "verdict"), [(1, "good"), (5, "good"), (15, "doubtful"), (30, "bad")])
def test_the_sampling_is_judged_by_the_ship(zigzag, container, every, verdict):
    checks = found(zigzag.isel(time=slice(None, None, every)), container)
    assert checks["sampling"].verdict == verdict
    assert checks["sampling"].value("interval") == pytest.approx(INTERVAL * every)


def test_a_rudder_that_jumps_between_samples_is_doubted(container):
    trial = noisy(steered(container, rate_limited=False)).isel(time=slice(None, None, 5))
    checks = found(trial, container)
    assert alarms(checks) == {"sampling"}
    assert "of its range between samples" in checks["sampling"].sentence
    assert checks["rudder rate"].verdict == "not checked"


@pytest.mark.parametrize(("share", "verdict"), [(0.1, "good"), (0.5, "doubtful"), (1.5, "bad")])
def test_noise_is_judged_by_the_spread_of_its_channel(zigzag, container, share, verdict):
    v = zigzag["v"].values
    v = v + share * v.std() * np.random.default_rng(3).standard_normal(v.size)
    checks = found(changed(zigzag, v=v), container)
    assert checks["noise"].verdict == verdict
    assert checks["noise"].value("sd v") == pytest.approx(share * zigzag["v"].values.std(), rel=0.1)


@pytest.mark.parametrize(("step", "verdict"), [(0.001, "good"), (0.05, "doubtful"), (0.2, "bad")])
def test_a_coarse_channel_is_told(container, step, verdict):
    trial = simulated(container, ps.zigzag(20.0, 20.0))
    size = step * np.ptp(trial["v"].values)
    check = found(changed(trial, v=size * np.rint(trial["v"].values / size)), container)["resolution"]
    assert check.verdict == verdict
    assert verdict == "good" or "v has" in check.sentence


def test_spikes_are_found_told_and_mended(zigzag, container):
    where = np.array([100, 400, 401, 1500])
    trial = with_samples(zigzag, "r", where, 0.2)
    trial = with_samples(trial, "y", [777], 1e4)
    checks = ps.trial_checks(trial, container)
    named = {check.name: check for check in checks}
    assert alarms(named) == {"spikes"}
    assert (named["spikes"].value("spikes, r"), named["spikes"].value("spikes, y")) == (4.0, 1.0)
    mended = ps.corrected_trial(trial, checks)
    for name in ("r", "y"):
        others = np.setdiff1d(np.arange(zigzag.sizes["time"]), [*where, 777])
        assert (mended[name].values[others] == zigzag[name].values[others]).all()
        assert np.abs(mended[name].values - zigzag[name].values).max() < 0.05 * np.ptp(zigzag[name].values)
    assert mended.attrs["corrections"] == ["Samples replaced by interpolation: 5."]


def test_many_spikes_are_a_broken_sensor(zigzag, container):
    trial = with_samples(zigzag, "r", np.arange(5, 2000, 20), 0.2)
    assert found(trial, container)["spikes"].verdict == "bad"


def test_white_noise_steps_and_corners_have_no_spikes(zigzag):
    rng = np.random.default_rng(5)
    assert spikes(rng.standard_normal(200_000)).size == 0
    assert spikes(np.repeat([0.0, 1.0, 0.0], 50)).size == 0
    assert spikes(zigzag["delta"].values[::20]).size == 0
    assert spikes(np.zeros(100)).size == 0


def test_a_heading_that_wraps_is_unwrapped(circle, container):
    trial = wrapped(circle)
    checks = ps.trial_checks(trial, container)
    named = {check.name: check for check in checks}
    assert alarms(named) == {"heading wraps"}
    assert named["heading wraps"].value("jumps") >= 1.0
    mended = ps.corrected_trial(trial, checks)["psi"].values
    assert np.ptp(mended - circle["psi"].values) < 1e-9


@pytest.mark.parametrize(("seconds", "verdict"), [(2.0, "good"), (10.0, "doubtful"), (40.0, "bad")])
def test_a_sensor_that_stands_still_is_found(zigzag, container, seconds, verdict):
    where = slice(500, 500 + round(seconds / INTERVAL))
    checks = found(with_samples(zigzag, "u", where, zigzag["u"].values[500]), container)
    assert checks["frozen channels"].verdict == verdict
    if verdict != "good":
        assert checks["frozen channels"].value("frozen, u") == pytest.approx(seconds, abs=INTERVAL)


def test_a_channel_that_never_changes_is_bad(zigzag, container):
    assert found(changed(zigzag, v=0.0 * zigzag["v"].values), container)["frozen channels"].verdict == "bad"


def test_gaps_that_the_reading_told_of_are_passed_on(zigzag):
    told = "Comma separated.\n2 gaps of up to 3 samples: 4 filled by interpolation."
    check = found(zigzag.assign_attrs(reading=told))["gaps"]
    assert check.verdict == "doubtful"
    assert check.sentence.startswith("2 gaps of up to 3 samples")
    assert found(zigzag.assign_attrs(reading="Comma separated."))["gaps"].verdict == "good"
    assert found(zigzag)["gaps"].verdict == "not checked"


# approach and excitation


@pytest.mark.parametrize(
    ("name", "words"), [("r", "r is"), ("v", "v is"), ("phi", "phi is"), ("u", "the speed changes by")]
)
def test_an_approach_that_is_not_straight_or_steady_is_doubted(container, approached, name, words):
    straight = approached["time"].values <= 40.0
    largest = np.abs(approached[name].values).max()
    slope = np.linspace(-1.0, 0.0, straight.sum()) if name == "u" else 1.0
    values = approached[name].values + np.where(straight, 0.0, 0.0)
    values[straight] += 0.2 * largest * slope
    check = found(changed(approached, **{name: values}), container)["approach"]
    assert check.verdict == "doubtful"
    assert words in check.sentence


def test_a_record_of_another_scale_than_the_vessels_is_doubted(container, approached):
    factor = 40.0
    length, time = 1.0 / factor, 1.0 / np.sqrt(factor)
    names = {"u": length / time, "v": length / time, "r": 1.0 / time, "p": 1.0 / time, "x": length, "y": length}
    model = changed(approached, **{name: scale * approached[name].values for name, scale in names.items()})
    model = model.assign_coords(time=approached["time"].values * time)
    assert "times the nominal one" in found(model, container)["approach"].sentence
    assert found(model, container)["rudder rate"].verdict == "doubtful"
    assert alarms(found(model)) == set()


@pytest.mark.parametrize(("angle", "verdict"), [(15.0, "good"), (3.0, "doubtful"), (0.2, "bad")])
def test_a_run_that_hardly_turns_is_told(flat, angle, verdict):
    time = np.arange(0.0, 400.0, 40.0)
    programme = ps.rudder_programme(time, np.deg2rad(angle) * np.resize([1.0, 1.0, -1.0, -1.0], time.size))
    checks = found(noisy(simulated(flat, programme), level=0.001), flat)
    assert checks["ranges"].verdict == verdict


def test_directions_above_the_noise_are_counted(flat, container):
    few = found(noisy(simulated(flat, ps.zigzag(20.0, 20.0))), flat)
    assert all(few[f"excitation {dof}"].verdict == "good" for dof in flat.dofs)
    assert few["excitation yaw"].value("directions above noise") == 3.0
    turn = found(noisy(simulated(container, ps.turning_circle(35.0)), level=0.1), container)["excitation sway"]
    assert turn.verdict in ("doubtful", "bad")
    assert turn.value("directions above noise") < 20.0
    assert turn.value("condition number") > 100.0 * few["excitation sway"].value("condition number")
    assert found(simulated(flat, ps.zigzag(20.0, 20.0)))["excitation"].verdict == "not checked"


def test_terms_that_stay_zero_are_named(container, zigzag):
    still = changed(zigzag, p=0.0 * zigzag["p"].values + 1e-30)
    check = found(still, container)["excitation roll"]
    assert check.verdict == "bad"
    assert "Kp" in check.sentence


@pytest.mark.parametrize("seed", range(14))
def test_spoilt_records_end_in_verdicts(zigzag, container, seed):
    """Channels left out, scaled, rounded, shifted, replaced by noise or held, at random: no crash, no NaN told."""
    rng = np.random.default_rng(seed)
    names = rng.choice(CHANNELS, rng.integers(1, 10), replace=False).tolist()
    trial = zigzag[names].isel(time=slice(0, int(rng.choice([20, 60, 2000]))))
    for name in names:
        values = trial[name].values
        spoilt = (
            values,
            values * rng.choice([-1.0, 0.0, 1e-300, 1e6, 57.3]),
            np.round(values, rng.integers(-1, 4)),
            values + rng.choice([-10.0, 1e8]),
            rng.standard_normal(values.size),
            0.0 * values + values[0],
        )
        trial = changed(trial, **{name: spoilt[rng.integers(len(spoilt))]})
    checks = ps.trial_checks(trial, container if seed % 2 else None)
    assert all(check.verdict in VERDICTS and "nan" not in check.sentence for check in checks)
    if not failed_checks(checks):
        assert np.isfinite(ps.corrected_trial(trial, checks).to_array().values).all()


# the command line


def test_the_command_prints_verdicts_and_writes_the_corrected_trial(tmp_path, capsys, zigzag):
    ps.write_trial(offset(zigzag), tmp_path / "trial.csv")
    words = ["check", tmp_path / "trial.csv", "--vessel", "container", "--out", tmp_path / "corrected.csv", "--quiet"]
    assert main([str(word) for word in words]) == 0
    first, *_, last = capsys.readouterr().out.splitlines()
    assert re.match(r"gyro offset       doubtful     r has an offset of \+0\.00(49|50|51) deg/s against psi", first)
    assert last.endswith("deg/s subtracted from r.")
    again = ps.read_trial(tmp_path / "corrected.csv")
    assert np.abs(again["r"].values - zigzag["r"].values).max() < np.deg2rad(5e-4)
    assert last in (tmp_path / "corrected.csv").read_text().splitlines()[1]


def test_a_bad_trial_ends_with_status_3_and_nothing_is_written(tmp_path, capsys, zigzag):
    ps.write_trial(units("delta", -1.0)(zigzag), tmp_path / "trial.csv")
    assert main(["check", str(tmp_path / "trial.csv"), "--out", str(tmp_path / "corrected.csv"), "--quiet"]) == 3
    printed = capsys.readouterr()
    assert printed.out.startswith("rudder sign       bad          A positive delta turns")
    assert re.fullmatch(r"pymc-ship: The trial cannot be fitted: rudder sign: .*\.\n", printed.err)
    assert not (tmp_path / "corrected.csv").exists()


def test_a_good_trial_needs_no_vessel_and_no_output(tmp_path, capsys, circle):
    ps.write_trial(circle, tmp_path / "trial.csv")
    assert main(["check", str(tmp_path / "trial.csv"), "--quiet"]) == 0
    printed = capsys.readouterr().out
    assert not re.search(r" (bad|doubtful) ", printed)
    assert re.search(r"^excitation +not checked  no vessel whose terms could be tried\.$", printed, re.MULTILINE)


# the results


def test_the_table_holds_every_check_and_number(zigzag, container):
    checks = ps.trial_checks(offset(zigzag), container)
    table = ps.check_table(checks)
    assert table["check"].values.tolist() == [check.name for check in checks]
    assert table.sizes["number"] == sum(len(check.numbers) for check in checks)
    assert str(table["verdict"].sel(check="gyro offset").values) == "doubtful"
    rows = table.where((table["of"] == "gyro offset") & (table["quantity"] == "offset"), drop=True)
    assert float(rows["value"].values[0]) == pytest.approx(0.005, abs=5e-4)
    assert table.attrs["verdict"] == "doubtful"


def test_every_sentence_is_one_line_that_ends(zigzag, approached, container):
    for trial in (zigzag, approached, offset(lever(zigzag)), units("r", -1.0)(zigzag)):
        for check in ps.trial_checks(trial, container):
            assert isinstance(check, Check)
            assert check.verdict in VERDICTS
            assert check.sentence.endswith(".")
            assert "\n" not in check.sentence
            assert all(isinstance(value, float) for _, value, _ in check.numbers)


def test_a_good_trial_is_left_as_it_is(zigzag, container):
    checks = ps.trial_checks(zigzag, container)
    again = ps.corrected_trial(zigzag, checks)
    assert failed_checks(checks) == ""
    assert again.attrs["corrections"] == []
    assert again.drop_attrs().identical(zigzag.drop_attrs())


def test_records_that_no_check_can_be_made_of_are_refused(zigzag):
    with pytest.raises(ps.TrialError, match="20 samples up, found 10"):
        ps.trial_checks(zigzag.isel(time=slice(0, 10)))
    with pytest.raises(ps.TrialError, match="must be finite"):
        ps.trial_checks(with_samples(zigzag, "v", [7], np.nan))
    with pytest.raises(ps.TrialError, match="uniform"):
        ps.trial_checks(zigzag.isel(time=np.r_[0:50, 60:200]))
    with pytest.raises(ps.TrialError, match=r"Channel v must be that of a ship, found 1e\+15"):
        ps.trial_checks(with_samples(zigzag, "v", [7], 1e15))
    with pytest.raises(ps.TrialError, match="needs the channels"):
        ps.trial_checks(zigzag.drop_vars(zigzag.data_vars))
