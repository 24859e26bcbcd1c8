"""What runs can tell of a ship, and which runs to make next.

- `closed_loop`: sensitivities of a zigzag whose rudder depends on the ship.
- `candidates`: manoeuvres that may be worth running.
- `trial_design`: the choice among them, from a posterior of the coefficients.
- `next_run`: the choice for an identified ship, from the ensemble of her draws.
- `outlook`: what the report of such a ship says of her turning circle and her next run.
"""
