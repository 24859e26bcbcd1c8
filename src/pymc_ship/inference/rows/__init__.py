"""The rows of a regression: a design matrix, a response, and the scaling that priors live on.

- `frames`: columns of tables by name, and formulas.
- `data`: rows in memory, from plain arrays, with their scaling and conditioning.
- `from_trials`: rows from the records of trials, by differences or in the weak form.
- `weak_form`: the equations times test functions, and the start of a trajectory fit.
"""
