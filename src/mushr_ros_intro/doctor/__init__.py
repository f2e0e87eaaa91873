"""Explain why the car does not move."""
