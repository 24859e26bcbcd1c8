"""A real ship from several trials: ensemble, held-out runs and page."""
