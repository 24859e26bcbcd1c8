"""A ship identified: forecast, designed for and reported.

Posteriors, vessels and records enter. Forecasts with intervals and pages leave.

- `ensemble`: the ship, with the laws of its errors, and its files.
- `forecasting`: simulated draws with bands, intervals and a page.
- `design`: the choice of the next run.
- `identification`: a real ship from several trials, tested on held-out runs.
- `sea_trials`: the report of a sea trial as IMO MSC/Circ.1053 asks for it.
"""
