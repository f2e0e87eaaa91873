#!/usr/bin/python3
"""Drive the plan in the file ~plan_file: the tutorial's listing, corrected."""

import math
import sys
import time
from collections import deque

import rospy
from ackermann_msgs.msg import AckermannDrive, AckermannDriveStamped
from geometry_msgs.msg import Point, Pose, PoseStamped, PoseWithCovarianceStamped, Quaternion
from std_msgs.msg import Header
from tf.transformations import quaternion_from_euler

PERIOD = rospy.Duration(0, 100000000)  # 0 s and 100,000,000 ns: integers, so 10 of them are 1 s


def run_plan(pub_init_pose, pub_controls, plan):
    """Drive the plan; return when it ends."""
    due = send_init_pose(pub_init_pose, *plan[0])
    for c in plan[1:]:
        due = send_command(pub_controls, due, *c)
    sleep_until(due)
    return due


def send_init_pose(pub_init_pose, x, y, theta):
    """Place the car; return the stamp of a pose that shows the car at its start pose."""
    poses = deque(maxlen=1)  # the newest message
    sub = rospy.Subscriber("/car/car_pose", PoseStamped, poses.append)
    wait_until(lambda: poses, f"a message on {sub.name}", timeout=10)

    q = Quaternion(*quaternion_from_euler(0, 0, theta))
    init_pose = PoseWithCovarianceStamped()
    init_pose.header = Header(stamp=rospy.Time.now(), frame_id="map")
    init_pose.pose.pose = Pose(position=Point(x=x, y=y), orientation=q)
    pub_init_pose.publish(init_pose)

    def is_there():
        p, o = poses[0].pose.position, poses[0].pose.orientation
        # Two unit quaternions q and o are the same rotation if their dot product is 1 or -1.
        is_close = math.hypot(p.x - x, p.y - y) < 0.001 and abs(o.z * q.z + o.w * q.w) > 0.999999
        return is_close and poses[0].header.stamp > init_pose.header.stamp

    wait_until(is_there, f"the car to be at the start pose {x}, {y}, {theta}", timeout=10)
    sub.unregister()
    return poses[0].header.stamp


def send_command(pub_controls, due, v, delta, duration):
    """Send a command every 0.1 s for `duration` [s] from `due` on; return when it ends."""
    end = due + rospy.Duration(0, round(duration * 1e9))
    while due < end:
        sleep_until(due)
        header = Header(stamp=due, frame_id="car/base_footprint")
        drive = AckermannDrive(steering_angle=delta, speed=v)
        pub_controls.publish(AckermannDriveStamped(header=header, drive=drive))
        due += PERIOD
    return end


def sleep_until(instant):
    wait_until(lambda: rospy.Time.now() >= instant)


def wait_until(condition, what="", timeout=math.inf):
    """Wait until a condition is true, for `timeout` seconds of real time at most."""
    deadline = time.monotonic() + timeout
    while not condition():
        if rospy.is_shutdown():
            sys.exit()
        if time.monotonic() > deadline:
            sys.exit(f"waited {timeout} s for {what}")
        time.sleep(0.001)


def read_plan(plan_file):
    """Return the start pose [x, y, theta], then the commands [v, delta, duration]."""
    try:
        with open(plan_file) as f:
            lines = f.readlines()
    except (OSError, ValueError) as error:  # ValueError: the file is not text
        sys.exit(f"{plan_file}: {error}")
    plan = []
    for number, line in enumerate(lines, 1):
        text = line.split("#")[0].strip()
        if not text:
            continue
        try:
            row = [float(word) for word in text.split(",")]
        except ValueError:
            row = []
        if plan and len(row) == 2:
            row.append(1.0)
        if len(row) != 3 or not all(map(math.isfinite, row)) or (plan and row[2] <= 0.0):
            expected = "speed, steering angle[, duration]" if plan else "x, y, theta"
            sys.exit(f"{plan_file}:{number}: '{text}'; expected {expected}")
        plan.append(row)
    if not plan:
        sys.exit(f"{plan_file}: no start pose; expected x, y, theta")
    return plan


if __name__ == "__main__":
    rospy.init_node("path_publisher")
    plan = read_plan(rospy.get_param("~plan_file"))

    control_topic = rospy.get_param("~control_topic", "/car/mux/ackermann_cmd_mux/input/navigation")
    pub_controls = rospy.Publisher(control_topic, AckermannDriveStamped, queue_size=10)

    init_pose_topic = rospy.get_param("~init_pose_topic", "/initialpose")
    pub_init_pose = rospy.Publisher(init_pose_topic, PoseWithCovarianceStamped, queue_size=1)

    wait_until(rospy.Time.now, "a message on /clock", timeout=10)  # time is 0 before it
    for pub in (pub_controls, pub_init_pose):
        wait_until(pub.get_num_connections, f"a subscriber of {pub.name}", timeout=10)

    stop = AckermannDriveStamped(header=Header(frame_id="car/base_footprint"))  # speed 0

    outputs = deque(maxlen=1)  # the newest command that the mux has passed on to the car
    rospy.Subscriber("/car/mux/ackermann_cmd_mux/output", AckermannDriveStamped, outputs.append)

    def send_stop():
        stop.header.stamp = stop.header.stamp or rospy.Time.now()
        pub_controls.publish(stop)  # another thread sends it, unless the node ends before
        deadline = time.monotonic() + 1.0
        while time.monotonic() < deadline:
            if outputs and outputs[0].header.stamp == stop.header.stamp:
                break
            time.sleep(0.001)

    rospy.on_shutdown(send_stop)  # at the end, on Ctrl-C and after an error
    stop.header.stamp = run_plan(pub_init_pose, pub_controls, plan)
