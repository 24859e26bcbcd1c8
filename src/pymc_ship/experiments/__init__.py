"""Studies of many tasks, such as grids of experiments, that can be stopped and continued.

- `study`: what the engine asks of a study.
- `grid`: ships x manoeuvres x noise x methods x seeds, read from TOML.
- `task`: one seed of one cell: simulated, polluted, fitted, scored.
- `methods`: methods of the user's own.
- `store`: results kept one by one and merged into Parquet.
- `run`: the tasks of a study handed to workers.
- `tables`: scores of cells, costs and a plan.
- `figures`: scores with error bars.
- `page`: the page of a grid.
"""
