import json
import subprocess

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli import commands
from pymc_ship.cli.main import main
from pymc_ship.physics.manoeuvre.criteria import imo_criteria
from pymc_ship.trial.channels import SIMULATED
from tests.journeys.cases import files, program, run
from tests.physics.vessel.cases import toml


def spaced(text):
    """Lines with one blank between words, whatever the columns of a table."""
    return [" ".join(line.split()) for line in text.splitlines()]


# simulate


def test_simulate_writes_the_polluted_trial_and_prints_indices_of_the_clean_run(container, tmp_path, capsys):
    out = tmp_path / "new" / "trial.csv"
    run("simulate", "container", "--zigzag", "20/20", "--duration", 120, "--noise", 0.05, "--seed", 7, "--out", out)
    clean = ps.simulate(container, ps.zigzag(20, 20), duration=120.0, step=0.02)
    noisy = ps.pollute(clean, level=0.05, rng=np.random.default_rng(7))
    trial = ps.read_trial(out)
    for name in ("time", *SIMULATED):
        np.testing.assert_array_equal(trial[name], noisy[name])
    printed = capsys.readouterr()
    angle = float(ps.indices(clean)["first_overshoot_angle"])
    lines = spaced(printed.out)
    assert f"first overshoot angle {angle:.4g} deg" in lines
    assert "third overshoot angle - deg" in lines
    assert f"first overshoot angle {angle:.4g} 25 deg pass" in lines
    assert f"Written to {out}." in printed.err
    first = out.read_text().splitlines()[0]
    assert first.startswith(f"# pymc-ship {ps.__version__} simulate ")
    assert json.loads(first.split(" simulate ")[1])["seed"] == 7


def test_simulate_passes_its_options_on(container, tmp_path, capsys):
    out = tmp_path / "circle.csv"
    words = ("--turn", 35, "--side", "starboard", "--speed", 10, "--duration", 300, "--step", 0.05, "--method", "rk4")
    run("simulate", "container", *words, "--out", out)
    circle = ps.turning_circle(35.0, side="starboard", approach_speed=10.0)
    expected = ps.simulate(container, circle, duration=300.0, step=0.05, method="rk4")
    np.testing.assert_array_equal(ps.read_trial(out)["psi"], expected["psi"])
    criteria = {row["criterion"]: row for row in imo_criteria(ps.indices(expected), container)}
    word = {True: "pass", False: "fail"}[criteria["advance"]["passed"]]
    assert f"advance {criteria['advance']['value']:.4g} 4.5 L {word}" in spaced(capsys.readouterr().out)


def test_simulate_reads_by_instruments_and_leaves_gaps_that_the_reader_fills(container, tmp_path):
    out = tmp_path / "trial.csv"
    words = ("--zigzag", "20/20", "--duration", 300, "--step", 0.5, "--method", "dop853")
    run("simulate", "container", *words, "--noise", "gnss,fluxgate_compass", "--seed", 7, "--out", out)
    clean = ps.simulate(container, ps.zigzag(20, 20), duration=300.0, step=0.5, method="dop853")
    noisy = ps.pollute(clean, noise=("gnss", "fluxgate_compass"), rng=np.random.default_rng(7))
    trial = ps.read_trial(out)
    noisy = noisy.sel(time=trial["time"])  # a gap at an end is cut
    gone = np.isnan(noisy["u"].values)
    assert gone.any()
    assert "u: " in trial.attrs["reading"]
    assert "filled by interpolation" in trial.attrs["reading"]
    np.testing.assert_allclose(trial["psi"], noisy["psi"], atol=1e-12)
    np.testing.assert_array_equal(trial["u"][~gone], noisy["u"][~gone])
    np.testing.assert_array_equal(trial["r"], noisy["r"])


def test_denoise_takes_a_smoother_and_prints_its_parameter(made, tmp_path, capsys):
    out = tmp_path / "smooth.csv"
    run("denoise", made / "trial.csv", "--method", "savitzky_golay", "--out", out)
    smooth = ps.denoise(ps.read_trial(made / "trial.csv"), method="savitzky_golay")
    np.testing.assert_array_equal(ps.read_trial(out)["v"], smooth["v"])
    lines = spaced(capsys.readouterr().out)
    assert lines[:2] == ["Noise of each channel:", "channel noise sd unit window"]
    window = smooth["v"].attrs["denoise_window"]
    assert f"v {smooth['v'].attrs['noise_sdev']:.4g} m/s {window:.0f}" in lines


