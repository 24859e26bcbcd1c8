"""One degree of freedom: rows, priors and exact posteriors.

- `data`: rows of a regression from a record, and their scaling.
- `streamed`: more rows than memory holds, reduced chunk by chunk.
- `priors`: conjugate and semi-conjugate priors.
- `prior_table`: priors of single coefficients from tables, held values, sister ships.
- `rotation`: the coordinates in which the posterior is diagonal.
- `quadrature`: one-dimensional integrals on the log scale.
- `conjugate`: the exact posterior under the conjugate prior.
- `semiconjugate`: the exact posterior under the semi-conjugate prior.
- `tree`: draws laid out as a DataTree, written and read.
- `cross_validation`: log predictive density of blocks of rows left out.
- `tune`: priors chosen by evidence or by Bayesian optimisation.
- `identify`: every degree of freedom of a trial at once.
"""
