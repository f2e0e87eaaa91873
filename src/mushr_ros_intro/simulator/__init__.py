"""The nodes of the simulated car: the car itself, its clock, and the mux of its commands."""
