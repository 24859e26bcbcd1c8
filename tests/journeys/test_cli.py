import csv
import functools
import json
import re
import shlex
import signal
import subprocess
import sys
import time
import weakref
from dataclasses import replace
from pathlib import Path
from statistics import median
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.cli import commands
from pymc_ship.cli import main as cli
from pymc_ship.cli import parser as command_parser
from pymc_ship.cli.main import main
from pymc_ship.cli.parser import parser
from pymc_ship.denoising.derivative import DERIVATIVES
from pymc_ship.denoising.ebayes import PRIORS
from pymc_ship.manoeuvre.standard import SIDES
from pymc_ship.motion.prime_record import prime_record
from pymc_ship.motion.simulation import METHODS
from pymc_ship.regression import cross_validation
from pymc_ship.regression import identify as identification
from pymc_ship.regression.data import WEAK
from pymc_ship.regression.identify import identify
from pymc_ship.regression.priors import FAMILIES
from pymc_ship.replication import page
from pymc_ship.ship import model as ship_model
from pymc_ship.trajectory.prior import KINDS
from pymc_ship.trial.record import CHANNELS
from pymc_ship.vessel.vessel import DOFS
from tests.vessel.cases import TERMS

COMMANDS = ("study", "simulate", "denoise", "regress", "tune", "forecast", "report")
HEAVY = ("numpy", "xarray", "numba", "scipy", "pymc", "pytensor", "arviz", "skopt", "sklearn", "matplotlib", "rich")


def program(*words):
    """Command line of a true run."""
    return [str(Path(sys.executable).with_name("pymc-ship")), *map(str, words)]


def toml(vessel):
    """Vessel file of a vessel without roll."""
    s = vessel.particulars
    lines = [
        "[particulars]",
        *(f"{name} = {getattr(s, name)}" for name in ("L", "B", "volume", "nominal_speed", "x_G")),
    ]
    lines += [f"rudder_rate_deg = {s.rudder_rate_deg}", "[inertia]", f"m = {vessel.m}", f"I_zz = {vessel.I_zz}"]
    lines += ["[added_mass]", *(f"{name} = {value}" for name, value in vessel.added_mass.items())]
    for dof, force in vessel.forces.items():
        lines += [f"[coefficients.{dof}]", *(f"{c.name} = {c.value}" for c in force)]
    return "\n".join([f'name = "{vessel.name}"', *lines]) + "\n"


@pytest.fixture(scope="module", autouse=True)
def quick_evidence():
    """Put a fixed prior in the place of the search for the evidence maximum, which has its own tests."""
    with pytest.MonkeyPatch.context() as patch:
        fixed = {"kappa": 1e4, "shape": 100.0, "scale": 0.01}
        patch.setattr(identification, "maximise_evidence", lambda rows, family: (FAMILIES[family](**fixed), 0.0))
        yield


@pytest.fixture(scope="module")
def tuned(made, small):
    """What a short search finds for the yaw."""
    data = ps.regression_data(ps.denoise(ps.read_trial(made / "trial.csv")), small, "yaw", interval=1.0)
    return ps.tune_prior(data, "conjugate", evaluations=6, folds=3, rng=np.random.default_rng(1))


@pytest.fixture(scope="module")
def made(small, tmp_path_factory):
    """Folder with small.toml, the noisy trial.csv of that vessel and what `regress` made of it."""
    folder = tmp_path_factory.mktemp("made")
    (folder / "small.toml").write_text(toml(small))
    vessel, trial = folder / "small.toml", folder / "trial.csv"
    run("simulate", vessel, "--zigzag", "20/20", "--duration", 150, "--step", 0.1, "--noise", 0.001, "--out", trial)
    words = ("--vessel", vessel, "--family", "conjugate", "--draws", 200)
    run("regress", trial, *words, "--out", folder / "identified")
    return folder


def run(*words):
    """Run a command line that must succeed."""
    assert main(list(map(str, words))) == 0


def refused(capsys, *words):
    """Run a command line that cannot run; return its one sentence."""
    try:
        status = main(list(map(str, words)))
    except SystemExit as stop:
        status = stop.code
    printed = capsys.readouterr()
    sentences = [line for line in printed.err.splitlines() if line.startswith("pymc-ship: ")]
    assert status == 2
    assert printed.out == ""
    assert len(sentences) == 1
    assert printed.err.splitlines()[-1] == sentences[0]
    assert "Traceback" not in printed.err
    assert sentences[0].endswith(".")
    return sentences[0].removeprefix("pymc-ship: ")


def spaced(text):
    """Lines with one blank between words, whatever the columns of a table."""
    return [" ".join(line.split()) for line in text.splitlines()]


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if not path.is_dir())


def rows(path):
    """Rows of a CSV below its line of provenance."""
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if line[0] != "#"))


def column(table, name):
    return np.array([float(row[name]) for row in table])


# what the program says of itself


