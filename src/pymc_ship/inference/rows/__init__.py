"""The rows of a regression: design matrix, response and scaling.

- `frames`: columns of tables by name, and formulas.
- `data`: design matrix and response of one degree of freedom, with scaling and conditioning.
- `from_trials`: rows from trials, by differences or in the weak form.
- `weak_form`: the equations of motion integrated against test functions, and the start of a trajectory fit.
"""
