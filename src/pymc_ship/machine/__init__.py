"""Files, processes, threads and seeds for every wing; imports no other wing.

- `errors`: the errors of the package, under one root.
- `files`: results that appear only when they are complete.
- `checksums`: SHA-256 of result files, checked before a file is read.
- `arguments`: checks of choices and numbers; an error is one sentence.
- `names`: the known name nearest to a misspelt one.
- `text`: UTF-8 text files, and what a file of another encoding is.
- `fields`: the short `repr` of a dataclass.
- `toml`: TOML files, checked key by key.
- `memory`: memory that this process uses and may use.
- `threads`: one pool of threads for the package, one thread inside a worker process.
- `workers`: processes on the local cores or on a Dask cluster.
- `seeds`: a random generator for each purpose, from one root seed.
"""
