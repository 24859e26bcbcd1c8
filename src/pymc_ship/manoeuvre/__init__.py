"""What is steered, its indices and IMO criteria, and how a record of it is recognised."""
