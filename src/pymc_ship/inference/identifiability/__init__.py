"""Identifiability of the coefficients from runs.

- `information`: Fisher information, Cramer-Rao bound and unidentified directions.
- `bound`: Cramer-Rao bound of clean trials, and the errors of estimates that reach it.
"""
