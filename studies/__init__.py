"""Studies beside the library: they judge it, and choose the constants that it carries.

Each is run from the folder that holds ``studies``.

- `population`: ships drawn, identified and judged, a kind of study of `pymc-ship montecarlo`.
- `foreign`: simulators of other ships, which share no code with the library.
- `frontier`: every method beside the Cramer-Rao bound.
- `paths`: rival ways to the coefficients of a ship, each judged on runs it was not given.
- `kvlcc2`: captive tests and the No-U-Turn sampler on the records of the KVLCC2.
- `documentation`: figures of the documentation and its page on what to expect.
"""
