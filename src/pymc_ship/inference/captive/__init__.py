"""Captive tests: forces measured on a model that is towed along a prescribed motion, as data beside the trials.

- `table`: reads rows of motion and force.
- `fit`: Gaussian likelihood of the coefficients by the tests.
- `comparison`: measured forces and those of posterior draws, as table and figure.
"""
