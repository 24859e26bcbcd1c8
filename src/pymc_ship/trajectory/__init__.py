"""All coefficients at once: the simulated motion fitted to raw records."""
