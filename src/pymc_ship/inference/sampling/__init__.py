"""Markov chain Monte Carlo. The only wing that imports PyMC, PyTensor or nutpie.

- `gibbs`: Gibbs sampler of a regression.
- `error_laws`: normal, Student-t and AR(1) errors of rows.
- `predictive`: prior, prior predictive and posterior predictive groups.
- `linear_coordinates`: coordinates for NUTS in the PyMC model of a regression.
- `whitened_model`: density of a regression of normal errors for NUTS, without compilation.
- `prior_laws`: horseshoe and R2-D2 priors of the PyMC model.
- `from_pymc`: posterior of a custom PyMC model.
- `regression_model`: PyMC model of a regression, and its NUTS draws.
- `hierarchical_model`: coefficients partially pooled over groups of runs.
- `trajectory_model`: PyMC model of whole trajectories.
- `operations`: simulated motion as a PyTensor operation, density of pooled groups.
"""
