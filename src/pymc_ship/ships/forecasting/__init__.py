"""Forecasts of manoeuvres from posterior draws, with bands, intervals and a page.

- `forecast`: bands and indices of the simulated draws.
- `prior_ships`: simulations of draws of a prior.
- `extrapolation`: distance of a forecast from the motion of the data.
- `steady_turns`: rudder angle at each rate of turn, and the loop of a spiral.
- `stopping`: the stopping test.
- `figures`: heading, rudder and motion of a forecast.
- `force_curves`: forces of the draws over drift, yaw rate and rudder.
- `track`: tracks with outlines and dimensions.
- `page`: the page of forecasts and its tables.
"""
