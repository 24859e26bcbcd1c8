"""Captive tests: forces measured on a model at a prescribed motion.

- `table`: reads them.
- `fit`: fits coefficients to them.
- `comparison`: measured forces against those of draws.
"""