def test_help_is_quick_and_imports_nothing_heavy():
    """Median of three whole processes under half a second; the module list is that of the last."""
    script = (
        "import sys\nfrom pymc_ship.cli import main\n"
        "for words in (['--help'], *([name, '--help'] for name in sys.argv[1:])):\n"
        "    try:\n        main(words)\n    except SystemExit as stop:\n        assert stop.code == 0\n"
        "print(*sorted(sys.modules), file=sys.stderr)"
    )
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        done = subprocess.run(program("--help"), capture_output=True, text=True, check=True)
        seconds.append(time.perf_counter() - start)
    assert median(seconds) < 0.5
    assert all(name in done.stdout for name in COMMANDS)
    done = subprocess.run([sys.executable, "-c", script, *COMMANDS], capture_output=True, text=True, check=True)
    imported = {name.split(".")[0] for name in done.stderr.split()}
    assert imported.isdisjoint(HEAVY)
    assert "argparse" in imported


def test_every_command_has_seed_quiet_out_and_examples_that_parse(capsys):
    for name in COMMANDS:
        with pytest.raises(SystemExit, match="0"):
            main([name, "--help"])
        text = capsys.readouterr().out
        assert all(option in text for option in ("--seed", "--quiet", "--out"))
        examples = [line.strip() for line in text.splitlines() if line.startswith("  pymc-ship ")]
        assert 1 <= len(examples) <= 4
        for example in examples:
            args = parser().parse_args(shlex.split(example)[1:])
            assert args.command == name
            assert args.seed == 2020


def test_choices_are_those_of_the_api():
    assert tuple(FAMILIES) == command_parser.FAMILIES
    assert identification.SELECTIONS == command_parser.SELECTIONS
    assert set(SIDES) == set(command_parser.SIDES)
    assert METHODS == command_parser.METHODS
    assert (*DERIVATIVES, *WEAK) == command_parser.DERIVATIVES
    assert PRIORS == command_parser.DENOISE_PRIORS
    assert ship_model.PRIORS == command_parser.SHIP_PRIORS
    assert set(KINDS) == set(command_parser.TRAJECTORY_PRIORS)
    assert DOFS == command_parser.DOFS
    for split in command_parser.SPLITS:
        assert len(cross_validation.fold_rows(10, split=split, rng=np.random.default_rng(1))) == 5


def test_version_is_the_packages(capsys):
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    assert capsys.readouterr().out == f"pymc-ship {ps.__version__}\n"


def test_only_the_command_line_prints():
    source = Path(cli.__file__).parent
    printing = [path.name for path in source.glob("*.py") if "print(" in path.read_text().replace("fingerprint(", "")]
    assert printing == ["cli.py"]


# simulate


def test_simulate_writes_the_polluted_trial_and_prints_indices_of_the_clean_run(container, tmp_path, capsys):
    out = tmp_path / "new" / "trial.csv"
    run("simulate", "container", "--zigzag", "20/20", "--duration", 120, "--noise", 0.05, "--seed", 7, "--out", out)
    clean = ps.simulate(container, ps.zigzag(20, 20), duration=120.0, step=0.02)
    noisy = ps.pollute(clean, level=0.05, rng=np.random.default_rng(7))
    trial = ps.read_trial(out)
    for name in ("time", *CHANNELS):
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
    criteria = {row["criterion"]: row for row in ps.imo_criteria(ps.indices(expected), container)}
    word = {True: "pass", False: "fail"}[criteria["advance"]["passed"]]
    assert f"advance {criteria['advance']['value']:.4g} 4.5 L {word}" in spaced(capsys.readouterr().out)


def test_simulate_runs_a_programme_in_degrees(container, tmp_path, capsys):
    programme, out = tmp_path / "programme.csv", tmp_path / "trial.csv"
    programme.write_text("# a step to port\ntime,delta_deg\n0,0\n10,0\n12,20\n30,-15\n")
    run("simulate", "container", "--programme", programme, "--duration", 40, "--out", out)
    manoeuvre = ps.rudder_programme([0.0, 10.0, 12.0, 30.0], np.deg2rad([0.0, 0.0, 20.0, -15.0]))
    expected = ps.simulate(container, manoeuvre, duration=40.0, step=0.02)
    np.testing.assert_array_equal(ps.read_trial(out)["delta"], expected["delta"])
    assert capsys.readouterr().out == ""


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
    assert all(np.isfinite(trial[name]).all() for name in CHANNELS)


# denoise


def test_denoise_writes_the_smooth_trial_and_prints_the_noise(made, tmp_path, capsys):
    out = tmp_path / "smooth.csv"
    run("denoise", made / "trial.csv", "--wavelet", "db4", "--prior", "cauchy", "--decimated", "--out", out)
    expected = ps.denoise(ps.read_trial(made / "trial.csv"), "db4", "cauchy", False)
    smooth = ps.read_trial(out)
    printed = {line.split()[0]: line.split()[1:] for line in capsys.readouterr().out.splitlines()[1:]}
    assert set(printed) == {"u", "v", "r", "p", "phi", "psi"}
    for name in CHANNELS:
        np.testing.assert_array_equal(smooth[name], expected[name])
    for name, (sdev, unit) in printed.items():
        assert float(sdev) == pytest.approx(expected[name].attrs["noise_sdev"], rel=1e-3)
        assert unit == expected[name].attrs["units"]


# regress


