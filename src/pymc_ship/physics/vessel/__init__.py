"""A ship as data: particulars, inertia, force terms with coefficients, and priors of them.

- `vessel`: the class `Vessel`.
- `reading`: the vessel file, read key by key.
- `inertia`: estimates of mass, inertia and added mass from the particulars.
- `ranges`: possible and usual ranges of the numbers of a vessel file.
- `plausibility`: numbers outside these ranges.
- `parts`: parts of the force of a vessel, with typical parameters.
- `rescaling`: coefficients in the bis system and in that of MMG papers.
- `term_sets`: sets of force terms for an identification.
- `hull_database`: prior of hull coefficients from regression formulae of captive tests.
"""
