"""The record of a trial: read, checked for form, written and polluted.

- `units`: SI units, how files spell them and how they grow with the ship.
- `channels`: the one table of channels.
- `record`: the check of a record, and its CSV.
- `judgement`: what the checks said of a record, kept beside it.
- `columns`: headings of a file matched with channels and units.
- `format`: the user's description of a file, in TOML.
- `time_base`: rounded, repeated and missing time stamps.
- `reading`: a file as its facility wrote it, read into a record.
- `instruments`: presets of sensors: resolution, missing samples, a clock that jitters.
- `noise`: sensor noise of simulated records, and the noise of measured ones.
"""