def test_simulate_runs_a_programme_in_degrees(container, tmp_path, capsys):
    programme, out = tmp_path / "programme.csv", tmp_path / "trial.csv"
    programme.write_text("# a step to port\ntime,delta_deg\n0,0\n10,0\n12,20\n30,-15\n")
    run("simulate", "container", "--programme", programme, "--duration", 40, "--out", out)
    manoeuvre = ps.rudder_programme([0.0, 10.0, 12.0, 30.0], np.deg2rad([0.0, 0.0, 20.0, -15.0]))
    expected = ps.simulate(container, manoeuvre, duration=40.0, step=0.02)
    np.testing.assert_array_equal(ps.read_trial(out)["delta"], expected["delta"])
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("words", "is_too_long"),
    [
        (["--step", 2, "--method", "rk4"], False),
        (["--step", 60, "--method", "rk4"], True),
        (["--step", 20, "--method", "dop853"], False),
        (["--duration", 0.1], False),
    ],
)
def test_simulate_says_that_a_step_is_too_long(tmp_path, capsys, words, is_too_long):
    run("simulate", "kvlcc2", "--zigzag", "20/20", *words, "--out", tmp_path / "trial.csv")
    assert ("the heading differs by more than 2% of its range" in capsys.readouterr().out) == is_too_long


def test_simulate_says_that_a_run_diverged_and_keeps_what_was_before(small, tmp_path, capsys):
    surge = np.array([5.0, *small.coefficients("surge").values[1:]])
    vessel = small.with_coefficients({"surge": surge})
    (tmp_path / "wild.toml").write_text(toml(vessel))
    out = tmp_path / "trial.csv"
    run("simulate", tmp_path / "wild.toml", "--turn", 35, "--noise", "literal", "--out", out)
    expected = ps.simulate(vessel, ps.turning_circle(35.0), duration=400.0)
    assert bool(expected["diverged"])
    trial = ps.read_trial(out)
    assert f"The run diverged at t = {float(expected['diverged_at']):g} s" in capsys.readouterr().out
    assert trial.sizes["time"] == int(np.isfinite(expected["u"]).sum()) > 2
    assert all(np.isfinite(trial[name]).all() for name in SIMULATED)


# denoise


def test_denoise_writes_the_smooth_trial_and_prints_the_noise(made, tmp_path, capsys):
    out = tmp_path / "smooth.csv"
    run("denoise", made / "trial.csv", "--wavelet", "db4", "--prior", "cauchy", "--decimated", "--out", out)
    expected = ps.denoise(ps.read_trial(made / "trial.csv"), "db4", "cauchy", False)
    smooth = ps.read_trial(out)
    printed = {
        line.split()[0]: line.split()[1:]
        for line in capsys.readouterr().out.splitlines()
        if not line.startswith(("Noise", "channel"))
    }
    assert set(printed) == {"u", "v", "r", "p", "phi", "psi"}
    for name in SIMULATED:
        np.testing.assert_array_equal(smooth[name], expected[name])
    for name, (sdev, unit) in printed.items():
        assert float(sdev) == pytest.approx(expected[name].attrs["noise_sdev"], rel=1e-3)
        assert unit == expected[name].attrs["units"]


# files as facilities write them


@pytest.fixture
def foreign(made, tmp_path):
    """The trial with its rudder in degrees to starboard under another heading, a line missing; and its format."""
    header, *lines = [line for line in (made / "trial.csv").read_text().splitlines() if line[0] != "#"]
    names = header.split(",")
    del lines[100]
    table = [dict(zip(names, map(float, line.split(",")), strict=True)) for line in lines]
    rows = [{**row, "delta": -float(np.rad2deg(row["delta"]))} for row in table]
    text = (
        ";".join(names).replace("delta", "RUD") + "\n" + "".join(";".join(map(repr, r.values())) + "\n" for r in rows)
    )
    (tmp_path / "run.csv").write_text(text)
    layout = '[columns]\ndelta = { column = "RUD", unit = "deg" }\n[frame]\nrudder_positive = "starboard"\n'
    (tmp_path / "basin.toml").write_text(layout)
    return tmp_path / "run.csv", tmp_path / "basin.toml"


