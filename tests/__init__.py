"""Tests: a folder for each wing, whole journeys, and every path to a posterior against the others."""
