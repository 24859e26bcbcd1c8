"""Convergence, contraction, residuals, cross-validation and sensitivity of posteriors, and their page.

- `posterior_statistics`: convergence, correlation, whiteness, cross-validation and sensitivity of any posterior.
- `regression`: contraction, residuals and predictive draws of a regression.
- `trajectory`: contraction, directions and residuals of a trajectory fit.
- `agreement`: draws compared with the exact posterior of the same data and prior.
- `tables`: tables of quantities, chains and agreement.
- `figures`: figures of a diagnosed posterior.
- `trajectory_figures`: figures of a diagnosed trajectory fit.
- `subsections`: kinds of posterior, and the subsections that all sections share.
- `regression_subsections`: subsections on a regression.
- `group_subsections`: the subsection on the groups of a hierarchical posterior.
- `trajectory_subsections`: subsections on a trajectory fit.
- `page`: the diagnostic page of saved posteriors.
"""
