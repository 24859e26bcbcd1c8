"""All coefficients at once: the simulated motion fitted to recorded motion (output-error method).

- `runs`: a trial in the arrays of the likelihood.
- `prior`: prior of all coefficients of a vessel.
- `scale_law`: law of the scales of a prior, and draws with them integrated out.
- `fit`: posterior mode and normal approximation for given noise.
- `noise`: choice of the noise model by the residuals.
- `mode`: best mode of several starts.
- `posterior`: draws about the mode as a DataTree.
- `windows`: fits to windows of several runs, with robust covariance.
- `randomize_then_optimize`: draws of such a fit along the curve of equal likelihood.
- `sequential_likelihood`: likelihood of earlier runs, for fits to later ones.
"""
