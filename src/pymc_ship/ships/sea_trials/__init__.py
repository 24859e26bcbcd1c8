"""The report of a sea trial as IMO MSC/Circ.1053 asks for it: conditions, indices as measured and corrected, limits.

- `conditions`: what was noted of the day, and whether the circular's limits of a trial are met.
- `current`: the current that a turn of two rounds shows.
- `loading`: the draws of an identified ship at another draught.
- `corrections`: current, wind and loading taken off measured indices.
- `uncertainty`: the uncertainty of the result and what it leaves of a criterion.
- `measured_spiral`: the spiral test in a record, and its loop.
- `form`: the circular's form, line by line.
- `sea_trial`: a trial's runs, conditions and corrected indices.
- `figures`: tracks of circles with and without the current, headings of zigzags, turns of spirals.
- `page`: the report.
"""
