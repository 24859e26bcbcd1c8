"""Markov chains. The only wing that imports PyMC, PyTensor and nutpie.

- `gibbs`: the Gibbs sampler of a regression.
- `error_laws`: normal, Student-t and AR(1) errors of rows.
- `predictive`: prior, prior predictive and posterior predictive groups.
- `regression_model`: PyMC models of a regression and their NUTS draws.
- `rows_model`: PyMC models with a likelihood on rows.
- `trajectory_model`: the PyMC model of whole trajectories.
- `trajectory_op`: the simulated motion as a PyTensor operation.
"""
