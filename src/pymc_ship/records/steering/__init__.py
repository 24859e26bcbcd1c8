"""Which manoeuvre a record holds, and its indices as measured.

- `recognition`: which manoeuvre a record holds, and its steering gear.
- `measured`: a measured manoeuvre beside a forecast one.
- `stopping_tests`: the stopping test in a record, with its indices and IMO limit.
"""
