"""A real ship from several trials: ensemble of term sets, held-out runs and page.

- `candidates`: term sets fitted to the runs, or refused.
- `model`: term sets weighted and drawn from.
- `held_out`: runs left out: score of their windows, indices beside their forecasts.
- `held_out_errors`: errors of held-out indices, and what their intervals cover.
- `along`: ships along the measured inputs of a record.
- `replayed`: the motion along a record's inputs, and its score.
- `score_page`: the page of a score.
- `figures`: held-out windows, overshoots and scores.
- `page`: the page of an identification and its tables.
"""
