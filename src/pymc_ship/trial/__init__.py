"""The record of a trial: channels, units, the check of its form and its CSV.

- `units`: SI units, their spellings in files and their Froude scaling.
- `channels`: the table of channels.
- `record`: the check of a record, and its CSV.
"""
