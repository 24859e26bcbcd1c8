import json

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.cli.main import main
from pymc_ship.inference.regression import identify as identification
from pymc_ship.inference.regression.families import FAMILIES
from pymc_ship.inference.regression.identify import identify
from tests.journeys.cases import column, files, rows, run
from tests.physics.vessel.cases import TERMS

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
        mean = small.coefficients(dof).copy(data=exact.mean)
        np.testing.assert_array_equal(column(mine, "mean_bis"), ps.rescale(mean, small, "bis"))
        if small.particulars.d > 0.0:
            np.testing.assert_array_equal(column(mine, "mean_mmg"), ps.rescale(mean, small, "mmg"))
        else:
            assert np.isnan(column(mine, "mean_mmg")).all()


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

    monkeypatch.setattr("pymc_ship.cli.commands.tune_prior", tune_prior)
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
    assert f"Bayesian optimisation: {tuned.score - tuned.evidence_score:+.4f} in the score" in text
    scores = {line.rsplit(maxsplit=4)[0]: line.split()[-1] for line in text.splitlines()[2:6]}
    assert scores == {
        "chosen": f"{tuned.score:.4f}",
        "best evaluated": f"{tuned.evaluated_score:.4f}",
        "best of the Gaussian process": f"{tuned.surrogate_score:.4f}",
        "evidence maximum": f"{tuned.evidence_score:.4f}",
    }
