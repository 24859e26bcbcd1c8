"""Posterior draws carried into manoeuvres, with bands, intervals and a page.

- `draws`: coefficient draws from posteriors, with motion and noise of their data.
- `forecast`: simulated ships of the draws, their bands and indices.
- `prior_ships`: simulated ships of a prior, before there is a fit.
- `extrapolation`: how far a forecast leaves the motion of the data.
- `calibration`: constants that studies of other ships chose, from `calibration.toml`.
- `motion_error`: error of the motion along a record, by the time since its start.
- `steady_turns`: the rudder that holds each rate of turn, and the loop of an unstable ship.
- `stopping`: full astern until the ship is dead in the water.
- `index_error`: model error of indices from held-out manoeuvres.
- `figures`: heading, rudder and motion of a forecast.
- `force_curves`: forces of the draws over drift, yaw rate and rudder.
- `track`: tracks with ship outlines and dimensions.
- `page`: the page of forecasts and its tables.
"""
