"""What runs can tell of a ship, and which runs to make next."""
