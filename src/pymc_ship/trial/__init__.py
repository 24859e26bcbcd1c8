"""The record of a trial: read, checked for form, written and polluted.

- `units`: SI units, how files spell them and how they grow with the ship.
- `channels`: the one table of channels.
- `record`: the check of a record, and its CSV.
"""
