"""Posterior draws carried into manoeuvres, with bands, intervals and a page.

- `forecast`: simulated ships of the draws, their bands and indices.
- `prior_ships`: simulated ships of a prior, before there is a fit.
- `extrapolation`: how far a forecast leaves the motion of the data.
- `steady_turns`: the rudder that holds each rate of turn, and the loop of an unstable ship.
- `stopping`: full astern until the ship is dead in the water.
- `figures`: heading, rudder and motion of a forecast.
- `force_curves`: forces of the draws over drift, yaw rate and rudder.
- `track`: tracks with ship outlines and dimensions.
- `page`: the page of forecasts and its tables.
"""
