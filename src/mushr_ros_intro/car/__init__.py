"""The simulated car: its parameters, its motion and its event history."""