def test_regress_writes_posteriors_and_coefficients(made, small, capsys):
    folder = made / "identified"
    assert files(folder) == ["coefficients.csv", *sorted(f"{dof}-conjugate.nc" for dof in small.dofs)]
    smooth = ps.denoise(ps.read_trial(made / "trial.csv"))
    found = identify(smooth, small, families=("conjugate",))
    rng = np.random.default_rng(2020)
    table = rows(folder / "coefficients.csv")
    assert [row["coefficient"] for row in table] == [name for names in TERMS.values() for name in names]
    for dof, tree in found.posteriors("conjugate", draws=200, rng=rng).items():
        written = ps.read_posterior(folder / f"{dof}-conjugate.nc")
        np.testing.assert_array_equal(written["posterior"]["coefficients"], tree["posterior"]["coefficients"])
        assert written.attrs["seed"] == 2020
        mine, exact = [row for row in table if row["dof"] == dof], found.exact["conjugate"][dof]
        np.testing.assert_array_equal(column(mine, "reference"), small.coefficients(dof))
        np.testing.assert_array_equal(column(mine, "mean"), exact.mean)
        np.testing.assert_array_equal(column(mine, "sd"), exact.sd)
        np.testing.assert_array_equal(column(mine, "quantile_5"), exact.quantiles([0.05])[0])
        np.testing.assert_array_equal(column(mine, "quantile_95"), exact.quantiles([0.95])[0])


def test_regress_raw_gives_back_the_vessel_of_a_perfect_trial(made, tmp_path, capsys, monkeypatch):
    vague = FAMILIES["conjugate"](kappa=1e12, shape=0.1, scale=1e-9)
    monkeypatch.setattr(identification, "maximise_evidence", lambda rows, family: (vague, 0.0))
    trial, out = tmp_path / "trial.csv", tmp_path / "out"
    run("simulate", made / "small.toml", "--zigzag", "20/20", "--duration", 100, "--step", 0.1, "--out", trial)
    words = ("--vessel", made / "small.toml", "--family", "conjugate", "--interval", "all", "--draws", 4)
    run("regress", trial, "--raw", *words, "--out", out)
    table = rows(out / "coefficients.csv")
    np.testing.assert_allclose(column(table, "mean"), column(table, "reference"), rtol=1e-8)
    assert ps.read_posterior(out / "yaw-conjugate.nc")["observed_data"].sizes["row"] in (999, 1000)
    line = next(line.split() for line in capsys.readouterr().out.splitlines() if line.startswith("Nv "))
    assert line[:4] == ["Nv", "yaw", "-300", "-300"]


def test_regress_denoises_as_the_command_denoise_does(made, small, tmp_path):
    smooth = tmp_path / "smooth.csv"
    run("denoise", made / "trial.csv", "--out", smooth)
    words = ("--vessel", made / "small.toml", "--family", "conjugate", "--draws", 200)
    run("regress", smooth, "--raw", *words, "--out", tmp_path)
    for dof in small.dofs:
        one, two = (ps.read_posterior(folder / f"{dof}-conjugate.nc") for folder in (made / "identified", tmp_path))
        np.testing.assert_array_equal(one["posterior"]["coefficients"], two["posterior"]["coefficients"])


@pytest.mark.parametrize(("derivative", "denoised"), [("central", True), ("weak", False)])
def test_regress_passes_its_options_on(made, small, tmp_path, monkeypatch, derivative, denoised):
    called = {}

    def identified(trial, vessel, **settings):
        called.update(settings, denoised="denoised" in trial.attrs)
        raise ValueError("enough.")

    monkeypatch.setattr(identification, "identify", identified)
    words = ("--family", "both", "--select", "bayesian_optimisation", "--interval", 2, "--derivative", derivative)
    main(["regress", str(made / "trial.csv"), "--vessel", "container", *map(str, words), "--out", str(tmp_path)])
    rng, _ = called.pop("rng"), called.pop("progress")
    assert rng.random() == np.random.default_rng(2020).random()
    assert called == {
        "families": ("conjugate", "semiconjugate"),
        "selection": "bayesian_optimisation",
        "interval": 2.0,
        "derivative": derivative,
        "denoised": denoised,
    }


# tune


def test_tune_prints_and_writes_what_the_search_found(made, small, tuned, tmp_path, capsys, monkeypatch):
    called = {}

    def tune_prior(data, family, **settings):
        called.update(settings, family=family, data=data)
        return tuned

    monkeypatch.setattr(ps, "tune_prior", tune_prior)
    out = tmp_path / "prior.json"
    words = ("--vessel", made / "small.toml", "--dof", "yaw", "--family", "conjugate", "--split", "random", "--raw")
    run("tune", made / "trial.csv", *words, "--evaluations", 6, "--folds", 3, "--interval", 3, "--out", out)
    data = ps.regression_data(ps.read_trial(made / "trial.csv"), small, "yaw", interval=3.0)
    np.testing.assert_array_equal(called.pop("data").design_matrix, data.design_matrix)
    assert called.pop("rng").random() == np.random.default_rng(2020).random()
    assert called == {"family": "conjugate", "evaluations": 6, "folds": 3, "split": "random"}
    written = json.loads(out.read_text())
    assert {
        name: written[name] for name in ("family", "mean", "kappa", "shape", "scale")
    } == tuned.prior.hyperparameters()
    assert (written["score"], written["score_se"]) == (tuned.score, tuned.score_se)
    text = capsys.readouterr().out
    assert f"{tuned.score:.4f} ± {tuned.score_se:.4f}" in text
    assert f"gained {tuned.score - tuned.evidence_score:+.4f} a row" in text
    scores = {line.rsplit(maxsplit=4)[0]: line.split()[-1] for line in text.splitlines()[1:5]}
    assert scores == {
        "chosen": f"{tuned.score:.4f}",
        "best seen": f"{tuned.seen_score:.4f}",
        "best of the Gaussian process": f"{tuned.surrogate_score:.4f}",
        "evidence maximum": f"{tuned.evidence_score:.4f}",
    }


