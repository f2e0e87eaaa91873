#!/usr/bin/python3
"""The tutorial's listing with a fault, for tests of replays: wrong_listing.py FAULT.

Unlike the listing, the node waits for its subscribers and counts its commands: sleep and clock are
not exact on a busy machine.
"""

import os
import signal
import sys

import rospy
from ackermann_msgs.msg import AckermannDrive, AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped
from messages import NAVIGATION, placement

from mushr_ros_intro.ros.connections import wait_until_connected

FAULTS = ("crash", "kill_replay")


def main(fault):
    rospy.init_node("wrong_listing")
    commands = rospy.Publisher(NAVIGATION, AckermannDriveStamped, queue_size=10)
    placements = rospy.Publisher("/initialpose", PoseWithCovarianceStamped, queue_size=10)
    with open(rospy.get_param("~plan_file")) as plan_file:
        plan = [tuple(map(float, line.split(","))) for line in plan_file]
    assert wait_until_connected(commands, "subscribers", 30.0)
    assert wait_until_connected(placements, "subscribers", 30.0)
    placements.publish(placement(rospy.Time(), *plan[0], frame=""))
    for row, (speed, steering_angle) in enumerate(plan[1:], 1):
        if fault == "crash" and row == 3:
            raise IndexError("list index out of range \x1b[0m")  # XML does not allow this character
        if fault == "kill_replay" and row == 3:
            os.kill(os.getppid(), signal.SIGKILL)
        drive = AckermannDrive(speed=speed, steering_angle=steering_angle)
        rate = rospy.Rate(10)
        for _ in range(10):
            commands.publish(AckermannDriveStamped(drive=drive))
            rate.sleep()


if __name__ == "__main__":
    assert sys.argv[1] in FAULTS
    main(sys.argv[1])
