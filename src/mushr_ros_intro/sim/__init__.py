"""Time and command selection in the simulation."""
