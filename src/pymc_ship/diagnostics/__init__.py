"""Convergence, contraction, residuals, cross-validation and sensitivity of posteriors, and their page.

- `numbers`: convergence, correlation, whiteness, cross-validation and sensitivity of any posterior.
- `regression`: contraction, residuals and predictive draws of a regression.
- `trajectory`: contraction, directions and residuals of a trajectory fit.
- `agreement`: draws compared with the exact posterior of the same data and prior.
- `tables`: tables of quantities, chains and agreement.
- `figures`: figures of a diagnosed posterior.
- `trajectory_figures`: figures of a diagnosed trajectory fit.
- `parts`: kinds of posterior, and the parts that all sections share.
- `regression_parts`: parts of a section on a regression.
- `group_parts`: the part on the groups of a hierarchical posterior.
- `trajectory_parts`: parts of a section on a trajectory fit.
- `page`: the diagnostic page of saved posteriors.
"""
