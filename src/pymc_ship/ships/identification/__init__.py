"""A real ship identified from several trials: ensemble of term sets, cross-validation over runs, pages.

- `candidates`: fit, cross-validation and acceptance of each term set.
- `model`: weights of the term sets, model error and draws of the ensemble.
- `held_out`: leave-one-run-out cross-validation: predictive density and indices of each held-out run.
- `held_out_errors`: errors of held-out indices and coverage of their intervals.
- `open_loop`: simulation along the measured inputs of a record.
- `replay`: bands and score of that motion.
- `score_page`: page of a score.
- `figures`: held-out windows, overshoots and scores.
- `opening`: sentences of its first screen.
- `page`: page of an identification and its tables.
"""
