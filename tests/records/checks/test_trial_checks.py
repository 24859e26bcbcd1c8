"""Checks of a trial: quiet without a fault; verdicts, tables and the command line with one."""

from __future__ import annotations

import re

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.records.checks.trial_checks import check_table, failed_checks
from pymc_ship.records.checks.verdicts import Check
from pymc_ship.trial.channels import SIMULATED
from pymc_ship.trial.quality_flags import VERDICTS
from tests.records.checks.cases import alarms, changed, checks_by_name, lever, noisy, offset, simulated, units

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
        checks = checks_by_name(noisy(clean, seed), vessel if seed < 7 else None)
        assert alarms(checks) == set()
        assert not any(check.mendable for check in checks.values())


def test_a_record_without_noise_raises_no_alarm(container, approached):
    for manoeuvre in (ps.zigzag(10.0, 10.0, side="starboard"), ps.turning_circle(35.0, side="starboard")):
        checks = checks_by_name(simulated(container, manoeuvre), container)
        assert alarms(checks) == set()
    assert alarms(checks_by_name(approached, container)) == set()
    assert checks_by_name(approached, container)["approach"].verdict == "good"
    assert checks_by_name(approached, container)["rudder zero"].verdict == "good"


def test_every_check_of_a_full_record_is_made(approached, container):
    trial = approached.assign(delta_command=approached["delta"]).assign_attrs(reading="comma")
    left = {name for name, check in checks_by_name(trial, container).items() if check.verdict == "not checked"}
    assert left == {"rudder angle", "rudder delay", "revolutions", "wind"}


@pytest.mark.parametrize("name", ["u", "v", "r", "p", "phi", "psi", "x", "y", "delta"])
def test_checks_that_lack_a_channel_name_it(zigzag, container, name):
    checks = checks_by_name(zigzag.drop_vars(name), container)
    assert alarms(checks) == set()
    sentences = [check.sentence for check in checks.values() if check.verdict == "not checked"]
    assert any(name in sentence for sentence in sentences) or name == "phi"


@pytest.mark.parametrize("names", [["delta"], ["u"], ["x", "y"], ["psi", "r"], ["u", "v", "r", "delta"]])
def test_records_of_few_channels_are_checked(zigzag, container, names):
    for vessel in (container, None):
        assert alarms(checks_by_name(zigzag[names], vessel)) == set()


# spoilt records


@pytest.mark.parametrize("seed", range(14))
def test_spoilt_records_end_in_verdicts(zigzag, container, seed):
    """Channels left out, scaled, rounded, shifted, noisy or frozen, at random: no crash, no NaN in sentences."""
    rng = np.random.default_rng(seed)
    names = rng.choice(SIMULATED, rng.integers(1, 10), replace=False).tolist()
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
    assert main([str(word) for word in words]) == 4
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("gyro offset")]
    assert re.match(r"gyro offset       doubtful     r has an offset of \+0\.00(49|50|51) deg/s against psi", line)
    mended = line.partition("; mended: ")[2]
    assert mended.endswith("deg/s subtracted from r.")
    again = ps.read_trial(tmp_path / "corrected.csv")
    assert np.abs(again["r"].values - zigzag["r"].values).max() < np.deg2rad(5e-4)
    assert mended in (tmp_path / "corrected.csv").read_text().splitlines()[1]


def test_the_command_prints_the_recognised_manoeuvre_and_what_is_not_modelled(tmp_path, capsys, zigzag):
    programme = ps.rudder_programme(np.arange(0.0, 400.0, 40.0), np.deg2rad([20, -10, 15, -20, 5, 20, 0, -15, 10, -20]))
    other = ps.simulate(ps.load_vessel("container"), programme, duration=400.0, record_interval=0.2)
    cases = (
        (other, 4, "It is not recognised as a zigzag, a turning circle or a pull out: "),
        (zigzag, 0, "The trial is recognised as a zigzag 20/20 port."),
    )
    for trial, status, sentence in cases:
        ps.write_trial(trial, tmp_path / "trial.csv")
        assert main(["check", str(tmp_path / "trial.csv"), "--vessel", "container", "--quiet"]) == status
        assert any(line.startswith(sentence) for line in capsys.readouterr().out.splitlines())
    assert main(["check", str(tmp_path / "trial.csv"), "--vessel", "kvlcc2", "--quiet"]) == 4
    assert "\nThe record has roll rate p and roll angle φ, but the vessel file has no" in capsys.readouterr().out


def test_a_bad_trial_ends_with_status_3_and_nothing_is_written(tmp_path, capsys, zigzag):
    ps.write_trial(units("delta", -1.0)(zigzag), tmp_path / "trial.csv")
    assert main(["check", str(tmp_path / "trial.csv"), "--out", str(tmp_path / "corrected.csv"), "--quiet"]) == 3
    printed = capsys.readouterr()
    assert "\n\nrudder sign       bad          A positive delta turns" in printed.out
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
    table = check_table(checks)
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
