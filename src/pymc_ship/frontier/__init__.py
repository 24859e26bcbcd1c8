"""Every method beside the reference ship and the Cramer-Rao bound, over many seeds."""
