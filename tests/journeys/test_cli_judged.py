"""What the checks say of a trial reaches everyone who reads the result: text, posterior and page."""

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from tests.journeys.cases import files, run


@pytest.fixture
def flipped(made, tmp_path):
    """The trial with a rudder that counts to the wrong side."""
    trial = ps.read_trial(made / "trial.csv")
    return ps.write_trial(trial.assign(delta=-trial["delta"]), tmp_path / "flipped.csv")


@pytest.mark.parametrize("command", ["regress", "tune", "fit", "identify"])
def test_a_flipped_rudder_is_not_fitted(made, flipped, tmp_path, capsys, command):
    more = ("--dof", "yaw", "--family", "conjugate") if command == "tune" else ()
    words = (command, flipped, "--vessel", made / "small.toml", *more, "--out", tmp_path / "out")
    assert main(list(map(str, words))) == 3
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith(f"pymc-ship: {flipped}: The trial cannot be fitted: ")
    assert "rudder sign: A positive delta turns the ship to starboard" in said
    assert files(tmp_path) == ["flipped.csv"]


@pytest.mark.parametrize("command", ["regress", "tune", "fit"])
def test_a_roll_that_the_vessel_file_does_not_have_is_told_before_the_work_begins(made, tmp_path, capsys, command):
    """The place of the result cannot be written, so that there is no work."""
    more = ("--dof", "yaw", "--family", "conjugate") if command == "tune" else ()
    trial = ps.read_trial(made / "trial.csv")
    swing = 0.3 * trial["time"]
    rolling = ps.write_trial(trial.assign(phi=0.05 * np.sin(swing), p=0.015 * np.cos(swing)), tmp_path / "rolling.csv")
    words = (command, rolling, "--vessel", made / "small.toml", *more, "--out", rolling / "below")
    assert main(list(map(str, words))) == 2
    assert f"\n{rolling}: The record has roll rate p and roll angle φ, but the vessel" in capsys.readouterr().err


@pytest.mark.usefixtures("undrawn")
def test_an_overruled_check_is_named_in_text_posterior_and_page(made, flipped, tmp_path, capsys):
    out, words = tmp_path / "out", ("--family", "conjugate", "--draws", 400, "--overrule", "rudder sign")
    run("regress", flipped, "--vessel", made / "small.toml", *words, "--out", out)
    named = "Overruled, though bad: rudder sign: A positive delta turns the ship to starboard"
    assert named in capsys.readouterr().out
    tree = ps.read_posterior(out / "yaw-conjugate.nc")
    assert tree.attrs["record_verdict"] == "bad"
    assert named in tree.attrs["record_remarks"]
    report = ("report", out / "yaw-conjugate.nc", "--vessel", made / "small.toml", "--out", tmp_path / "page")
    assert main(list(map(str, report))) in (0, 3)
    assert named in capsys.readouterr().out
    assert named in (tmp_path / "page" / "diagnostics.html").read_text(encoding="utf-8")


def test_a_fit_of_trajectories_keeps_the_doubts_on_its_records(made, small, tmp_path, capsys):
    trial = ps.read_trial(made / "trial.csv")
    skewed = ps.write_trial(trial.assign(r=trial["r"] + 2e-3), tmp_path / "skewed.csv")
    run("fit", skewed, "--vessel", made / "small.toml", "--prior", "sister_ship", "--draws", 40, "--out", tmp_path)
    tree = ps.read_posterior(tmp_path / "trajectory.nc")
    assert tree.attrs["record_verdict"] == "doubtful"
    remarks, printed = tree.attrs["record_remarks"], capsys.readouterr()
    assert "Doubtful: gyro offset: r has an offset" in remarks
    assert "; mended: +0.1" in remarks
    assert "subtract it" not in remarks
    assert "Doubtful: gyro offset: r has an offset" in printed.out
    assert printed.err.count("subtracted from r") == 1


def test_a_record_that_nobody_judged_is_said_to_be_unchecked(made, small):
    data = ps.regression_data(ps.denoise(ps.read_trial(made / "trial.csv")), small, "yaw", interval=1.0)
    assert data.record_verdict == "not checked"


def test_only_a_check_can_be_overruled(made, tmp_path, capsys):
    words = ("regress", made / "trial.csv", "--vessel", made / "small.toml", "--overrule", "luck", "--out", tmp_path)
    assert main(list(map(str, words))) == 2
    assert "A check to overrule is one of " in capsys.readouterr().err


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("command", ["score", "trial-report", "forecast"])
def test_measured_numbers_come_with_the_doubts_on_their_record(made, small, tmp_path, capsys, command):
    """On the page and, in spite of --quiet, in the text."""
    zigzag = ps.pollute(ps.simulate(small, ps.zigzag(20, 20), duration=200, step=0.2), level=0.003, rng=1)
    skewed, vessel = ps.write_trial(zigzag.assign(r=zigzag["r"] + 2e-3), tmp_path / "skewed.csv"), made / "small.toml"
    words = {
        "score": (vessel, skewed),
        "trial-report": (skewed, "--vessel", vessel),
        "forecast": (made / "identified", "--vessel", vessel, "--draws", 30, "--duration", 200, "--measured", skewed),
    }[command]
    run(command, *words, "--quiet", "--out", tmp_path / "out")
    doubt, text = "Doubtful: gyro offset: r has an offset", capsys.readouterr().out
    assert doubt in text
    assert "Doubtful: excitation" not in text
    (page,) = (tmp_path / "out").glob("*.html")
    assert doubt in page.read_text(encoding="utf-8")
    if command == "trial-report":
        assert "doubtful</strong>: skewed" in page.read_text(encoding="utf-8").split("</header>")[0]
