"""What a posterior says of itself, and its page.

- `regression`: gates, contraction, residuals and sensitivity of a regression.
- `trajectory`: the same of a trajectory fit.
- `agreement`: posteriors of the same data against the exact one.
- `calibration`: simulation-based calibration, coverage and Geweke's test.
- `tables`: tables of quantities, chains and agreement.
- `figures`: figures of a diagnosed posterior.
- `trajectory_figures`: figures of a diagnosed trajectory fit.
- `parts`: parts of a section about a regression.
- `trajectory_parts`: parts of a section about a trajectory fit.
- `page`: the diagnostic page of saved posteriors.
"""
