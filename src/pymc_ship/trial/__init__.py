"""The record of a trial: read, checked for form, written and polluted.

- `record`: channels, units, the check of a record, and its CSV.
- `columns`: headings of a file matched with channels and units.
- `format`: the user's description of a file, in TOML.
- `time_base`: rounded, repeated and missing time stamps.
- `reading`: a file as its facility wrote it, read into a record.
- `noise`: sensor noise of simulated records, and the noise of measured ones.
"""
