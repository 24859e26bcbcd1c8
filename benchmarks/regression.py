"""The regression: exact draws and Gibbs, NUTS, the evidence maximum."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

import pymc_ship as ps
from benchmarks import r_peers
from benchmarks.table import Row, imported, median_seconds
from pymc_ship.inference.sampling.gibbs import gibbs
from pymc_ship.inference.sampling.regression_model import sample_model
from tests.inference.regression import peers


def sampling(data, prior) -> Iterator[Row]:
    """Exact draws and Gibbs sampler against a plain Cholesky Gibbs sampler, in effective draws a second."""
    rng = np.random.default_rng(0)
    scaled = _scaled(data)
    gibbs(scaled, prior, draws=10, chains=1, rng=rng)
    exact = prior.exact(scaled)
    seconds, (plain, _) = median_seconds(
        lambda: peers.cholesky_gibbs(scaled.design_matrix, scaled.response, prior, 4000, rng)
    )
    cases = {
        "exact independent draws, least ESS": lambda: exact.draw(40000, rng)[0][None],
        "Gibbs, 64 chains x 1000, least ESS": lambda: gibbs(scaled, prior, draws=1000, chains=64, rng=rng)[0],
    }
    for what, work in cases.items():
        ours, draws = median_seconds(work, 3)
        yield _ess_row(what, (draws, ours), "Cholesky Gibbs in numpy", (plain[None], seconds), exact)


def mcmcpack(data, prior) -> Iterator[Row]:
    """Gibbs sampler of MCMCpack in R on the same columns and prior."""
    what, peer = "Gibbs, 4 chains x 1000, least ESS", "R MCMCpack MCMCregress"
    scaled = _scaled(data)
    arguments = {"kappa": prior.kappa, "shape": prior.shape, "scale": prior.scale}
    rows = np.column_stack([scaled.response, scaled.design_matrix])
    theirs, draws = r_peers.seconds(r_peers.MCMC_REGRESS, rows, arguments, what, peer)
    rng = np.random.default_rng(0)
    gibbs(scaled, prior, draws=10, chains=1, rng=rng)
    ours, own = median_seconds(lambda: gibbs(scaled, prior, draws=1000, chains=4, rng=rng)[0], 3)
    yield _ess_row(what, (own, ours), peer, (draws[None, :, : data.n_terms], theirs), prior.exact(scaled))


def nuts(data) -> Iterator[Row]:
    """NUTS in whitened coordinates against the model as the paper writes it and a first attempt, in draws a second.

    One prior for all: coefficients N(0, 10) and next to nothing about the noise.
    """
    prior = ps.SemiConjugatePrior(kappa=100.0, shape=1e-3, scale=1e-6)
    exact = prior.exact(data)

    def sample() -> np.ndarray:
        return _coefficients(ps.nuts_posterior(data, prior, rng=np.random.default_rng(0)))

    whitened, again = (_timed(sample) for _ in range(2))
    direct = _timed(lambda: as_written(data, prior))
    first = _timed(lambda: data.to_original(_coefficients(first_attempt(data))))
    what = "NUTS whitened, with compilation, least ESS"
    compiled = (
        f"; {whitened[1] - again[1]:.1f} of the {whitened[1]:.1f} s of ours are imports, which every process pays "
        "once; nothing is compiled"
    )
    row = _ess_row(what, whitened, "direct, as the paper writes it", direct, exact)
    yield replace(row, note=row.note + compiled)
    yield _ess_row(what, whitened, "plain PyMC, a first attempt", first, exact)


def as_written(data, prior) -> np.ndarray:
    """Coefficients drawn by nutpie from the model that users change."""
    settings = {"draws": 1000, "chains": 4, "tune": 1000}
    return _coefficients(sample_model(ps.pymc_model(data, prior), settings, 0, False))


def first_attempt(data):
    """Model of the same regression as a PyMC user first writes it: standardised columns, default sampling."""
    import pymc as pm

    with pm.Model():
        coefficients = pm.Normal("coefficients", 0.0, 10.0, shape=data.n_terms)
        sigma = pm.HalfNormal("sigma", 1.0)
        mean = pm.math.dot(data.scaled_design_matrix, coefficients)
        pm.Normal("response", mean, sigma, observed=data.scaled_response)
        return pm.sample(random_seed=0, progressbar=False)


def bayesian_ridge(data) -> Iterator[Row]:
    """Evidence maximum and posterior against BayesianRidge of scikit-learn, which fits the same model."""
    what, peer = "prior by evidence, then the posterior", "scikit-learn BayesianRidge"
    library = imported("sklearn.linear_model", what, peer)
    scaled = _scaled(data)
    X, y = scaled.design_matrix, scaled.response

    def fit():
        fresh = ps.RegressionData.from_arrays(X, y, scaling="none")
        prior, log_evidence = ps.maximise_evidence(fresh, "conjugate")
        return prior.exact(fresh), log_evidence

    fit()
    ours, (posterior, log_evidence) = median_seconds(fit, 5)
    theirs, ridge = median_seconds(lambda: library.BayesianRidge(fit_intercept=False).fit(X, y), 5)
    shape = 1e8  # a noise variance that is known, as BayesianRidge takes it once it is found
    given = ps.ConjugatePrior(kappa=ridge.alpha_ / ridge.lambda_, shape=shape, scale=shape / ridge.alpha_)
    same = given.exact(scaled)
    sd = np.sqrt(np.diag(ridge.sigma_))
    gap = np.abs((same.mean - ridge.coef_) / sd).max()
    note = (
        f"with its alpha and lambda our posterior mean is its own; at the end of the two searches the log evidence of "
        f"ours differs by {log_evidence - same.log_evidence:+.2g}, the means are "
        f"{np.abs((posterior.mean - ridge.coef_) / sd).max():.2g} sd apart; ours searches three hyperparameters from "
        "five starts, BayesianRidge two from one by fixed point"
    )
    yield Row(what, ours, peer, theirs, "max |d mean| under its prior [sd]", gap, 1e-6, note=note)


def _scaled(data) -> ps.RegressionData:
    return ps.RegressionData.from_arrays(data.scaled_design_matrix, data.scaled_response, scaling="none")


def _coefficients(tree) -> np.ndarray:
    return tree["posterior"].dataset["coefficients"].values


def _timed(work: Callable[[], np.ndarray]) -> tuple[np.ndarray, float]:
    start = time.perf_counter()
    draws = work()
    return draws, time.perf_counter() - start


def _ess_row(what: str, ours: tuple[np.ndarray, float], peer: str, theirs: tuple[np.ndarray, float], exact) -> Row:
    """Row of least effective draws a second; the means of both may differ by five Monte-Carlo standard errors."""
    from arviz import ess

    found = [np.array([float(ess(draws[..., j])) for j in range(draws.shape[-1])]) for draws, _ in (ours, theirs)]
    means = [draws.mean(axis=(0, 1)) for draws, _ in (ours, theirs)]
    gap = np.abs((means[0] - means[1]) / exact.sd / np.sqrt(1.0 / found[0] + 1.0 / found[1])).max()
    least, sizes = [values.min() for values in found], [draws[..., 0].size for draws, _ in (ours, theirs)]
    note = f"least ESS {least[0]:.0f} of {sizes[0]} draws against {least[1]:.0f} of {sizes[1]}"
    rates = [values.min() / seconds for values, (_, seconds) in zip(found, (ours, theirs), strict=True)]
    return Row(what, rates[0], peer, rates[1], "max |d mean| [MC standard errors]", gap, 5.0, "/s", note)
