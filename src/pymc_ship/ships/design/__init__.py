"""Which run to make next.

- `next_run`: the choice among manoeuvres, from the ensemble of the draws of a ship.
- `outlook`: forecasts of the standard manoeuvres and the recommended next run.
"""
