"""The rows of a regression: design matrix, response and scaling.

`frames` reads columns of tables and formulas, `data` scales rows, `from_trials` makes them by differences or in the
`weak_form`, which also gives the start of a trajectory fit.
"""
