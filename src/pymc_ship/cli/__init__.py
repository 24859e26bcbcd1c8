"""The command line `pymc-ship`: arguments in, text out.

- `main`: entry point; errors, interrupts, progress.
- `parser`: commands, options and the error line.
- `examples`: examples of each command.
- `argument_types`: values of arguments, checked.
- `files`: trials, vessels and manoeuvres that a command names; files that it writes.
- `texts`: printed tables and sentences.
- `commands`: commands about one trial or one posterior.
- `ship_commands`: commands about a real ship.
- `check`: the command on one trial file.
- `check_page`: its page, with track, heading and rudder.
"""
