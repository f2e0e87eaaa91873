"""Send the commands of a plan to a car, and stop it."""
