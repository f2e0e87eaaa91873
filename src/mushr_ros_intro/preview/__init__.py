"""Predict a plan's outcome before it is driven."""