@pytest.mark.parametrize("command", ["denoise", "regress", "tune", "fit"])
def test_commands_read_a_trial_by_its_format_and_tell(made, foreign, tmp_path, capsys, monkeypatch, command):
    """Each fails at what comes after the reading; its remarks are there all the same."""
    trial, layout = foreign

    def stop(_):
        raise ValueError("stopped")

    monkeypatch.setattr(commands, "writable_folder", stop)
    monkeypatch.setattr(commands, "output_file", stop)
    vessel = () if command == "denoise" else ("--vessel", made / "small.toml")
    more = ("--dof", "yaw", "--family", "conjugate") if command == "tune" else ()
    words = [command, trial, "--format", layout, *vessel, *more, "--out", tmp_path / "out"]
    assert main(list(map(str, words))) == 2
    *told, stopped = capsys.readouterr().err.splitlines()
    assert told[:3] == [
        f"{trial}: Columns read: delta from 'RUD' in deg.",
        f"{trial}: 1 gap of up to 1 sample: 1 filled by interpolation.",
        f"{trial}: delta changed in sign: the file counts it positive to starboard.",
    ]
    judged = f"{trial}: Doubtful: gaps: {told[1].removeprefix(f'{trial}: ')} Look at these places before a fit."
    assert told[3:] == ([] if command == "denoise" else [f"checking {trial}", judged])
    assert stopped == "pymc-ship: stopped."
    assert main([*map(str, words), "--quiet"]) == 2
    assert capsys.readouterr().err == "pymc-ship: stopped.\n"


def test_remarks_on_a_trial_stay_on_a_terminal(foreign, tmp_path, capsys, monkeypatch):
    trial, layout = foreign
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    run("denoise", trial, "--format", layout, "--out", tmp_path / "smooth.csv")
    assert f"{trial}: Columns read: delta from 'RUD' in deg.\n" in capsys.readouterr().err.replace("\r", "")
    assert '"format": "basin.toml"' in (tmp_path / "smooth.csv").read_text().splitlines()[0]


# the same seed, silence, progress


@pytest.mark.parametrize("command", ["simulate", "regress", "forecast"])
def test_the_same_seed_gives_identical_files(made, tmp_path, command):
    vessel, turn = ("--vessel", made / "small.toml"), ("--turn", 35, "--side", "port")
    words = {
        "simulate": (made / "small.toml", "--zigzag", "20/20", "--duration", 20, "--noise", 0.01),
        "regress": (made / "trial.csv", *vessel, "--family", "conjugate", "--draws", 40, "--interval", 2),
        "forecast": (made / "identified", *vessel, "--draws", 10, "--duration", 150, *turn),
    }[command]
    outs = [tmp_path / name / "result.csv" for name in ("one", "two", "other")]
    for out, seed in zip(outs, (5, 5, 6), strict=True):
        run(command, *words, "--seed", seed, "--out", out)
    one, two, other = ({name: (out.parent / name).read_bytes() for name in files(out.parent)} for out in outs)
    assert one == two
    assert one.keys() == other.keys()
    assert all(one[name] != other[name] for name in one)


def test_quiet_leaves_the_results_only(made, tmp_path, capsys):
    words = ["denoise", str(made / "trial.csv"), "--out", str(tmp_path / "smooth.csv")]
    assert main(words) == 0
    loud = capsys.readouterr()
    assert main([*words, "--quiet"]) == 0
    quiet = capsys.readouterr()
    assert loud.err.splitlines() == ["denoising", f"Written to {tmp_path / 'smooth.csv'}."]
    assert quiet.err == ""
    assert quiet.out == loud.out != ""


def test_a_terminal_sees_a_spinner_and_the_result_stays_clean(made, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    run("denoise", made / "trial.csv", "--out", tmp_path / "smooth.csv")
    printed = capsys.readouterr()
    assert "denoising" in printed.err
    assert "\x1b[" in printed.err
    assert "\x1b[" not in printed.out


# true processes


@pytest.mark.slow
def test_a_true_run_keeps_results_errors_and_warnings_apart(tmp_path):
    good = subprocess.run(
        program("simulate", "container", "--turn", "35", "--duration", "30", "--quiet", "--out", "trial.csv"),
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={"PYTHONWARNINGS": "error"},
    )
    assert (good.returncode, good.stderr) == (0, "")
    assert good.stdout.startswith("index ")
    bad = subprocess.run(program("denoise", "none.csv", "--out", "x.csv"), cwd=tmp_path, capture_output=True, text=True)
    sentence = "pymc-ship: The trial none.csv cannot be read: No such file or directory; check the path.\n"
    assert (bad.returncode, bad.stdout, bad.stderr) == (2, "", sentence)
    assert files(tmp_path) == ["trial.csv"]


@pytest.mark.slow
def test_a_reader_that_has_gone_is_no_traceback(tmp_path):
    words = program("simulate", "container", "--turn", "35", "--duration", "30", "--quiet", "--out", "trial.csv")
    with subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        assert process.stderr.read() == ""
    assert process.returncode == 2
    assert files(tmp_path) == ["trial.csv"]
