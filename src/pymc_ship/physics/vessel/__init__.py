"""A ship as data: particulars, inertia, force terms with their coefficients, and what is known of hulls.

- `vessel`: a vessel.
- `reading`: the vessel file, read key by key.
- `inertia`: mass, inertia and added masses that a file leaves out.
- `ranges`: what each number of a ship lies between.
- `plausibility`: what is odd about the numbers of a vessel.
- `parts`: parts of a vessel's force and what is typical of them.
- `term_sets`: sets of force terms that a ship may be identified with.
- `hull_database`: coefficients of a hull from regression formulae of captive tests.
"""
