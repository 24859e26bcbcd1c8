"""Which run to make next.

- `next_run`: the choice among manoeuvres, from the ensemble of the draws of a ship.
- `outlook`: the turning circle and the next run of a ship, in sentences.
"""
