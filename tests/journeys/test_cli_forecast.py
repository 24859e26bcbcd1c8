import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.inference.regression import identify as identification
from pymc_ship.physics.motion.prime_record import prime_record
from pymc_ship.ships.forecasting.forecast import NO_ROLL
from pymc_ship.trial.channels import CHANNELS, SIMULATED
from tests.journeys.cases import column, files, rows, run


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
    assert "roll" not in small.dofs
    assert not {"p_lower", "phi_median"} & set(table[0])
    for name in (name for name in SIMULATED if not CHANNELS[name].rolling):
        for band in ("lower", "median", "upper"):
            np.testing.assert_array_equal(column(table, f"{name}_{band}"), tree["bands"][name].sel(band=band))
    printed = capsys.readouterr().out
    assert printed.startswith("zigzag 10/10 starboard: 30 ships, 0 % diverged, bands of 90%\n")
    assert printed.count("\nExtrapolation is unknown: the posterior does not hold the motion it was fitted to.\n") == 3
    assert "maximum roll angle" not in printed
    assert printed.count(f"\n{NO_ROLL}\n") == 3
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
