"""The ship: draws of its models with the laws of their errors, kept in files.

- `ship`: a ship, of an identification, a posterior or a vessel file.
- `draws`: coefficient draws from posteriors, with motion and noise of their data.
- `feasibility`: whether simulated ships stay what a ship can be.
- `calibration`: constants that studies of other ships chose, from `calibration.toml`.
- `index_error`: model error of indices from held-out manoeuvres.
- `index_table`: indices of recorded manoeuvres beside their forecasts, runs x indices.
- `motion_error`: error of the motion along a record, by the time since its start.
- `scores`: bands, coverage and the score of a forecast distribution.
- `files`: a ship saved and loaded.
"""
