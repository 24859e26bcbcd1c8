"""Wavelet shrinkage of signals and records, and derivatives of sampled signals.

- `denoise`: a signal or a record, denoised.
- `wavelets`: transforms of a finite signal, and its extension past its ends.
- `derivative`: differences and Savitzky-Golay derivatives.
- `ebayes`: empirical-Bayes thresholding of a sequence.
- `spike_and_slab`: the compiled kernels of the mixture priors.
"""
