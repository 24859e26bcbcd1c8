"""Captive tests: forces measured on a model at a prescribed motion.

- `plausibility`: refuses columns that were not measured, wrong units and signs.
- `table`: reads them.
- `fit`: fits coefficients to them.
- `comparison`: measured forces against those of draws.
"""
