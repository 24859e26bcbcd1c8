"""Readers of trial files, denoisers, recognition of manoeuvres and checks: records in, trial Datasets in SI units out.

- `files`: files read with their columns, units, signs and time base; noise and instruments.
- `denoising`: wavelet shrinkage, other smoothers and derivatives of sampled signals.
- `steering`: the manoeuvre in a record, and its measured indices.
- `checks`: whether a record can be trusted, and its correction.
"""