# forecast


def test_forecast_writes_bands_and_prints_indices_beside_the_reference(made, small, tmp_path, capsys):
    words = ("--vessel", made / "small.toml", "--draws", 30, "--duration", 150, "--side", "starboard")
    run("forecast", made / "identified", *words, "--zigzag", "10/10", "--turn", 35, "--turn", 20, "--out", tmp_path)
    names = ("turning-circle-20-starboard", "turning-circle-35-starboard", "zigzag-10-10-starboard")
    assert files(tmp_path) == [f"{name}-conjugate.csv" for name in names]
    posteriors = {dof: ps.read_posterior(made / "identified" / f"{dof}-conjugate.nc") for dof in small.dofs}
    manoeuvre = ps.zigzag(10.0, 10.0, side="starboard")
    rng = np.random.default_rng(2020)
    tree = ps.forecast(small, posteriors, manoeuvre, draws=30, rng=rng, duration=150.0)
    table = rows(tmp_path / "zigzag-10-10-starboard-conjugate.csv")
    np.testing.assert_array_equal(column(table, "time"), tree["bands"]["time"])
    for name in CHANNELS:
        for band in ("lower", "median", "upper"):
            np.testing.assert_array_equal(column(table, f"{name}_{band}"), tree["bands"][name].sel(band=band))
    printed = capsys.readouterr().out
    assert printed.startswith("zigzag 10/10 starboard: 30 ships, 0 % diverged, bands of 90%\n")
    assert printed.count("\nExtrapolation is unknown: the posterior does not hold the motion it was fitted to.\n") == 3
    line = next(line.split() for line in printed.splitlines() if line.startswith("first overshoot angle"))
    reference = ps.indices(ps.simulate(small, manoeuvre, duration=150.0, record_interval=0.5))
    expected = [float(reference["first_overshoot_angle"]), *tree["index_bands"]["first_overshoot_angle"].values]
    np.testing.assert_allclose([float(word) for word in line[3:7]], expected, rtol=1e-3)
    assert expected[1] < expected[2] < expected[3]


def test_forecast_counts_diverged_ships(made, small, tmp_path, capsys):
    """A quarter of the draws gets a surge coefficient that runs away."""
    for dof in small.dofs:
        tree = ps.read_posterior(made / "identified" / f"{dof}-conjugate.nc")
        if dof == "surge":
            tree["posterior"]["coefficients"][0, :, 0] = 5.0
        ps.write_posterior(tree, tmp_path / f"{dof}-conjugate.nc")
    words = ("--vessel", made / "small.toml", "--draws", 200, "--duration", 30, "--turn", 35)
    run("forecast", tmp_path, *words, "--out", tmp_path / "out")
    assert "200 ships, 25 % diverged" in capsys.readouterr().out


@pytest.mark.parametrize("ending", ["nc", "zarr"])
def test_forecast_takes_a_joint_posterior_and_says_what_it_extrapolates(made, small, tmp_path, capsys, ending):
    """Shares stand above the indices and on the bands, the sentence below the indices."""
    tree = joint_posterior(made, small)
    ps.write_posterior(tree, tmp_path / f"joint.{ending}")
    words = ("--vessel", made / "small.toml", "--draws", 30, "--duration", 100, "--turn", 35)
    run("forecast", tmp_path / f"joint.{ending}", *words, "--out", tmp_path / "out")
    settings = {"draws": 30, "rng": np.random.default_rng(2020), "duration": 100.0}
    found = ps.forecast(small, tree, ps.turning_circle(35.0), **settings)
    share = f"{100.0 * found.attrs['share_extrapolated']:.3g} % of the instants"
    assert float(share.split()[0]) > 50.0
    first, *_, last = capsys.readouterr().out.splitlines()
    assert first == f"turning circle 35 port: 30 ships, 0 % diverged, {share} extrapolated, bands of 90%"
    assert last == found.attrs["extrapolation"]
    assert last.startswith(f"{share} lie outside the motion of the record")
    assert "speed falls to " in last
    assert files(tmp_path / "out") == ["turning-circle-35-port-joint.csv"]
    written = tmp_path / "out" / "turning-circle-35-port-joint.csv"
    assert written.read_text().splitlines()[1] == f"# 30 ships, 0 % diverged, {share} extrapolated"
    np.testing.assert_array_equal(column(rows(written), "u_lower"), found["bands"]["u"].sel(band="lower"))


