"""All coefficients at once: the simulated motion fitted to raw records.

- `runs`: a trial as the trajectory likelihood takes it.
- `prior`: prior of all coefficients of a vessel.
- `fit`: mode and normal approximation under given noise.
- `noise`: the noise model that the residuals call for.
- `mode`: the best mode from several starts.
- `posterior`: draws around the mode as a DataTree.
- `windows`: fits to windows of several runs, with robust covariance.
- `carried`: draws of such a fit that fit the windows, too.
- `statements`: what windows said, carried on beside the prior of other runs.
"""
