"""Posteriors of coefficients.

Here live the rows of regressions, the exact posteriors, the fits of trajectories, the laws of captive tests, the Markov
chains and the bound on what data can determine. Records and priors enter. Posteriors as DataTrees leave.

- `rows`: design matrix and response, from arrays, tables or trials.
- `regression`: one degree of freedom by the paper's way, with exact posteriors.
- `trajectory`: all coefficients at once, by the simulated motion.
- `captive`: forces measured on a model that a carriage moves.
- `sampling`: Gibbs and NUTS; the only wing that imports PyMC.
- `identifiability`: Cramer-Rao bound and directions that the data leave unknown.
"""
