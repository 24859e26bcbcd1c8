"""A ship as data: particulars, inertia, force terms with coefficients, and what is known of hulls."""
