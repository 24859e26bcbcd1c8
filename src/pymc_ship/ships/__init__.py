"""A ship identified: forecast, designed for and reported.

Here live the forecasts of draws, the identification from several trials, the design of the next run and the report of a
sea trial. Posteriors, vessels and records enter. Forecasts with intervals and pages leave.

- `ensemble`: the ship, with the laws of its errors, kept in files.
- `forecasting`: draws carried into manoeuvres, with bands, intervals and a page.
- `design`: what runs can tell of a ship, and which to make next.
- `identification`: a real ship from several trials, judged by held-out runs.
- `sea_trials`: the report of a sea trial as IMO MSC/Circ.1053 asks for it.
"""
