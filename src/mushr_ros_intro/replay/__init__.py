"""Let one node drive a plan in a world of its own, and judge the drive."""
