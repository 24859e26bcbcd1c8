"""Manoeuvres in records, and their measured indices.

- `recognition`: standard manoeuvres in records, and the steering gear.
- `approach`: whether a manoeuvre begins at a steady speed.
- `measured`: a measured manoeuvre from its first execute on, and its indices.
- `current`: drift of a track from the log, and from one round of a circle to the next.
- `stopping_tests`: the stopping test in a record, with its indices and IMO limit.
"""
