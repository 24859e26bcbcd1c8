"""What data, posteriors and searches say of themselves: short, whatever their size."""

import numpy as np
import pytest

import pymc_ship as ps
from pymc_ship.inference.regression.tune import tune_prior
from pymc_ship.inference.rows.data import RegressionData

PRIOR = {"kappa": 10.0, "shape": 3.0, "scale": 0.5}


def rows(n_terms=3, n_rows=40):
    rng = np.random.default_rng(1)
    X = np.column_stack([np.ones(n_rows), 5.0 + 2.0 * rng.standard_normal((n_rows, n_terms - 1))])
    return X, X @ np.arange(1.0, n_terms + 1.0) + rng.standard_normal(n_rows), [f"Y{k}" for k in range(n_terms)]


def data(n_terms=3, **labels):
    return RegressionData.from_arrays(*rows(n_terms), scaling="zscore", **labels)


def short(text):
    """Lines of a text, once none is long and there are fewer than 12."""
    lines = text.splitlines()
    assert len(lines) < 12
    assert max(map(len, lines)) <= 120
    return lines


def test_regression_data():
    one = data(dof="sway", vessel="container", derivative="euler")
    assert short(repr(one)) == [
        "RegressionData of 40 rows and 3 terms (sway, container, euler)",
        "  terms     Y0, Y1, Y2",
        f"  columns   centred on Y0, scales 1 to {one.column_scale.max():.4g}",
        f"  response  centre {one.response_center:.4g}, scale {one.response_scale:.4g}",
    ]
    plain = RegressionData.from_arrays(*rows(200, 300), scaling="none")
    assert short(repr(plain))[0] == "RegressionData of 300 rows and 200 terms"
    assert short(repr(plain))[1].endswith(", ...")
    assert short(repr(plain))[2] == "  columns   not centred, scales 1 to 1"


@pytest.mark.parametrize(
    ("prior", "name"), [(ps.ConjugatePrior, "NormalInverseGamma"), (ps.SemiConjugatePrior, "NormalMixture")]
)
def test_an_exact_posterior(prior, name):
    found = prior(**PRIOR).exact(data())
    assert short(repr(found)) == [
        f"{name} of 3 coefficients, log evidence {found.log_evidence:.6g}",
        f"  noise variance  {found.noise_variance_mean:.4g} ± {found.noise_variance_sd:.2g}",
        *(f"  Y{k}              {found.mean[k]:.4g} ± {found.sd[k]:.2g}" for k in range(3)),
    ]
    many = short(repr(prior(**PRIOR).exact(data(20))))
    assert many[-2].startswith("  Y7  ")
    assert many[-1] == "  and 12 more"


def test_a_tuned_prior():
    found = tune_prior(data(), evaluations=6, rng=np.random.default_rng(1))
    head, *lines = short(repr(found))
    assert head == "TunedPrior of the conjugate family, 6 evaluations"
    rows = ["prior", "best point", "surrogate", "evidence"]
    assert [line.split("shape")[0].strip() for line in lines[:4]] == rows
    assert [line.split()[0] for line in lines[4:]] == list(found.edges)
    assert lines[0].endswith(f", kappa {found.prior.kappa:.4g}, score {found.score:.5g} ± {found.score_se:.2g}")
    assert lines[3].endswith(f", kappa {found.evidence_prior.kappa:.4g}, score {found.evidence_score:.5g}")


def test_an_identification(small):
    trial = ps.simulate(small, ps.zigzag(20.0, 20.0), duration=200.0, step=0.1)
    found = ps.identify(ps.pollute(trial, level=1e-3, rng=np.random.default_rng(1)), small, interval=4.0)
    head, *lines = short(repr(found))
    assert head == f"Identification of {small.name!r}, log evidence by family"
    assert [line.split()[0] for line in lines] == list(small.dofs)
    yaw = {family: exact["yaw"].log_evidence for family, exact in found.exact.items()}
    assert lines[2].endswith("  ".join(f"{family} {value:.6g}" for family, value in yaw.items()))
    assert f"{found.data['yaw'].n_rows} rows" in lines[2]