def joint_posterior(made, small):
    """What `regress` made as one posterior, with the motion of the trial."""
    trees = [ps.read_posterior(made / "identified" / f"{dof}-conjugate.nc") for dof in small.dofs]
    draws = xr.concat([tree["posterior"]["coefficients"] for tree in trees], "coefficient")
    trial = ps.denoise(ps.read_trial(made / "trial.csv"))
    motion, _, _ = prime_record(small, {name: trial[name].values for name in ("u", "v", "r", "delta")})
    motion = xr.DataArray(list(motion.values()), {"symbol": list(motion)}, ("symbol", "row"), "motion")
    groups = {"posterior": draws.to_dataset(), "constant_data": motion.to_dataset()}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs={"vessel": "small"}), **groups})


@pytest.mark.slow
def test_the_round_trip_forecasts_the_reference_ship(tmp_path, capsys, monkeypatch):
    """Simulate, denoise, identify with the evidence maximum, forecast: 1 % of noise, the paper's ship and record."""
    monkeypatch.setattr(identification, "maximise_evidence", ps.maximise_evidence)
    monkeypatch.chdir(tmp_path)
    run("simulate", "container", "--zigzag", "20/20", "--noise", 0.01, "--out", "trial.csv")
    run("denoise", "trial.csv", "--out", "smooth.csv")
    words = ("--vessel", "container", "--family", "conjugate")
    run("regress", "smooth.csv", "--raw", *words, "--draws", 400, "--out", "identified")
    capsys.readouterr()
    run("forecast", "identified", *words, "--draws", 100, "--zigzag", "10/10", "--turn", 35, "--out", "forecast")
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    printed = {
        " ".join(line[:-5]): [float(word) for word in line[-5:-1]]
        for line in lines
        if line[-1:] == ["m"] and "-" not in line
    }
    for name in ("advance", "transfer", "tactical diameter", "initial turning distance"):
        reference, lower, middle, upper = printed[name]
        assert lower < middle < upper
        assert middle == pytest.approx(reference, rel=0.05)


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
    assert capsys.readouterr().err.splitlines() == [
        f"{trial}: Columns read: delta from 'RUD' in deg.",
        f"{trial}: delta changed in sign: the file counts it positive to starboard.",
        f"{trial}: 1 gap of up to 1 sample: 1 filled by interpolation.",
        "pymc-ship: stopped.",
    ]
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
    vessel = ("--vessel", made / "small.toml")
    words = {
        "simulate": (made / "small.toml", "--zigzag", "20/20", "--duration", 20, "--noise", 0.01),
        "regress": (made / "trial.csv", *vessel, "--family", "conjugate", "--draws", 40, "--interval", 2),
        "forecast": (made / "identified", *vessel, "--draws", 10, "--duration", 20, "--turn", 35),
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


def test_study_passes_its_options_on(tmp_path, monkeypatch, capsys):
    called = []

    def reported_study(out, **settings):
        called.append((out, settings))
        return SimpleNamespace(comparisons=[]), Path(out) / "index.html"

    monkeypatch.setattr(page, "reported_study", reported_study)
    run("study", "--vessel", "my/other.toml", "--level", 0.05, "--seed", 3, "--quiet")
    ((out, settings),) = called
    assert out == Path("reports/other")
    settings.pop("progress")("unheard")
    assert settings == {"vessel": "my/other.toml", "level": 0.05, "seed": 3}
    run("study", "--out", tmp_path)
    assert called[1][0] == str(tmp_path)
    assert capsys.readouterr().err == f"Written to {tmp_path / 'index.html'}.\n"


@pytest.mark.parametrize("failed", [[], ["nuts: largest R-hat 1.02 (Yv), to be < 1.01"]])
def test_a_study_whose_check_fails_writes_its_pages_and_ends_with_status_3(tmp_path, monkeypatch, capsys, failed):
    report = page
    good, poor = (
        SimpleNamespace(name=name, failed_gates=said, disagreements=[])
        for name, said in zip("ab", ([], failed), strict=True)
    )
    result = SimpleNamespace(comparisons=[good, poor], vessel=None, seed=3, draws={})
    for name, value in {"run_study": result, "_figures": {}, "render": "new", "csv_tables": {}}.items():
        monkeypatch.setattr(report, name, lambda *args, value=value, **settings: value)
    monkeypatch.setattr(report, "diagnostic_page", lambda *args, **settings: "diagnosed")
    assert main(["study", "--quiet", "--out", str(tmp_path)]) == (3 if failed else 0)
    printed = capsys.readouterr()
    sentence = (
        "pymc-ship: A convergence gate or the agreement with the exact posterior fails in 1 of 2 posteriors, first in "
        "b: nuts: largest R-hat 1.02 (Yv), to be < 1.01; the page is written and names them all.\n"
    )
    assert (printed.out, printed.err) == ("", sentence if failed else "")
    pages = [(tmp_path / name).read_text() for name in ("index.html", "diagnostics.html")]
    assert pages == ["new", "diagnosed"]


# what cannot run


def spoil(trial, how):
    """Text of a trial with a defect."""
    header, *lines = [line for line in trial.read_text().splitlines() if line[0] != "#"]
    table = [dict(zip(header.split(","), line.split(","), strict=True)) for line in lines]
    if how == "nan":
        table = [row | {"v": "nan"} for row in table]
    elif how == "time":
        table = [row | {"time": "5.7"} for row in table]
    elif how == "missing":
        table = [{name: cell for name, cell in row.items() if name != "r"} for row in table]
    elif how == "short":
        table = table[:20]
    elif how == "rudder":
        table = [row | {"delta": "0.1"} for row in table]
    elif how == "text":
        table[57]["v"] = "fast"
    return "\n".join([",".join(table[0]), *(",".join(row.values()) for row in table)]) + "\n"


@pytest.mark.parametrize("command", ["regress", "tune"])
@pytest.mark.parametrize(
    ("how", "sentence"),
    [
        ("nan", "The trial needs the channels u, v, r, delta; v missing; add them."),
        ("time", "the time of a trial must increase, found 5.7 s in every row; correct it."),
        ("missing", "The trial needs the channels u, v, r, delta; r missing; add them."),
        ("short", "The {dof} of 'small' has {n} terms and needs as many rows, found 2; use a longer trial or"),
        ("rudder", "The rudder of a trial must move, found a constant angle; use one that steers."),
        ("text", "line 59, column v: a number is needed, found 'fast'; correct or empty the cell."),
    ],
)
def test_a_trial_that_cannot_be_used_is_refused(made, small, tmp_path, capsys, command, how, sentence):
    trial, out = tmp_path / "trial.csv", tmp_path / "out"
    trial.write_text(spoil(made / "trial.csv", how))
    words = ("--vessel", made / "small.toml", "--family", "conjugate", "--out", out)
    dof = "surge" if command == "regress" else "yaw"
    more = ("--dof", dof) if command == "tune" else ()
    message = refused(capsys, command, trial, *words, *more)
    assert sentence.format(dof=dof, n=len(TERMS[dof])) in message
    assert files(tmp_path) == ["trial.csv"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            "simulate tanker --turn 35 --out {out}",
            "A vessel is one of .*container.* or the path of a .toml file; found 'tanker'",
        ),
        (
            "simulate {tmp}/none.toml --turn 35 --out {out}",
            "none.toml cannot be read: No such file or directory; check",
        ),
        ("simulate {tmp}/odd.toml --turn 35 --out {out}", r"odd.toml: coefficients.yaw.Nvzz is no coefficient"),
        ("regress {made}/trial.csv --vessel {tmp}/odd.toml --out {out}", r"coefficients.yaw.Nvzz is no coefficient"),
        ("study --vessel tanker --out {out}", "A vessel is one of .* found 'tanker'"),
        (
            "simulate container --zigzag 20-20 --out {out}",
            "a zigzag is RUDDER/HEADING in deg such as 20/20, found '20-20'",
        ),
        ("simulate container --zigzag 20/20/20 --out {out}", "found '20/20/20'"),
        ("simulate container --zigzag 0/20 --out {out}", "rudder_deg is a magnitude between 0 and 90 deg, found 0.0"),
        ("simulate container --zigzag 20/20 --turn 35 --out {out}", "not allowed with argument --zigzag"),
        ("simulate container --out {out}", "one of the arguments --zigzag --turn --programme is required"),
        ("simulate container --turn 35 --step 0 --out {out}", "The step must be positive, found 0.0 s"),
        ("simulate container --turn 35 --duration nan --out {out}", "The duration must be positive, found nan s"),
        ("simulate container --turn 35 --duration 0.02 --out {out}", "at least two samples, found 1"),
        (
            "simulate container --turn 35 --duration 1e13 --out {out}",
            "The memory does not hold this run: .*; make it shorter",
        ),
        ("simulate container --turn 35 --speed -1 --out {out}", "The approach speed must be positive"),
        ("simulate container --turn 35 --noise -1 --duration 9 --out {out}", "The noise level is a number from 0 up"),
        (
            "simulate container --turn 35 --noise loud --out {out}",
            "a noise level is a number or 'literal', found 'loud'",
        ),
        ("simulate container --turn 35 --seed -1 --out {out}", "a seed is a whole number from 0 up, found '-1'"),
        ("simulate container --programme {tmp}/none.csv --out {out}", "none.csv cannot be read: No such file"),
        (
            "simulate container --programme {made}/trial.csv --out {out}",
            "trial.csv cannot be read: the header is not time,delta_deg but 'time,u,v",
        ),
        (
            "simulate container --programme {tmp}/rad.csv --out {out}",
            "the header is not time,delta_deg but 'time,delta'; mend it",
        ),
        (
            "simulate container --programme {tmp}/wide.csv --out {out}",
            "wide.csv cannot be read: cannot reshape .*; mend it",
        ),
        ("simulate container --programme {tmp}/rad.csv --side port --out {out}", "has its own sides, found --side"),
        ("denoise {tmp}/none.csv --out {out}", "none.csv cannot be read: No such file or directory; check the path"),
        ("denoise {tmp}/rad.csv --out {out}", "needs one of the channels u, v, r, p, phi, psi, found none"),
        ("denoise {made}/trial.csv --wavelet sinus --out {out}", "needs an orthogonal wavelet, found 'sinus'"),
        ("denoise {made}/trial.csv --prior flat --out {out}", "invalid choice: 'flat'"),
        ("regress {made}/trial.csv --vessel container --family flat --out {out}", "invalid choice: 'flat'"),
        ("regress {made}/trial.csv --vessel container --draws 10 --out {out}", "a multiple of 4, found '10'"),
        ("regress {made}/trial.csv --vessel container --interval soon --out {out}", "seconds or 'all', found 'soon'"),
        ("regress {made}/trial.csv --vessel {small} --interval 0.15 --out {out}", "multiple of the sampling interval"),
        (
            "tune {made}/trial.csv --vessel {small} --dof roll --family conjugate --out {out}",
            "surge, sway, yaw; found 'roll'",
        ),
        (
            "tune {made}/trial.csv --vessel {small} --dof yaw --family conjugate --evaluations 2 --out {out}",
            "at least 6",
        ),
        ("tune {made}/trial.csv --vessel {small} --dof yaw --family conjugate --folds 1 --out {out}", "2 to 150 folds"),
        ("forecast {made}/identified --vessel {small} --out {out}", "needs a manoeuvre, found none; add --zigzag"),
        (
            "forecast {tmp} --vessel {small} --turn 35 --out {out}",
            "found nothing at .*surge-conjugate.nc; check the path",
        ),
        ("forecast {made}/identified --vessel {other} --turn 35 --out {out}", "is to be of 'other', found 'small' in"),
        ("forecast {tmp}/junk --vessel {small} --turn 35 --out {out}", "surge-conjugate.nc is no posterior"),
        ("forecast {tmp}/swapped --vessel {small} --turn 35 --out {out}", "is no posterior of the surge"),
        ("forecast {made}/identified --vessel {small} --turn 35 --draws 1 --out {out}", "needs two draws"),
        (
            "forecast {made}/identified/yaw-conjugate.nc --vessel {small} --turn 35 --out {out}",
            "The joint posterior lacks Xdeltadelta, .* of 'small'; use its own terms",
        ),
        (
            "forecast {made}/identified/yaw-conjugate.nc --vessel {other} --turn 35 --out {out}",
            "is to be of 'other', found 'small' in .*yaw-conjugate.nc",
        ),
        ("sail", r"argument COMMAND: invalid choice: 'sail' \(choose from"),
        ("", "the following arguments are required: COMMAND"),
    ],
)
def test_what_cannot_run_is_one_sentence_and_leaves_no_file(made, small, tmp_path, capsys, words, sentence):
    (tmp_path / "odd.toml").write_text(toml(small).replace("Nv =", "Nvzz ="))
    (tmp_path / "other.toml").write_text(toml(replace(small, name="other")))
    (tmp_path / "rad.csv").write_text("time,delta\n0,0.1\n1,0.2\n")
    (tmp_path / "wide.csv").write_text("time,delta_deg\n0,1,2,3\n4,5,6,7\n")
    (tmp_path / "junk").mkdir()
    (tmp_path / "junk" / "surge-conjugate.nc").write_text("no NetCDF")
    (tmp_path / "swapped").mkdir()
    yaw = (made / "identified" / "yaw-conjugate.nc").read_bytes()
    (tmp_path / "swapped" / "surge-conjugate.nc").write_bytes(yaw)
    before = files(tmp_path)
    places = {"tmp": tmp_path, "out": tmp_path / "out", "made": made, "small": made / "small.toml"}
    message = refused(capsys, *words.format(**places, other=tmp_path / "other.toml").split())
    assert re.search(sentence, message), message
    assert files(tmp_path) == before


