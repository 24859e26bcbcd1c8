"""What every wing asks of the computer. Imports no other wing.

- `errors`: the errors of the package, under one root.
- `files`: results that appear under their name only when they are complete.
- `checksums`: sums that results carry, so that damage is found before they are used.
- `arguments`: checks of choices and numbers, with errors of one sentence.
- `text`: UTF-8 text, and a word on what else a file is.
- `fields`: short text of a dataclass.
- `toml`: TOML files, checked key by key.
- `memory`: the memory that a process has taken and may take, where the system says it.
- `threads`: one pool of threads for the package, one thread inside a worker process.
- `workers`: processes on the local cores or on a Dask cluster that do tasks one by one.
- `seeds`: a random generator for each purpose, from one root seed.
"""
