"""Read me first: the sway equation of the container ship as a PyMC model to change, and as one changed already.

Run: python models/first_model.py [draws]
"""

import sys

import arviz as az
import numpy as np
import pymc as pm

import pymc_ship as ps


def horseshoe(data, given):
    """Few coefficients matter: b_j ~ N(0, tau^2 lambda_j^2 sigma2) (Carvalho, Polson & Scott 2010)."""
    sigma2 = pm.InverseGamma("scaled_noise_variance", 2.0, 1.0)
    tau = pm.HalfCauchy("tau", 1.0)
    lam = pm.HalfCauchy("lambda", 1.0, dims="coefficient")
    scale = tau * lam * pm.math.sqrt(sigma2)
    return pm.Normal("scaled_coefficients", 0.0, scale, **given), sigma2


def main(draws: int = 1000) -> None:
    """Simulate a noisy zigzag, sample the model of the paper and one with another prior, and compare both."""
    # 1 The data: a 20/20 zigzag with 1 % noise, denoised by wavelets; one row a second
    ship = ps.load_vessel("container")
    clean = ps.simulate(ship, ps.zigzag(20.0, 20.0), duration=400.0)
    noisy = ps.pollute(clean, level=0.01, rng=np.random.default_rng(1))
    data = ps.regression_data(ps.denoise(noisy), ship, "sway", interval=1.0)

    # 2 The model of the paper, a pm.Model: beta | sigma2 ~ N(0, kappa sigma2), sigma2 ~ InverseGamma(shape, scale) on
    #   the z-scored columns, one normal a row; NUTS moves in coordinates that make nearly collinear columns harmless
    prior = ps.ConjugatePrior(mean=0.0, kappa=100.0, shape=2.0, scale=1.0)
    model = ps.pymc_model(data, prior)
    print(model.str_repr())
    with model:
        sampled = pm.sample(draws, tune=1000, chains=4, cores=1, random_seed=2, progressbar=False, quiet=True)
    paper = ps.posterior_tree(sampled, data, model, prior=prior, rng=np.random.default_rng(3))

    # 3 The same posterior from the quick path of the package, and both against the posterior in closed form
    quick = ps.nuts_posterior(data, prior, draws=draws, rng=np.random.default_rng(4))
    print(az.summary(paper, var_names=["coefficients", "noise_variance"], round_to="none").to_string())
    print(ps.agreement(prior.exact(data), {"paper": paper, "quick": quick}).attrs["verdict"])

    # 4 The model changed: a prior of one's own; its draws are a posterior like every other
    changed = ps.nuts_posterior(data, horseshoe, draws=draws, target_accept=0.95, rng=np.random.default_rng(5))
    for name, tree in {"paper": paper, "horseshoe": changed}.items():
        print(f"{name}: elpd {az.loo(tree, var_name='response').elpd:.1f}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
