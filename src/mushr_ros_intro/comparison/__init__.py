"""Compare a recorded drive with its prediction, and fit the parameters of the car."""
