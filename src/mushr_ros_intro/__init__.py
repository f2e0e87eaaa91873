"""The library of the nodes: the ground floor, and one folder per product."""

import threading

# Debian 11's rospy calls this when a node ends, but Python 3.9 does not have it.
if not hasattr(threading.Thread, "isAlive"):
    setattr(threading.Thread, "isAlive", threading.Thread.is_alive)  # noqa: B010
