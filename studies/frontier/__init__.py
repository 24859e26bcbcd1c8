"""Every method beside the reference ship and the Cramer-Rao bound, over many seeds.

- `data_sets`: records simulated anew for each level and seed.
- `measure`: every estimator on every data set.
- `tables`: aims and rows of the tables.
- `figures`: errors from the bound down.
- `page`: the page of the frontier.
"""
