"""The record of a trial: its table of channels, their units, and the check of its form.

- `units`: SI units, how files spell them and how they grow with the ship.
- `channels`: the one table of channels.
- `record`: the check of a record, and its CSV.
"""
