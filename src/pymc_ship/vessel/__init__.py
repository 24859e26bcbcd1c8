"""A ship as data: particulars, inertia, force terms with their coefficients, and what is known of hulls.

- `vessel`: a vessel, read from TOML and checked key by key.
- `term_sets`: sets of force terms that a ship may be identified with.
- `hull_database`: coefficients of a hull from regression formulae of captive tests.
"""
