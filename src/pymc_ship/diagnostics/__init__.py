"""What a posterior says of itself, and its page.

- `numbers`: gates, correlation, whiteness, cross-validation and sensitivity of any posterior.
- `regression`: contraction, residuals and predictive draws of a regression.
- `trajectory`: contraction, directions and residuals of a trajectory fit.
- `agreement`: posteriors of the same data against the exact one.
- `tables`: tables of quantities, chains and agreement.
- `figures`: figures of a diagnosed posterior.
- `trajectory_figures`: figures of a diagnosed trajectory fit.
- `parts`: what a section can be about, and the parts that all sections share.
- `regression_parts`: parts of a section about a regression.
- `group_parts`: the part about groups of a hierarchical posterior.
- `trajectory_parts`: parts of a section about a trajectory fit.
- `page`: the diagnostic page of saved posteriors.
"""
