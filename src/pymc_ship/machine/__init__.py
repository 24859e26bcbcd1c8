"""What every wing asks of the computer: files, threads, workers and random numbers."""
