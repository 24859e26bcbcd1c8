"""One degree of freedom: rows, priors and exact posteriors."""