ALL_COMMANDS = [
    "simulate container --turn 35",
    "denoise {made}/trial.csv",
    "regress {made}/trial.csv --vessel {made}/small.toml",
    "tune {made}/trial.csv --vessel {made}/small.toml --dof yaw --family conjugate",
    "forecast {made}/identified --vessel {made}/small.toml --turn 35",
    "study",
]
"""Each command, to be given an --out."""

LONG_WORK = {
    "simulate": "simulate",
    "denoise": "denoise",
    "regress": "regression_data",
    "tune": "tune_prior",
    "forecast": "forecast",
    "study": "simulate",
}
"""What each command spends its time on."""


def forbid(*args, **settings):
    raise AssertionError("long work has begun")


def stop(*args, **settings):
    raise KeyboardInterrupt


@pytest.mark.parametrize("words", ALL_COMMANDS)
def test_a_place_that_cannot_be_written_is_refused_before_long_work(made, tmp_path, capsys, monkeypatch, words):
    """Below a regular file nothing can be written, not even by root."""
    (tmp_path / "file").write_text("kept")
    command, *rest = words.format(made=made).split()
    monkeypatch.setattr(ps, LONG_WORK[command], forbid)
    monkeypatch.setattr(identification, "identify", forbid)
    message = refused(capsys, command, *rest, "--out", tmp_path / "file" / "below" / "out.csv")
    assert re.fullmatch(r".*file/below.* cannot be written: Not a directory; choose another place\.", message)
    assert files(tmp_path) == ["file"]
    assert (tmp_path / "file").read_text() == "kept"


