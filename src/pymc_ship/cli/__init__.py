"""The command line: words in, text out. No other wing imports this one.

- `main`: the command ``pymc-ship``: errors, interrupts, progress.
- `parser`: commands, options and worked examples.
- `sentences`: the line that says why a command cannot run.
- `examples`: worked examples of each command.
- `words`: numbers and names of the command line, checked.
- `files`: trials in, results out.
- `texts`: results as lines of text.
- `commands`: commands about one trial or one posterior.
- `ship_commands`: commands about a real ship.
"""
