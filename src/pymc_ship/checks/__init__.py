"""Whether a record can be trusted, and its mending."""
