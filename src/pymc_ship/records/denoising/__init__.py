"""Denoising of signals and trials, and derivatives of sampled signals.

`denoise` and `draws` are for signals and trials; `wavelets` transforms, `ebayes` and `spike_and_slab` shrink the
coefficients, `shrinkage` has their posterior, `smoothers` are the linear methods, `derivative` differentiates.
"""
