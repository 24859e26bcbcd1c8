"""What a posterior says of itself, and its page."""
