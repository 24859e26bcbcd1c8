from html import unescape

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.inference.regression import identify as identification
from pymc_ship.physics.motion.prime_record import prime_record
from pymc_ship.physics.motion.stepping import simulation_settings
from pymc_ship.ships.forecasting.extrapolation import UNKNOWN
from pymc_ship.ships.forecasting.forecast import NO_ROLL
from tests.journeys.cases import files, rows, run
from tests.ships.ensemble.cases import posterior_forecast


def posterior_of(made, small):
    return {dof: ps.read_posterior(made / "identified" / f"{dof}-conjugate.nc") for dof in small.dofs}


@pytest.mark.usefixtures("undrawn")
def test_forecast_writes_a_page_and_prints_indices_beside_the_reference(made, small, tmp_path, capsys):
    words = ("--vessel", made / "small.toml", "--draws", 30, "--duration", 150, "--side", "starboard")
    run("forecast", made / "identified", *words, "--zigzag", "10/10", "--turn", 35, "--turn", 20, "--out", tmp_path)
    names = ("turning_circle_20_starboard", "turning_circle_35_starboard", "zigzag_10_10_starboard")
    drawn = [f"{name}_{kind}" for name in names for kind in ("heading_and_rudder", "motion", "track")]
    assert files(tmp_path) == sorted(
        ["forecast.html", "tables/forecast_verdict.csv"]
        + [f"figures/forecast_{name}.png" for name in ("forces", "overview")]
        + [f"tables/forecast_{name}{what}.csv" for name in names for what in ("", "_bands")]
        + [f"figures/forecast_{name}.png" for name in drawn]
    )
    manoeuvre = ps.zigzag(10.0, 10.0, side="starboard")
    settings = simulation_settings(small, duration=150.0)
    tree = posterior_forecast(small, posterior_of(made, small), manoeuvre, draws=30, rng=2020, ci_prob=0.95, **settings)
    table = {row["index"]: row for row in rows(tmp_path / "tables" / "forecast_zigzag_10_10_starboard.csv")}
    assert "maximum roll angle" not in table
    for name in ("first_overshoot_angle", "first_overshoot_time"):
        for band in ("lower", "median", "upper"):
            expected = float(tree["index_bands"][name].sel(band=band))
            assert float(table[name.replace("_", " ")][band]) == pytest.approx(expected, rel=1e-5)
    over_time = rows(tmp_path / "tables" / "forecast_zigzag_10_10_starboard_bands.csv")
    for name in ("lower", "median", "upper"):
        expected = tree["bands"]["psi"].sel(band=name).values
        np.testing.assert_allclose([float(row[f"psi_{name}"]) for row in over_time], expected, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose([float(row["time"]) for row in over_time], tree["bands"]["time"], rtol=1e-5)
    printed = capsys.readouterr().out
    assert printed.startswith("zigzag 10/10 starboard: 30 draws, 0 % diverged, bands of 95%\n")
    assert printed.count(f"\n{UNKNOWN}\n") == 3
    assert "maximum roll angle" not in printed
    assert printed.count(f"\n{NO_ROLL}\n") == 3
    line = next(line.split() for line in printed.splitlines() if line.startswith("first overshoot angle"))
    reference = ps.indices(ps.simulate(small, manoeuvre, **settings))
    expected = [float(reference["first_overshoot_angle"]), *tree["index_bands"]["first_overshoot_angle"].values]
    np.testing.assert_allclose([float(word) for word in line[3:7]], expected, rtol=1e-3)
    assert expected[1] < expected[2] < expected[3]


@pytest.mark.usefixtures("undrawn")
def test_forecast_counts_diverged_ships(made, small, tmp_path, capsys):
    """A quarter of the draws gets a surge coefficient that runs away."""
    for dof in small.dofs:
        tree = ps.read_posterior(made / "identified" / f"{dof}-conjugate.nc")
        if dof == "surge":
            tree["posterior"]["coefficients"][:2, ::4, 0] = 5.0
            tree["posterior"]["coefficients"][2:, 2::4, 0] = 5.0
        ps.write_posterior(tree, tmp_path / f"{dof}-conjugate.nc")
    words = ("--vessel", made / "small.toml", "--draws", 200, "--duration", 30, "--turn", 35)
    run("forecast", tmp_path, *words, "--out", tmp_path / "out")
    assert "200 draws, 25 % diverged" in capsys.readouterr().out


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("ending", ["nc", "zarr"])
def test_forecast_takes_a_joint_posterior_and_says_what_it_extrapolates(made, small, tmp_path, capsys, ending):
    """Shares stand above the indices, the sentence below them and on the page."""
    tree = joint_posterior(made, small)
    ps.write_posterior(tree, tmp_path / f"joint.{ending}")
    words = ("--vessel", made / "small.toml", "--draws", 30, "--duration", 100, "--turn", 35, "--side", "port")
    run("forecast", tmp_path / f"joint.{ending}", *words, "--out", tmp_path / "out")
    settings = simulation_settings(small, duration=100.0, ci_prob=0.95)
    found = posterior_forecast(small, tree, ps.turning_circle(35.0), draws=30, rng=2020, **settings)
    share = f"{100.0 * found.attrs['extrapolated_fraction']:.3g} % of the instants"
    assert float(share.split()[0]) > 50.0
    first, *others = capsys.readouterr().out.splitlines()
    assert first == f"turning circle 35 port: 30 draws, 0 % diverged, {share} extrapolated, bands of 95%"
    assert found.attrs["extrapolation"] in others
    assert found.attrs["extrapolation"].startswith(f"{share} lie outside the motion of the record")
    assert "speed falls to " in found.attrs["extrapolation"]
    assert unescape(found.attrs["extrapolation"]) in unescape((tmp_path / "out" / "forecast.html").read_text())


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("ending", ["nc", "zarr"])
def test_the_page_of_a_posterior_stands_beside_its_file(made, small, tmp_path, ending):
    ps.write_posterior(joint_posterior(made, small), tmp_path / f"joint.{ending}")
    words = ("--vessel", made / "small.toml", "--draws", 5, "--duration", 30, "--turn", 35)
    run("forecast", tmp_path / f"joint.{ending}", *words)
    assert (tmp_path / "forecast.html").is_file()


@pytest.mark.usefixtures("undrawn")
def test_a_posterior_has_the_options_of_a_ship(made, small, tmp_path, capsys):
    """A current carries it, a measured trial stands beside it, a spiral is told; it does not know revolutions."""
    run("simulate", made / "small.toml", "--zigzag", "10/10", "--duration", 250, "--out", tmp_path / "zigzag.csv")
    capsys.readouterr()
    words = ("forecast", made / "identified", "--vessel", made / "small.toml", "--draws", 20, "--duration", 250)
    run(*words, "--measured", tmp_path / "zigzag.csv", "--out", tmp_path / "beside")
    assert " measured " in capsys.readouterr().out
    beside = distance_of(tmp_path / "beside")
    assert abs(float(beside["error"])) < 5.0
    run(*words, "--zigzag", "10/10", "--current", "1.0/0", "--spiral", "--out", tmp_path / "drifting")
    assert '<section id="spiral">' in (tmp_path / "drifting" / "forecast.html").read_text(encoding="utf-8")
    assert float(distance_of(tmp_path / "drifting")["median"]) > 1.05 * float(beside["median"])
    assert main(list(map(str, (*words, "--zigzag", "10/10", "--n", 1.0)))) == 2
    assert (
        "A forecast with revolutions needs forces that depend on revolutions, found no such term set"
        in capsys.readouterr().err
    )


def distance_of(out):
    """Row of the initial turning distance of the zigzag that is forecast."""
    (row,) = (
        row
        for row in rows(out / "tables" / "forecast_zigzag_10_10_port.csv")
        if row["index"] == "initial turning distance"
    )
    return row


def joint_posterior(made, small):
    """What `regress` made as one posterior, with the motion of the trial."""
    trees = [ps.read_posterior(made / "identified" / f"{dof}-conjugate.nc") for dof in small.dofs]
    draws = xr.concat([tree["posterior"]["coefficients"] for tree in trees], "coefficient")
    trial = ps.denoise(ps.read_trial(made / "trial.csv"))
    motion, _, _ = prime_record(small, {name: trial[name].values for name in ("u", "v", "r", "delta")})
    motion = xr.DataArray(list(motion.values()), {"symbol": list(motion)}, ("symbol", "row"), "motion")
    groups = {"posterior": draws.to_dataset(), "constant_data": motion.to_dataset()}
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs={"vessel": "small"}), **groups})


@pytest.mark.usefixtures("undrawn")
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
    options = ["--draws", "100", "--zigzag", "10/10", "--turn", "35", "--side", "port", "--out", "forecast"]
    run("forecast", "identified", *words, *options)
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
