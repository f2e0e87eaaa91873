#!/usr/bin/python3
"""A publisher with the habits of the tutorial's listing, to drive the car with.

It sleeps for a second where it should wait for subscribers, fills in no stamp and no frame, and
sends no stop at the end.
"""

import rospy
from ackermann_msgs.msg import AckermannDrive, AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped
from tf.transformations import quaternion_from_euler


def main():
    rospy.init_node("listing")
    control_topic = rospy.get_param("~control_topic", "/car/mux/ackermann_cmd_mux/input/navigation")
    commands = rospy.Publisher(control_topic, AckermannDriveStamped, queue_size=1)
    init_pose_topic = rospy.get_param("~init_pose_topic", "/initialpose")
    placements = rospy.Publisher(init_pose_topic, PoseWithCovarianceStamped, queue_size=1)
    with open(rospy.get_param("~plan_file")) as plan_file:
        plan = [tuple(map(float, line.split(","))) for line in plan_file]
    rospy.sleep(1.0)

    x, y, theta = plan[0]
    placement = PoseWithCovarianceStamped()
    position, orientation = placement.pose.pose.position, placement.pose.pose.orientation
    position.x, position.y = x, y
    orientation.x, orientation.y, orientation.z, orientation.w = quaternion_from_euler(0, 0, theta)
    placements.publish(placement)
    for speed, steering_angle in plan[1:]:
        drive = AckermannDrive(speed=speed, steering_angle=steering_angle)
        rate = rospy.Rate(10)
        begin = rospy.Time.now()
        while rospy.Time.now() - begin < rospy.Duration(1.0):
            commands.publish(AckermannDriveStamped(drive=drive))
            rate.sleep()


if __name__ == "__main__":
    main()
