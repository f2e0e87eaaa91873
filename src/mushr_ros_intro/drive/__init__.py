"""Send the commands of a plan to a car, and watch what happens to them."""
