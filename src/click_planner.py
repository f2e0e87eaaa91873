#!/usr/bin/python3
"""Make a plan in rviz: set the start pose, then click the points to drive to."""

import math
import threading
from typing import Optional

import rospy
from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Path

from mushr_ros_intro.authoring.clicks import extend
from mushr_ros_intro.authoring.plan_file import PlanFile, plan_file_parameters, summary
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.parameters import Values, number
from mushr_ros_intro.plan.plan import MAX_SPEED, MAX_STEERING_ANGLE, Plan
from mushr_ros_intro.preview.prediction import trajectory
from mushr_ros_intro.ros import conversions, node, ros_time
from mushr_ros_intro.simulator.car_parameters import simulated_car_parameters
from mushr_ros_intro.stamps import STAMP_TOLERANCE

DEFAULT_STEERING_LIMIT = 0.34
"""For a car whose profile has no limit [rad]; the one of MuSHR's teleop."""

SAME_POSE = 1e-9
"""Start poses that differ by less are the same [m, rad]: messages round them."""


LIMIT = "limit to both sides; by default that of the car, or 0.34 without one"


class ClickPlanner:
    """The planner as a node.

    Subscribes to ``clicked_point``, the end of one more arc. The first arc begins at the pose of
    the car, ``/CAR_NAME/car_pose``, or without one, at the last pose on ``~init_pose_topic``, which
    begins a new plan; all in the map frame. Publishes the plan so far on ``~path``, latched.
    Services: ``~undo`` removes the last click, ``~clear`` removes all, ``~save`` writes a plan
    file.

    Example: ``rosrun mushr_ros_intro click_planner.py _speed:=0.5``
    """

    PARAMETERS = (
        node.car_name("the car to plan for"),
        node.init_pose_topic("topic of the start pose"),
        *plan_file_parameters("clicked.txt"),
        number("max_steering_angle", None, "rad", 0.001, MAX_STEERING_ANGLE, LIMIT),
        number("wheelbase", None, "m", 0.01, 100.0, "by default that of the car"),
        number("speed", 1.0, "m/s", 0.001, MAX_SPEED, "of every row, at most the car's limit"),
    )

    def __init__(self, values: Values) -> None:
        self._file = PlanFile(values["folder"], values["name"])
        limit, wheelbase = values["max_steering_angle"], values["wheelbase"]
        car = car_from(simulated_car_parameters(values["car_name"]))
        if limit is None:
            limit = max(car.steering_limit_left, car.steering_limit_right)
            limit = DEFAULT_STEERING_LIMIT if math.isinf(limit) else min(limit, MAX_STEERING_ANGLE)
        # A plan's rows change speed and steering angle at once, and the noise is not known.
        self._car = car._replace(
            wheelbase=car.wheelbase if wheelbase is None else wheelbase,
            steering_limit_left=min(limit, car.steering_limit_left),
            steering_limit_right=min(limit, car.steering_limit_right),
            acceleration=math.inf,
            steering_rate=math.inf,
            speed_noise=0.0,
            steering_noise=0.0,
        )
        self._speed = min(values["speed"], car.speed_limit)
        rospy.loginfo(
            "speed %g m/s, wheelbase %g m, steering from %g to %g rad; %s",
            self._speed,
            self._car.wheelbase,
            -self._car.steering_limit_right,
            self._car.steering_limit_left,
            self._file.destination(),
        )

        self._lock = threading.Lock()
        self._plan: Optional[Plan] = None
        self._car_pose: Optional[Pose] = None
        """The latest one since the car was placed."""
        self._placed = 0
        """The stamp of the last start pose [ns]; older reports of the car may still arrive."""

        self._path_pub = rospy.Publisher("~path", Path, queue_size=1, latch=True)
        self._publish_path()
        node.offer_service("~undo", self._lock, self._undo)
        node.offer_service("~clear", self._lock, lambda: self._keep(0))
        node.offer_service("~save", self._lock, self._save)
        self._start_sub = rospy.Subscriber(
            values["init_pose_topic"], PoseWithCovarianceStamped, self._on_start
        )
        rospy.Subscriber(f"/{values['car_name']}/car_pose", PoseStamped, self._on_car_pose)
        rospy.Subscriber("clicked_point", PointStamped, self._on_point)

    def run(self) -> None:
        """Run until the node is shut down."""
        rospy.spin()

    @conversions.ignore_bad_messages
    def _on_start(self, msg: PoseWithCovarianceStamped) -> None:
        stamp, pose, _ = conversions.initial_pose_from_msg(msg)
        with self._lock:
            # path_publisher sends the start pose of the plan that it drives: keep that plan.
            if self._plan is not None and pose.is_close_to(self._plan.start, SAME_POSE):
                return
            if not self._file.is_saved(self._plan):
                rospy.logwarn("new start pose: the clicks before it were not saved")
            self._plan, self._car_pose = Plan("", pose, ()), None
            self._placed = ros_time.received_stamp(stamp)
            self._publish_path()

    @conversions.ignore_bad_messages
    def _on_car_pose(self, msg: PoseStamped) -> None:
        stamp, pose, _ = conversions.initial_pose_from_msg(msg)
        with self._lock:
            late = self._placed - ros_time.received_stamp(stamp)
            if not 0 < late <= STAMP_TOLERANCE:  # more if the clock was set back
                self._car_pose = pose

    @conversions.ignore_bad_messages
    def _on_point(self, msg: PointStamped) -> None:
        point = conversions.point_from_msg(msg)
        with self._lock:
            plan = self._plan_to_extend()
            if plan is None:
                rospy.logwarn(
                    "ignored a point: the plan has no start pose yet; set it first on "
                    f"{self._start_sub.resolved_name} (in rviz: 2D Pose Estimate; in the browser: "
                    "Place car)"
                )
                return
            try:
                self._plan = extend(plan, point, self._speed, self._car)
            except UserError as error:
                rospy.logwarn(f"refused: {error}")
                return
            self._publish_path()
            row, count = self._plan.rows[-1], len(self._plan.rows)
            if count == 1:  # not earlier: each drive of a plan places the car
                rospy.loginfo("a new plan starts at %s", self._plan.start)
            gear = "in reverse" if row.speed < 0.0 else "forward"
            rospy.loginfo(
                "click %d: %.3f rad, %s; %s", count, row.steering_angle, gear, summary(self._plan)
            )

    def _plan_to_extend(self) -> Optional[Plan]:
        """Return the plan so far; before the first click, it starts at the car; needs the lock."""
        plan, pose = self._plan, self._car_pose
        if (plan and plan.rows) or pose is None:
            return plan
        # A placed car is at the start pose, which its messages round.
        return plan if plan and pose.is_close_to(plan.start, SAME_POSE) else Plan("", pose, ())

    def _undo(self) -> str:
        """Remove the last click; return a message; needs the lock.

        Raises:
            UserError: there is none.
        """
        if self._plan is None or not self._plan.rows:
            raise UserError("there is no click to undo")
        return self._keep(len(self._plan.rows) - 1)

    def _keep(self, count: int) -> str:
        """Keep the start pose and the first `count` clicks; return a message; needs the lock."""
        if self._plan is None:
            return "the plan has no start pose yet"
        self._plan = self._plan._replace(rows=self._plan.rows[:count])
        self._publish_path()
        return summary(self._plan)

    def _save(self) -> str:
        """Write the plan into a new file; return a message; needs the lock."""
        return self._file.save(self._plan, "there is no click yet")

    def _publish_path(self) -> None:
        """Publish the path of the plan so far; needs the lock."""
        states = []
        if self._plan is not None:
            states = list(trajectory(self._plan, self._car))
        self._path_pub.publish(conversions.path_to_msg(states, ros_time.now()))


if __name__ == "__main__":
    node.main("click_planner", ClickPlanner, is_replaceable=False)
