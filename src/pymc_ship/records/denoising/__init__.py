"""Denoising of signals and trials, and derivatives of sampled signals.

- `denoise`: denoises a signal or a trial.
- `draws`: posterior draws of a denoised signal or trial.
- `wavelet_posterior`: wavelet coefficients of a signal with their posterior.
- `smoothers`: Savitzky-Golay, low-pass and Rauch-Tung-Striebel smoothers with automatic choice of the parameter.
- `wavelets`: transforms of a finite signal, and its extension past its ends.
- `derivative`: differences and Savitzky-Golay derivatives.
- `ebayes`: empirical-Bayes thresholding of a sequence.
- `spike_and_slab`: compiled kernels of the spike-and-slab priors.
"""
