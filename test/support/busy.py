#!/usr/bin/python3
"""Keep one core busy."""

import rospy

if __name__ == "__main__":
    rospy.init_node("busy")
    while not rospy.is_shutdown():
        sum(range(10_000))
