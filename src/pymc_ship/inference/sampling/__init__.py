"""Markov chains. The only wing that imports PyMC, PyTensor or nutpie.

- `gibbs`: the Gibbs sampler of a regression.
- `error_laws`: normal, Student-t and AR(1) errors of rows.
- `predictive`: prior, prior predictive and posterior predictive groups.
- `linear_transform`: linear coordinates of a PyMC variable.
- `whitened_model`: the quick path of NUTS for normal errors.
- `prior_laws`: horseshoe and R2-D2 priors of the PyMC model.
- `own_tree`: draws of a PyMC model of one's own, laid out as a posterior.
- `regression_model`: the PyMC model of a regression, and its NUTS draws.
- `hierarchical_model`: coefficients partially pooled over groups of runs.
- `trajectory_model`: the PyMC model of whole trajectories.
- `operations`: the simulated motion, and the density of pooled groups, as PyTensor operations.
"""
