"""Captive tests: forces measured on a model at a prescribed motion.

`table` reads them, `fit` fits coefficients, `comparison` sets measured against drawn forces.
"""
