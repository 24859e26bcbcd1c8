"""Populations of ships that judge the intervals of the package, and choose constants that it carries.

- `study`: ships drawn, the trials they sail and what is forecast, read from TOML.
- `judged_ship`: one ship drawn, identified and compared with its own motion.
- `coverage`: what the intervals of a population hold.
- `figures`: coverage, reliability and bands of the motion.
- `calibration`: what a study counts, written into the constants of the package.
- `page`: the page of a population.
"""

from studies.population.judged_ship import DrawnShip
from studies.population.study import Population

__all__ = ["DrawnShip", "Population"]
