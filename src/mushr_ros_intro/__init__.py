"""What this package knows about plans, cars and muxes; nothing here needs a running ROS."""

import threading

# Debian 11's rospy still calls this when a node ends; Python 3.9 has it no longer.
if not hasattr(threading.Thread, "isAlive"):
    setattr(threading.Thread, "isAlive", threading.Thread.is_alive)  # noqa: B010
