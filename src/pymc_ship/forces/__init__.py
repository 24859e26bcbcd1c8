"""What acts on a ship, as functions of her motion and inputs."""