@pytest.mark.parametrize("words", ALL_COMMANDS[:2] + ALL_COMMANDS[3:4])
def test_a_file_never_takes_the_place_of_a_folder(made, tmp_path, capsys, words):
    (tmp_path / "kept.csv").write_text("kept")
    message = refused(capsys, *words.format(made=made).split(), "--out", tmp_path)
    assert message == f"{tmp_path} is a folder; give the name of a file in it."
    assert files(tmp_path) == ["kept.csv"]


@pytest.mark.parametrize(("lasts", "ends"), [(10.0, 130), (0.0, 2)])
def test_an_interrupt_that_python_ignores_still_ends_the_run(tmp_path, capsys, monkeypatch, lasts, ends):
    """But not what comes after a command that was over first."""

    def work(*args, **settings):
        referent = set()
        kept = weakref.ref(referent, stop)
        del referent
        assert kept() is None
        time.sleep(lasts)
        raise ValueError("over.")

    monkeypatch.setattr(ps, "simulate", work)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        status = main(["simulate", "container", "--turn", "35", "--out", str(tmp_path / "trial.csv")])
        time.sleep(0.2)
    finally:
        signal.signal(signal.SIGINT, before)
    assert status == ends
    assert ("interrupted; nothing is left half-written" in capsys.readouterr().err) == (ends == 130)


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (OSError(28, "No space left on device"), "[Errno 28] No space left on device."),
        (ValueError("Two lines\n  of a library"), "Two lines of a library."),
        (MemoryError("much"), "The memory does not hold this run: much; make it shorter."),
    ],
)
def test_errors_of_others_become_one_sentence(made, tmp_path, capsys, monkeypatch, error, sentence):
    def denoise(*args, **settings):
        raise error

    monkeypatch.setattr(ps, "denoise", denoise)
    assert refused(capsys, "denoise", made / "trial.csv", "--out", tmp_path / "smooth.csv") == sentence
    assert files(tmp_path) == []


