"""Tests: a folder for each wing, whole journeys, foreign ships, and every path to a posterior against the others."""
