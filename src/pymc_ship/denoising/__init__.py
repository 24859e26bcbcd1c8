"""Wavelet shrinkage of signals and records."""
