"""Maps, collisions and the laser."""
