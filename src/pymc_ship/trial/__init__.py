"""The record of a trial: cells of its file, channels, units, the check of its form and its CSV.

- `units`: SI units, their spellings in files and their Froude scaling.
- `channels`: the table of channels.
- `cells`: cells of a file, as numbers where a column has numbers alone.
- `thinning`: rows of a long table that are left.
- `record`: the check of a record, and its CSV.
- `quality_flags`: verdict and remarks of the checks, in the attrs of a record.
"""
