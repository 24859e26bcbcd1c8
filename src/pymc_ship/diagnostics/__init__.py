"""What a posterior says of itself, and its page.

- `numbers`: gates, correlation, whiteness, cross-validation and sensitivity of any posterior.
- `regression`: contraction, residuals and predictive draws of a regression.
- `trajectory`: contraction, directions and residuals of a trajectory fit.
- `agreement`: posteriors of the same data against the exact one.
- `calibration`: simulation-based calibration, coverage and Geweke's test.
- `tables`: tables of quantities, chains and agreement.
- `figures`: figures of a diagnosed posterior.
- `trajectory_figures`: figures of a diagnosed trajectory fit.
- `parts`: what a section can be about, and the parts that all sections share.
- `regression_parts`: parts of a section about a regression.
- `trajectory_parts`: parts of a section about a trajectory fit.
- `page`: the diagnostic page of saved posteriors.
"""
