"""What data can determine of the coefficients.

- `information`: Fisher information, Cramer-Rao bound and directions that the data leave unknown.
- `bound`: the errors that the Cramer-Rao bound of clean trials allows.
"""
