"""Grids of experiments and populations of ships that can be stopped and continued.

- `grid`: ships x manoeuvres x noise x methods x seeds, read from TOML.
- `task`: one seed of one cell: simulated, polluted, fitted, scored.
- `methods`: methods of the user's own.
- `store`: results kept one by one and merged into Parquet.
- `run`: the tasks of a study handed to workers.
- `tables`: scores of cells, costs and a plan.
- `figures`: scores with error bars.
- `page`: the page of a grid.
- `population`: ships drawn, the trials they sail and what is forecast, read from TOML.
- `judged_ship`: one ship drawn, identified and compared with her own motion.
- `coverage`: what the intervals of a population hold.
- `population_page`: the page of a population.
"""
