"""Read me first: the sway equation of the container ship, written in PyMC, next to the same model from pymc_ship.

Run: python models/first_model.py [draws]
"""

import sys

import arviz as az
import numpy as np
import pymc as pm

import pymc_ship as ps


def main(draws: int = 1000) -> None:
    """Simulate a noisy zigzag, fit sway by plain PyMC and by pymc_ship, and compare both with the exact posterior."""
    # 1 The data: a 20/20 zigzag with 1 % noise, denoised by wavelets; one row a second
    ship = ps.load_vessel("container")
    clean = ps.simulate(ship, ps.zigzag(20.0, 20.0), duration=400.0)
    noisy = ps.pollute(clean, level=0.01, rng=np.random.default_rng(1))
    data = ps.regression_data(ps.denoise(noisy), ship, "sway", interval=1.0)

    # 2 The prior, on the z-scored columns: beta | sigma2 ~ N(0, kappa sigma2), sigma2 ~ InverseGamma(2, 1)
    prior = ps.ConjugatePrior(mean=0.0, kappa=100.0, shape=2.0, scale=1.0)

    # 3 The model as Xue et al. (2020), Eq. 12, write it; a user's own model starts from here
    with pm.Model(coords={"coefficient": data.coefficients, "row": data.time}) as model:
        sigma2 = pm.InverseGamma("sigma2", alpha=prior.shape, beta=prior.scale)
        beta = pm.Normal("beta", mu=prior.mean, sigma=pm.math.sqrt(prior.kappa * sigma2), dims="coefficient")
        mu = pm.math.dot(data.scaled_design_matrix, beta)
        pm.Normal("response", mu=mu, sigma=pm.math.sqrt(sigma2), observed=data.scaled_response, dims="row")
    with model:
        plain = pm.sample(draws, tune=1000, chains=4, cores=1, random_seed=2, progressbar=False, quiet=True)
    # the same name, layout and units as every posterior of pymc_ship
    to_prime = {"coefficients": (("chain", "draw", "coefficient"), data.to_original(plain.posterior["beta"].values))}
    to_prime["noise_variance"] = plain.posterior["sigma2"] * data.response_scale**2
    plain["posterior"] = plain.posterior.to_dataset().assign(to_prime)

    # 4 The same posterior from pymc_ship: whitened coordinates, made for nearly collinear columns
    whitened = ps.nuts_posterior(data, prior, draws=draws, rng=np.random.default_rng(3))

    # 5 Both against the posterior in closed form
    print(az.summary(whitened, var_names=["coefficients", "noise_variance"], round_to="none").to_string())
    exact = ps.conjugate(data, prior)
    print(ps.agreement(exact, {"plain PyMC": plain, "pymc_ship": whitened}).attrs["verdict"])
    for name, tree in {"plain PyMC": plain, "pymc_ship": whitened}.items():
        print(f"{name}: {float(tree['sample_stats']['n_steps'].mean()):.0f} gradient evaluations a draw")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
