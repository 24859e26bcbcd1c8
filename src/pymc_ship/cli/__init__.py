"""The command line: words in, text out. No other wing imports this one."""
