"""What this package knows about plans, cars and muxes; nothing here needs a running ROS."""
