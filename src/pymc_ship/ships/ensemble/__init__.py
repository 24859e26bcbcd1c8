"""The ship: draws of its models with the laws of their errors, and its files.

- `ship`: a ship from an identification, a posterior or a vessel file.
- `draws`: coefficient draws from posteriors.
- `feasibility`: feasibility of simulated ships.
- `calibration`: constants calibrated on other ships, from `calibration.toml`.
- `index_error`: model error of indices from held-out manoeuvres.
- `index_table`: measured and forecast indices of recorded manoeuvres, runs x indices.
- `motion_error`: error of the motion along a record, by lead time.
- `scores`: bands, coverage and the score of a forecast distribution.
- `files`: a ship saved and loaded.
"""
