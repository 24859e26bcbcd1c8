"""One degree of freedom: priors and exact posteriors.

- `priors`: base classes of priors and exact posteriors, and the coordinates in which a posterior is diagonal.
- `prior_table`: priors of single coefficients from tables or sister ships, and coefficients fixed at known values.
- `quadrature`: one-dimensional integrals on the log scale.
- `conjugate`: the conjugate prior and its exact posterior.
- `semiconjugate`: the semi-conjugate prior and its exact posterior.
- `families`: registry of prior families.
- `tree`: posterior draws as a DataTree, and its files.
- `cross_validation`: log predictive density of held-out blocks of rows.
- `tune`: hyperparameters by evidence or by Bayesian optimisation.
- `calibration`: simulation-based calibration.
- `identify`: all degrees of freedom of a trial; posteriors pooled over draws of a denoised trial.
"""
