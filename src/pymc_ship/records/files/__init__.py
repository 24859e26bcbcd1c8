"""Files of trials as a logger wrote them, and what sensors add to a clean record.

- `reading`: a trial file, read into the record of a trial.
- `format`: columns, units, signs and frame of a file, as TOML.
- `columns`: names of columns and what they are known by.
- `time_base`: time stamps, sorted out.
- `noise`: noise of given kinds put on a clean record.
- `instruments`: sensors with resolution, gaps and jitter.
- `quality_flags`: what the checks found of the records of an identification.
"""
