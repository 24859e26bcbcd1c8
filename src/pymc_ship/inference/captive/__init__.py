"""Captive tests: forces measured on a ship that is held at a motion, as data beside her trials.

- `table`: reads rows of motion and force.
- `likelihood`: what they say of the coefficients.
- `comparison`: their forces beside those of ships, as table and figure.
"""
