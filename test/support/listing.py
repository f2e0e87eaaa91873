#!/usr/bin/python3
"""A path publisher with the habits of the tutorial's listing.

It sleeps for one second instead of waiting for subscribers, unless ~connections is set. Its
messages have no stamp and no frame, and it sends no stop at the end.
"""

import rospy
from ackermann_msgs.msg import AckermannDrive, AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped
from messages import NAVIGATION, placement


def main():
    rospy.init_node("listing")
    control_topic = rospy.get_param("~control_topic", NAVIGATION)
    commands = rospy.Publisher(control_topic, AckermannDriveStamped, queue_size=1)
    init_pose_topic = rospy.get_param("~init_pose_topic", "/initialpose")
    placements = rospy.Publisher(init_pose_topic, PoseWithCovarianceStamped, queue_size=1)
    with open(rospy.get_param("~plan_file")) as plan_file:
        plan = [tuple(map(float, line.split(","))) for line in plan_file]
    rospy.sleep(1.0)
    # On a busy machine, one second is not enough, and the first commands are lost.
    least = rospy.get_param("~connections", 0)
    while min(commands.get_num_connections(), placements.get_num_connections()) < least:
        rospy.sleep(0.1)

    placements.publish(placement(rospy.Time(), *plan[0], frame=""))
    for speed, steering_angle in plan[1:]:
        drive = AckermannDrive(speed=speed, steering_angle=steering_angle)
        rate = rospy.Rate(10)
        begin = rospy.Time.now()
        while rospy.Time.now() - begin < rospy.Duration(1.0):
            commands.publish(AckermannDriveStamped(drive=drive))
            rate.sleep()


if __name__ == "__main__":
    main()
