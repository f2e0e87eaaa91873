"""Maps, and what the car and its laser meet in them."""