# what is interrupted


@pytest.mark.parametrize("words", ALL_COMMANDS[:5])
@pytest.mark.parametrize("place", ["api", "writing"])
def test_an_interrupted_run_keeps_the_earlier_result_and_leaves_nothing_else(
    made, tuned, tmp_path, capsys, monkeypatch, words, place
):
    command, *rest = words.format(made=made).split()
    results = {
        "regress": ["out/coefficients.csv", "out/sway-conjugate.nc"],
        "forecast": ["out/turning-circle-35-port-conjugate.csv"],
    }.get(command, ["out"])
    for name in results:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("earlier")
    monkeypatch.setattr(ps, "tune_prior", lambda *args, **settings: tuned)
    if place == "api":
        monkeypatch.setattr(ps, LONG_WORK[command], stop)
        monkeypatch.setattr(identification, "identify", stop)
    else:
        monkeypatch.setattr("os.replace", stop)
    assert main([command, *rest, "--quiet", "--out", str(tmp_path / "out")]) == 130
    printed = capsys.readouterr()
    expected = "pymc-ship: interrupted; nothing is left half-written and earlier results stand as they were.\n"
    assert (printed.out, printed.err) == ("", expected)
    assert files(tmp_path) == results
    assert {(tmp_path / name).read_text() for name in results} == {"earlier"}
    assert [path for path in tmp_path.rglob("*") if "partial" in path.name] == []


def test_an_interrupted_forecast_moves_no_file_before_all_are_there(made, tmp_path, monkeypatch):
    """The second of two manoeuvres is interrupted; the first is not left behind."""
    forecast, calls = ps.forecast, []

    def once(*args, **settings):
        calls.append(args[2].label)
        return stop() if len(calls) > 1 else forecast(*args, **settings)

    monkeypatch.setattr(ps, "forecast", once)
    words = ("--vessel", made / "small.toml", "--draws", 4, "--duration", 10, "--zigzag", "10/10", "--turn", 35)
    assert main(["forecast", *map(str, (made / "identified", *words)), "--out", str(tmp_path)]) == 130
    assert calls == ["zigzag 10/10 port", "turning circle 35 port"]
    assert list(tmp_path.iterdir()) == []


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


@pytest.mark.slow
def test_control_c_ends_a_true_run(made, tmp_path):
    words = ("tune", made / "trial.csv", "--vessel", made / "small.toml", "--dof", "yaw", "--family", "conjugate")
    words = program(*words, "--evaluations", 5000, "--out", tmp_path / "prior.json")
    listen = functools.partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a runner in the background ignores it
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen(words, preexec_fn=listen, **pipes) as process:
        try:
            told = [process.stderr.readline() for _ in range(2)]
            time.sleep(0.3)
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=20)
        finally:
            process.kill()
    assert told == ["denoising\n", "tuning the conjugate prior of the yaw: 5000 evaluations\n"]
    assert err == "pymc-ship: interrupted; nothing is left half-written and earlier results stand as they were.\n"
    assert (process.returncode, out) == (130, "")
    assert list(tmp_path.iterdir()) == []
