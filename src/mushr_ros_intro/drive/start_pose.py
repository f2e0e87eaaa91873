"""Wait until the car reports the start pose."""

import math
from typing import Optional

import rospy
from geometry_msgs.msg import PoseStamped

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.ros import connections, ros_time

POSE_TOLERANCE = 1e-3
"""How far the reported pose may differ from the start pose [m, rad]."""


class StartPose:
    """The start pose, and what /CAR_NAME/car_pose (geometry_msgs/PoseStamped) reports.

    Args:
        car_name: the name of the car.
        pose: the start pose in the map frame.
    """

    def __init__(self, car_name: str, pose: Pose) -> None:
        self._pose = pose
        self._last: Optional[PoseStamped] = None
        # Of the poses that arrive together in lock-step, only the newest one is read: the clock
        # waits at the first report of an initial pose.
        self._subscriber = rospy.Subscriber(
            f"/{car_name}/car_pose", PoseStamped, self._on_pose, queue_size=1, tcp_nodelay=True
        )
        self._topic = self._subscriber.resolved_name

    def wait_until_connected(self, publisher: rospy.Publisher, seconds: float) -> None:
        """Wait until the car reports its pose, and then for the subscribers of `publisher`.

        On a busy machine, the mux and click_planner can be ready before the car.

        Raises: as connections.wait_for_subscriber.
        """
        if connections.wait_until_connected(self._subscriber, "publishers", seconds, minimum=1):
            ros_time.wait_for(lambda: self._last, seconds)
        connections.wait_for_subscriber(publisher, seconds)

    def wait_until_reported(self, since: int, seconds: float, is_last: bool) -> int:
        """Wait until the car reports the start pose.

        Args:
            since: the stamp of the initial pose that was sent [ns].
            seconds: timeout [s of wall-clock time].
            is_last: end the subscription then; in lock-step, each report wakes up the node.

        Returns:
            The stamp of such a report [ns], in lock-step of the first one; `since` if no node
            publishes the car's pose.

        Raises:
            UserError: the car does not report the start pose in time.
            rospy.ROSInterruptException: the node is shut down.
        """
        if not self._subscriber.get_num_connections() and not connections.is_published(self._topic):
            rospy.loginfo("no node publishes %s, so the start pose is not checked", self._topic)
            return since
        stamp = ros_time.wait_for(lambda: self._stamp_at_start(since), seconds)
        if stamp is None:
            last = _pose(self._last) if self._last else "nothing"
            raise UserError(
                f"the car was not at the start pose {self._pose} within {seconds:g} s; "
                f"{self._topic} reports {last}. Is the start pose inside a wall, is the clock "
                "held, does another node place or drive the car, or is it placed on another topic "
                "than ~init_pose_topic?"
            )
        if is_last:
            self._subscriber.unregister()
        return stamp

    def _stamp_at_start(self, since: int) -> Optional[int]:
        """Return the stamp of the newest report [ns] if it shows the start pose after `since`."""
        msg = self._last
        if msg is None or not _pose(msg).is_close_to(self._pose, POSE_TOLERANCE):
            return None
        stamp = ros_time.received_stamp(msg.header.stamp.to_nsec())
        return stamp if stamp >= since else None

    def _on_pose(self, msg: PoseStamped) -> None:
        self._last = msg


def _pose(msg: PoseStamped) -> Pose:
    """Return the planar pose of a message; a yaw of a quaternion of any length."""
    p, q = msg.pose.position, msg.pose.orientation
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), q.w**2 + q.x**2 - q.y**2 - q.z**2)
    return Pose(p.x, p.y, yaw)
