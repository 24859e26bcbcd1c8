"""Wavelet shrinkage and other smoothers of signals and records, and derivatives of sampled signals.

- `denoise`: a signal or a record, denoised.
- `draws`: posterior draws of a denoised signal or record.
- `shrinkage`: the wavelet coefficients of a signal with the posterior of each.
- `smoothers`: Savitzky-Golay, low-pass and Rauch-Tung-Striebel, each with its parameter by a principle.
- `wavelets`: transforms of a finite signal, and its extension past its ends.
- `derivative`: differences and Savitzky-Golay derivatives.
- `ebayes`: empirical-Bayes thresholding of a sequence.
- `spike_and_slab`: the compiled kernels of the mixture priors.
"""
