"""One degree of freedom: priors and exact posteriors.

- `priors`: what every prior and every exact posterior knows, and the coordinates that make a posterior diagonal.
- `prior_table`: priors of single coefficients from tables, held values, sister ships.
- `quadrature`: one-dimensional integrals on the log scale.
- `conjugate`: the conjugate prior and its exact posterior.
- `semiconjugate`: the semi-conjugate prior and its exact posterior.
- `families`: prior families by name, yours among them.
- `tree`: draws laid out as a DataTree, written and read.
- `cross_validation`: log predictive density of blocks of rows left out.
- `tune`: priors chosen by evidence or by Bayesian optimisation.
- `calibration`: simulation-based calibration, coverage and Geweke's test.
- `identify`: every degree of freedom of a trial at once; posteriors pooled over draws of a denoised trial.
"""
