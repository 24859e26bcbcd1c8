"""Studies of many tasks, such as grids of experiments, that can be stopped and continued.

`run` gives the tasks of a `study` (by default a `grid`) to workers, `store` saves each result, `page` reports.
"""
