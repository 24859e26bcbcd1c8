"""The report of a sea trial by IMO MSC/Circ.1053: conditions, indices as measured and corrected, limits.

- `conditions`: conditions of the trial, and the circular's limits for them.
- `loading`: the draws of an identified ship at another draught.
- `corrections`: measured indices corrected for current, wind and loading.
- `uncertainty`: the uncertainty budget and conformity.
- `measured_spiral`: steady turns and loop of a spiral test.
- `form`: the circular's form, line by line.
- `sea_trial`: a trial's runs, conditions and corrected indices.
- `figures`: tracks of circles with and without the current, headings of zigzags, turns of spirals.
- `page`: the report.
"""
