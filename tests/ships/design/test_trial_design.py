"""Designs: gains that are those of the formula, greedy choices, predictions that come true, refusals."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.cli.parser import CRITERIA as CLI_CRITERIA
from pymc_ship.inference.regression.tree import write_posterior
from pymc_ship.inference.trajectory.fit import fit_trajectory, initial_problem
from pymc_ship.inference.trajectory.prior import CoefficientPrior
from pymc_ship.inference.trajectory.runs import trajectory_run
from pymc_ship.physics.motion.equations import STATE
from pymc_ship.physics.vessel.vessel import coefficient_names, reference_coefficients
from pymc_ship.ships.design.closed_loop import STEP, closed_loop_sensitivities
from pymc_ship.ships.design.trial_design import CRITERIA
from tests.inference.identifiability.information import fisher_information

SD = {"u": 0.02, "v": 0.02, "r": 2e-4}
SHORT = {"duration": 60.0, "interval": 0.1, "draws": 2}
CANDIDATES = {
    "zigzag": ps.zigzag(20, 20),
    "slow zigzag": ps.zigzag(20, 20, approach_speed=6.0),
    "circle": ps.turning_circle(35),
}


def rng(seed=1):
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def reference(small):
    return reference_coefficients(small)


def simulated(vessel, manoeuvre):
    return ps.simulate(vessel, manoeuvre, duration=60.0, step=STEP, method="rk4")


def information(vessel, manoeuvre, factor=1.0):
    """Fisher information of a run at the reference coefficients."""
    sd = {name: factor * value for name, value in SD.items()}
    start = [np.append(manoeuvre.approach_speed or vessel.particulars.nominal_speed, np.zeros(4))]
    return fisher_information(simulated(vessel, manoeuvre), vessel, noise_sd=sd, initial_states=start)


@pytest.fixture(scope="module")
def known(small):
    """Covariance after the zigzag with a little prior, and noise so low that draws hardly differ from the mean."""
    reference = reference_coefficients(small)
    return np.linalg.inv(information(small, ps.zigzag(20, 20), 1e-4) + np.diag(1.0 / (1e-4 * reference) ** 2))


@pytest.fixture(scope="module")
def quiet():
    return SHORT | {"noise_sd": {name: 1e-4 * value for name, value in SD.items()}}


def log_det(matrix):
    sd = np.sqrt(np.diag(matrix))
    return np.linalg.slogdet(matrix / np.outer(sd, sd))[1] + 2.0 * np.log(sd).sum()


def joint_tree(vessel, mean, covariance, draws=4000, **constant):
    """Joint posterior of normal draws, in two chains."""
    values = rng(5).multivariate_normal(mean, covariance, draws, method="eigh").reshape(2, draws // 2, -1)
    names = coefficient_names(vessel)
    groups = {
        "/posterior": xr.Dataset({"coefficients": (("chain", "draw", "coefficient"), values)}, {"coefficient": names})
    }
    if constant:
        groups["/constant_data"] = xr.Dataset(constant, {"channel": list(SD)})
    tree = xr.DataTree.from_dict(groups)
    tree.attrs = {"vessel": vessel.name, "noise_model": "white"}
    return tree


def fitted_noise(factor=1.0, correlation=0.0):
    """Constant data of a joint posterior: blocks of 0.2 s of samples every 0.1 s."""
    sd = factor * np.array(list(SD.values())) / np.sqrt(2.0)
    return {
        "time": ("row", 0.05 + 0.2 * np.arange(300)),
        "block_sd": (("run_index", "channel"), sd[None]),
        "correlation": (("run_index", "channel"), np.full((1, 3), correlation)),
    }


# gains and predictions


def test_gain_and_predicted_sd_are_those_of_the_information(small, reference, known, quiet):
    found = ps.design_trials(small, (reference, known), CANDIDATES, 1, rng=rng(), **quiet)
    F = {name: information(small, one, 1e-4) for name, one in CANDIDATES.items()}
    precision = np.linalg.inv(known)
    gains = [log_det(precision + one) - log_det(precision) for one in F.values()]
    np.testing.assert_allclose(found["gain"].values[0], gains, rtol=1e-2)
    best = list(F)[int(np.argmax(gains))]
    assert found["chosen"].values.tolist() == [best]
    np.testing.assert_allclose(found["sd"].sel(stage=0), np.sqrt(np.diag(known)), rtol=1e-6)
    after = np.sqrt(np.diag(np.linalg.inv(precision + F[best])))
    np.testing.assert_allclose(found["sd"].sel(stage=1), after, rtol=1e-2)
    known_values = reference != 0.0
    median = np.median(100.0 * after[known_values] / np.abs(reference[known_values]))
    np.testing.assert_allclose(found["relative_sd_chosen"].values[1], median, rtol=1e-2)
    np.testing.assert_allclose(found["relative_sd"].sel(step=1, candidate=best), median, rtol=1e-2)
    shrinkage = np.exp(np.mean(np.log(np.sqrt(np.diag(known)) / after)))
    np.testing.assert_allclose(found["shrinkage_chosen"], [1.0, shrinkage], rtol=1e-2)
    assert found["n_diverged"].values.tolist() == [0, 0, 0]


def test_a_run_repeated_halves_the_variance(small, reference, quiet):
    vague = np.diag((0.5 * reference) ** 2)
    scaled = quiet | {"noise_sd": {name: 1e-6 * value for name, value in SD.items()}}
    # points at the mean: wide draws would steer other ships
    exact = joint_tree(small, reference, 1e-12 * vague)
    scaled["noise_sd"] = {name: 1e-12 * value for name, value in SD.items()}
    found = ps.design_trials(small, exact, {"zigzag": ps.zigzag(20, 20)}, 3, rng=rng(), **scaled)
    assert found["chosen"].values.tolist() == ["zigzag"] * 3
    np.testing.assert_allclose(found["gain"].values[1:, 0], 10.0 * np.log([2.0, 1.5]), rtol=1e-3)
    np.testing.assert_allclose(found["sd"].sel(stage=1) / found["sd"].sel(stage=2), np.sqrt(2.0), rtol=1e-3)


def test_a_new_run_is_chosen_before_a_duplicate(small, reference, known, quiet):
    twice = [ps.zigzag(20, 20), ps.zigzag(20, 20), ps.zigzag(20, 20, approach_speed=6.0)]
    found = ps.design_trials(small, (reference, known), twice, 2, rng=rng(), **quiet)
    labels = ["zigzag 20/20 port", "zigzag 20/20 port #2", "zigzag 20/20 port from 6 m/s"]
    assert found["candidate"].values.tolist() == labels
    assert found["chosen"].values[0] == labels[2]
    gain = found["gain"].values
    np.testing.assert_allclose(gain[:, 0], gain[:, 1])
    assert np.all(gain[1] < gain[0])
    assert np.all(np.diff(found["sd"].values, axis=0) < 0.0)


def test_hard_rudder_tells_what_a_repeated_zigzag_does_not(container):
    """20/20 zigzag of 400 s at 1 %: a quarter at the median; repeated better by sqrt(2), 35/35 a few percent."""
    zigzag = ps.simulate(container, ps.zigzag(20, 20), duration=400.0, step=STEP, method="rk4")
    factors = {"u": 0.3, "v": 1.0, "r": 0.3, "p": 0.3, "phi": 0.3}
    sd = {name: 0.01 * k * float(np.abs(zigzag[name]).max()) * np.sqrt(0.2) for name, k in factors.items()}
    covariance = np.linalg.inv(fisher_information(zigzag, container, noise_sd=sd))
    candidates = {"again": ps.zigzag(20, 20), "hard": ps.zigzag(35, 35)}
    settings = {"level": 0.01, "draws": 1, "rng": rng()}
    found = ps.design_trials(container, (reference_coefficients(container), covariance), candidates, 1, **settings)
    assert found["chosen"].item() == "hard"
    assert found["shrinkage"].sel(candidate="again").item() == pytest.approx(np.sqrt(2.0), rel=0.05)
    assert 24.0 < found["relative_sd_chosen"].values[0] < 29.0
    assert 2.0 < found["relative_sd_chosen"].values[1] < 5.0


def test_more_noise_is_less_gain(small, reference, known, quiet):
    loud = quiet | {"noise_sd": {name: 10.0 * sd for name, sd in quiet["noise_sd"].items()}}
    one, other = (
        ps.design_trials(small, (reference, known), CANDIDATES, 1, rng=rng(), **settings)["gain"].values
        for settings in (quiet, loud)
    )
    assert np.all(other < 0.5 * one)


def test_the_interval_of_the_sensors_counts(small, reference, known, quiet):
    """Four times as many samples of twice the noise tell the same."""
    slow = ps.design_trials(small, (reference, known), CANDIDATES, 1, rng=rng(), **quiet)["gain"]
    fast = quiet | {"interval": 0.025, "noise_sd": {name: 2.0 * sd for name, sd in quiet["noise_sd"].items()}}
    xr.testing.assert_allclose(
        ps.design_trials(small, (reference, known), CANDIDATES, 1, rng=rng(), **fast)["gain"], slow
    )


def test_a_level_is_the_noise_of_each_run(small, reference, known):
    circle = simulated(small, ps.turning_circle(35))
    sd = {name: 1e-6 * k * float(np.abs(circle[name]).max()) for name, k in (("u", 0.3), ("v", 1.0), ("r", 0.3))}
    gains = [
        ps.design_trials(small, (reference, known), [ps.turning_circle(35)], 1, rng=rng(), **SHORT, **noise)["gain"]
        for noise in ({"level": 1e-6}, {"noise_sd": sd})
    ]
    np.testing.assert_allclose(*gains, rtol=1e-3)


# what a posterior may be


def test_joint_draws_a_fit_and_moments_design_alike(small, reference):
    trial = simulated(small, ps.zigzag(20, 20))
    flat = CoefficientPrior(reference, np.abs(reference), np.abs(reference), np.zeros(10, dtype=bool), "sister_ship")
    run = trajectory_run(trial, small, noise_sd={name: 0.01 * value for name, value in SD.items()})
    fit = fit_trajectory(initial_problem([run], small, flat), np.concatenate([reference, run.initial_state[0]]))
    tree = joint_tree(small, fit.coefficients, fit.covariance, **fitted_noise(0.01))
    noise = {"noise_sd": {name: 0.01 * value for name, value in SD.items()}}
    moments = (fit.coefficients, fit.covariance)
    designs = [
        ps.design_trials(small, posterior, CANDIDATES, 1, rng=rng(), **SHORT, **given)
        for posterior, given in ((fit, {}), (moments, noise), (tree, {}), (tree, noise))
    ]
    np.testing.assert_allclose(designs[2]["gain"], designs[3]["gain"], rtol=1e-6)
    for one in designs[1:]:
        np.testing.assert_allclose(one["gain"], designs[0]["gain"], rtol=0.05)
        np.testing.assert_allclose(one["sd"], designs[0]["sd"], rtol=0.3)
    slow = joint_tree(small, *moments, **fitted_noise(0.01, correlation=0.9))
    slower = ps.design_trials(small, slow, CANDIDATES, 1, rng=rng(), **SHORT)["gain"].values
    assert np.all(slower < designs[2]["gain"].values - 5.0)


def test_points_at_which_ships_diverge_are_left_out_and_counted(small, reference):
    """Half of the posterior has drifting drive the ship."""
    sd = np.abs(reference) * np.where(np.array(coefficient_names(small)) == "Xvr", 300.0, 1e-6)
    settings = SHORT | {"draws": 20, "noise_sd": SD}
    found = ps.design_trials(small, (reference, np.diag(sd**2)), CANDIDATES, 1, rng=rng(), **settings)
    lost = found["n_diverged"].sel(candidate="circle").item()
    assert 0 < lost < 21
    assert np.isfinite(found["gain"]).all()


def test_a_candidate_that_no_ship_survives_is_never_chosen(small, reference, known, quiet):
    hopeless = reference.copy()
    hopeless[coefficient_names(small).index("Xvr")] = 1.0
    straight = ps.rudder_programme([0.0], [np.deg2rad(0.01)])
    candidates = {"circle": ps.turning_circle(35), "straight": straight}
    found = ps.design_trials(small, (hopeless, known), candidates, 2, rng=rng(), **quiet)
    assert found["n_diverged"].values.tolist() == [3, 0]
    assert np.isnan(found["gain"].sel(candidate="circle")).all()
    assert found["chosen"].values.tolist() == ["straight", "straight"]
    assert np.isnan(found["forecast_sd"]).all()
    with pytest.raises(ps.SimulationError, match="In run 1 every simulated ship leaves"):
        ps.design_trials(small, (hopeless, known), {"circle": ps.turning_circle(35)}, rng=rng(), **quiet)
    with pytest.raises(ps.SimulationError, match="leaves the model's range in a manoeuvre of interest"):
        ps.design_trials(small, (hopeless, known), candidates, rng=rng(), criterion="forecast", **quiet)


# forecasts


def test_the_forecast_criterion_serves_the_manoeuvre_of_interest(small, reference, known, quiet):
    circle = ps.turning_circle(35)
    settings = quiet | {"criterion": "forecast", "interest": [circle]}
    found = ps.design_trials(small, (reference, known), CANDIDATES, 1, rng=rng(), **settings)
    ship, jacobian = closed_loop_sensitivities(small, circle, reference, duration=60.0)
    names = ("u", "v", "r", "psi")
    G = np.vstack([jacobian[STATE.index(name), ::5] / np.ptp(ship[name].values) for name in names])
    spread = []
    for covariance in (
        known,
        *(np.linalg.inv(np.linalg.inv(known) + information(small, one, 1e-4)) for one in CANDIDATES.values()),
    ):
        spread.append(np.mean(np.sum(G @ covariance * G, axis=1)))
    np.testing.assert_allclose(found["gain"].values[0], np.log(spread[0] / np.array(spread[1:])), rtol=1e-2)
    best = int(np.argmin(spread[1:]))
    assert found["chosen"].item() == list(CANDIDATES)[best]
    expected = 100.0 * np.sqrt([spread[0], spread[1 + best]])
    np.testing.assert_allclose(found["forecast_sd"], expected, rtol=1e-2)


def test_the_predicted_spread_of_a_forecast_is_that_of_simulated_ships(small, reference):
    """200 ships of the posterior; a spread from 200 has a standard error of 5 %, and few directions matter."""
    covariance = np.linalg.inv(information(small, ps.zigzag(20, 20)) + np.diag(1.0 / (0.3 * reference) ** 2))
    zigzag = ps.zigzag(10, 10)
    settings = SHORT | {"interest": [zigzag], "noise_sd": SD}
    found = ps.design_trials(small, (reference, covariance), CANDIDATES, 1, rng=rng(), **settings)
    draws = rng().multivariate_normal(reference, covariance, 200, method="eigh")
    ships = ps.simulate(small, zigzag, duration=60.0, step=0.02, method="rk4", record_interval=0.5, coefficients=draws)
    truth = simulated(small, zigzag)
    variance = [ships[name].var("draw").mean() / np.ptp(truth[name].values) ** 2 for name in ("u", "v", "r", "psi")]
    assert found["forecast_sd"].values[0] == pytest.approx(100.0 * np.sqrt(np.mean(variance)), rel=0.2)


# refusals


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"criterion": "luck"}, "a criterion of information, forecast"),
        ({"n": 0}, "one run and draw or more"),
        ({"draws": 0}, "one run and draw or more"),
        ({"candidates": []}, "chooses among candidates, found none"),
        ({"noise_sd": None}, "does not tell the noise of its sensors; give level or noise_sd"),
        ({"level": 0.01}, "either a positive level or a positive noise_sd"),
        ({"noise_sd": {"u": 0.0}}, "either a positive level or a positive noise_sd"),
        ({"noise_sd": {}}, "either a positive level or a positive noise_sd"),
        ({"noise_sd": None, "level": 0.0}, "either a positive level or a positive noise_sd"),
        ({"interval": 0.0}, "sampled at a positive interval"),
        ({"posterior": (np.ones(3), np.eye(3))}, "a finite mean and covariance of 10 coefficients"),
        ({"posterior": (np.ones(10), np.full((10, 10), np.nan))}, "a finite mean and covariance of 10 coefficients"),
    ],
)
def test_what_cannot_be_designed_is_refused(small, reference, known, changes, sentence):
    settings = {"posterior": (reference, known), "candidates": CANDIDATES, "noise_sd": SD, "rng": rng()} | changes
    with pytest.raises(ps.SimulationError, match=sentence) as caught:
        ps.design_trials(small, **settings)
    assert str(caught.value).endswith(".")


def test_a_posterior_of_few_draws_is_refused(small, reference, known):
    with pytest.raises(ps.SimulationError, match="needs 20 posterior draws or more, found 18; draw more"):
        ps.design_trials(small, joint_tree(small, reference, known, draws=18), CANDIDATES, rng=rng(), noise_sd=SD)


# the command


@pytest.fixture
def made(small, reference, known, tmp_path, monkeypatch):
    """Posterior file of the small vessel, which the command finds under the name of the container ship."""
    write_posterior(joint_tree(small, reference, known, **fitted_noise(1e-4)), tmp_path / "posterior.nc")
    monkeypatch.setattr(ps, "load_vessel", lambda _: small)
    return tmp_path


def table(path):
    with path.open(encoding="utf-8") as file:
        return list(csv.DictReader(line for line in file if line[0] != "#"))


def test_the_command_prints_and_writes_the_design(made, small, capsys):
    words = ["design", made / "posterior.nc", "--vessel", "small", "--duration", 60, "--n", 2, "--out", made / "design"]
    assert main([*map(str, words), "--quiet"]) == 0
    printed = capsys.readouterr().out
    candidates = ps.candidate_trials(small, duration=60.0, rng=rng(2020))
    assert all(name in printed for name in candidates)
    rows = table(made / "design" / "design.csv")
    assert len(rows) == 2 * len(candidates)
    chosen = [row["chosen"] for row in rows[:: len(candidates)]]
    first = {row["candidate"]: float(row["gain"]) for row in rows[: len(candidates)]}
    assert first[chosen[0]] == max(first.values())
    sd = table(made / "design" / "predicted_sd.csv")
    assert [row["coefficient"] for row in sd] == coefficient_names(small)
    assert all(float(row["sd"]) > float(row["sd_after_1"]) > float(row["sd_after_2"]) for row in sd)
    programmes = sorted(path for path in (made / "design").iterdir() if path.name.startswith("random"))
    assert len(programmes) == len({one for one in chosen if candidates[one].kind == "rudder_programme"}) > 0
    out = made / "trial.csv"
    words = ["simulate", "small", "--programme", programmes[0], "--duration", 60, "--step", 0.1, "--out", out]
    assert main([*map(str, words), "--quiet"]) == 0


def test_the_command_takes_posteriors_of_the_vessel_only(made, small, capsys, monkeypatch):
    monkeypatch.setattr(ps, "load_vessel", lambda _: replace(small, name="other"))
    words = ["design", made / "posterior.nc", "--vessel", "other", "--out", made / "design"]
    assert main([*map(str, words)]) == 2
    assert "The posterior is to be of 'other', found 'small'" in capsys.readouterr().err


def test_the_criteria_of_the_command_are_those_of_the_api():
    assert CLI_CRITERIA == CRITERIA


def test_a_stopping_test_tells_of_the_propeller_astern_and_a_zigzag_does_not():
    vessel = ps.with_terms(ps.load_vessel("kvlcc2"), "modular at any speed")
    known = reference_coefficients(vessel), np.diag([c.sd**2 for c in vessel.parameters])
    settings = {"n": 1, "draws": 2, "duration": 900.0, "interval": 0.5, "rng": rng()}
    shares = {}
    for run in (ps.StoppingTest(1.2), ps.zigzag(20, 20)):
        plan = ps.design_trials(vessel, known, [run], level=0.01, **settings)
        assert plan["n_diverged"].item() == 0
        sd = plan["sd"].sel(coefficient=["T_nn", "T_nu", "Nv"])
        shares[run.label] = (sd.isel(stage=1) / sd.isel(stage=0)).values
    stop, zigzag = shares.values()
    assert (stop[:2] < 0.7).all()
    np.testing.assert_allclose(zigzag[:2], 1.0, atol=1e-6)
    assert zigzag[2] < stop[2]


def test_a_ship_that_does_not_know_way_astern_cannot_be_stopped(small):
    known = reference_coefficients(small), np.diag(np.ones(reference_coefficients(small).size))
    with pytest.raises(ps.SimulationError, match="forces at any speed"):
        ps.design_trials(small, known, [ps.StoppingTest(1.2)], n=1, level=0.01, rng=rng())
