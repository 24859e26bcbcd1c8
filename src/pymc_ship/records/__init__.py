"""What sensors wrote of a ship, read, judged and smoothed.

Here live the readers of trial files, the denoisers, the recognition of manoeuvres and the checks of a record. Files as
a logger wrote them, or simulated trials, enter. Trial Datasets in SI units with their checks leave.

- `files`: files read with their columns, units, signs and time base; noise and instruments.
- `denoising`: wavelet shrinkage, other smoothers and derivatives of sampled signals.
- `steering`: which manoeuvre a record holds, and its indices as measured.
- `checks`: whether a record can be trusted, and its mending.
"""
