#!/usr/bin/python3
"""Keep one core busy for a third of the time, in turns, for as long as the test runs.

What has to run then is late; the rest is for the tests that run beside this one.
"""

import time

import rospy

BUSY = 0.1
"""[s] In each turn."""

REST = 0.2
"""[s] After it."""

if __name__ == "__main__":
    rospy.init_node("busy")
    while not rospy.is_shutdown():
        end = time.monotonic() + BUSY
        while time.monotonic() < end:
            sum(range(10_000))
        time.sleep(REST)
