#!/usr/bin/python3
"""Make a plan in rviz: place the car, and click where it is to drive."""

import math
import sys
import threading
from typing import List, NamedTuple, Optional, Tuple

import rospy
from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped
from nav_msgs.msg import Path
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from mushr_ros_intro.authoring.clicks import ClickError, path, pose_after, row_to
from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.model import Car
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.parameters import ParameterError, Parameters, file_name, folder, number, text
from mushr_ros_intro.plan.model import MAX_SPEED, MAX_STEERING_ANGLE, Plan, Row
from mushr_ros_intro.plan.write import WriteError, write_plan
from mushr_ros_intro.preview import prediction
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.ros.node import init_node
from mushr_ros_intro.sim.stamps import NANOSECONDS

USUAL_STEERING_LIMIT = 0.34
"""Of a car whose profile has none [rad]; MuSHR's teleop steers so far."""

PERIOD = NANOSECONDS // 20
"""Between the poses of the path that is drawn [ns]."""

MAX_PATH_POSES = 10_000
"""The path of a long plan has no more poses than about this many."""

SAME = 1e-9
"""A start pose is not a new one within this [m, rad]: path_publisher sends the plan's own."""


class Step(NamedTuple):
    """A row of the plan, and where it ends."""

    row: Row
    end: Pose


class ClickPlanner:
    """The planner as a node.

    Subscribes to ``~init_pose_topic``, where the plan starts, and to ``clicked_point``, each the
    end of one more arc; both in the map frame. Publishes the plan so far on ``~path``, latched.
    Services: ``~undo`` takes back the last click, ``~clear`` all, ``~save`` writes a plan file.
    """

    def __init__(self) -> None:
        car_name = text("~car_name", rospy.get_param("~car_name", "car")).strip("/")
        car_sim = f"/{car_name}/car_sim"
        car = car_from(Parameters(rospy.get_param(car_sim, {}), f"{car_sim}/"))

        def parameter(name: str, default: float, unit: str, least: float, most: float) -> float:
            return number(f"~{name}", rospy.get_param(f"~{name}", default), unit, least, most)

        wheelbase = parameter("wheelbase", car.wheelbase, "m", 0.01, 100.0)
        own = max(car.steering_limit_left, car.steering_limit_right)
        usual = USUAL_STEERING_LIMIT if math.isinf(own) else min(own, MAX_STEERING_ANGLE)
        limit = parameter("max_steering_angle", usual, "rad", 0.001, MAX_STEERING_ANGLE)
        # The car that the plan is for obeys at once; a plan has no ramps.
        self._car = Car(
            wheelbase=wheelbase,
            steering_limit_left=min(limit, car.steering_limit_left),
            steering_limit_right=min(limit, car.steering_limit_right),
        )
        self._speed = min(parameter("speed", 1.0, "m/s", 0.001, MAX_SPEED), car.speed_limit)
        init_pose_topic = text(
            "~init_pose_topic", rospy.get_param("~init_pose_topic", "/initialpose")
        )
        self._folder = folder("~folder", rospy.get_param("~folder", "."))
        self._name = file_name("~name", rospy.get_param("~name", "clicked.txt"))
        rospy.loginfo(
            "speed %g m/s, wheelbase %g m, steering from %g to %g rad; plans go to %s",
            self._speed,
            self._car.wheelbase,
            -self._car.steering_limit_right,
            self._car.steering_limit_left,
            self._folder,
        )

        self._lock = threading.Lock()
        self._start: Optional[Pose] = None
        self._steps: List[Step] = []
        self._saved: Tuple[Row, ...] = ()

        self._path_pub = rospy.Publisher("~path", Path, queue_size=1, latch=True)
        self._draw()
        rospy.Service("~undo", Trigger, self._on_undo)
        rospy.Service("~clear", Trigger, self._on_clear)
        rospy.Service("~save", Trigger, self._on_save)
        self._start_sub = rospy.Subscriber(
            init_pose_topic, PoseWithCovarianceStamped, self._on_start
        )
        self._point_sub = rospy.Subscriber("clicked_point", PointStamped, self._on_point)

    @property
    def _plan(self) -> Optional[Plan]:
        """The plan so far, None where it has no start; needs the lock."""
        if self._start is None:
            return None
        return Plan("", self._start, tuple(step.row for step in self._steps))

    def _on_start(self, msg: PoseWithCovarianceStamped) -> None:
        """Begin a plan."""
        try:
            pose = conversions.initial_pose_from_msg(msg).pose
        except conversions.MessageError as error:
            rospy.logwarn(f"ignored a start pose on {self._start_sub.resolved_name}: {error}")
            return
        with self._lock:
            if self._start is not None and _same(pose, self._start):
                return
            rows = tuple(step.row for step in self._steps)
            is_lost = rows and rows != self._saved
            self._start, self._steps, self._saved = pose, [], ()
            self._draw()
        if is_lost:
            rospy.logwarn("the car was placed: the clicks before were not saved")
        rospy.loginfo("a new plan starts at %s; click where it goes", pose)

    def _on_point(self, msg: PointStamped) -> None:
        """Add the arc to a point."""
        try:
            point = conversions.point_from_msg(msg)
        except conversions.MessageError as error:
            rospy.logwarn(f"ignored a point on {self._point_sub.resolved_name}: {error}")
            return
        with self._lock:
            if self._start is None:
                rospy.logwarn(
                    "the plan has no start pose yet, so the point is ignored; place the car on "
                    f"{self._start_sub.resolved_name} first (in rviz: 2D Pose Estimate)"
                )
                return
            pose = self._steps[-1].end if self._steps else self._start
            try:
                row = row_to(pose, point, self._speed, self._car)
            except ClickError as error:
                rospy.logwarn(f"refused: {error}")
                return
            self._steps.append(Step(row, pose_after(pose, row, self._car)))
            self._draw()
            count, summary = len(self._steps), self._summary()
        rospy.loginfo("click %d: %g rad%s; %s", count, row.steering_angle, _gear(row), summary)

    def _on_undo(self, _: TriggerRequest) -> TriggerResponse:
        """Take back the last click."""
        with self._lock:
            if not self._steps:
                return TriggerResponse(False, "there is no click to take back")
            self._steps.pop()
            self._draw()
            summary = self._summary()
        rospy.loginfo("undone; %s", summary)
        return TriggerResponse(True, summary)

    def _on_clear(self, _: TriggerRequest) -> TriggerResponse:
        """Take back every click; the start pose stays."""
        with self._lock:
            self._steps = []
            self._draw()
            summary = self._summary()
        rospy.loginfo("cleared; %s", summary)
        return TriggerResponse(True, summary)

    def _on_save(self, _: TriggerRequest) -> TriggerResponse:
        """Write the plan into a new file."""
        with self._lock:
            plan, summary = self._plan, self._summary()
        if plan is None or not plan.rows:
            return TriggerResponse(False, "nothing saved: there is no click yet")
        try:
            file = write_plan(self._folder, self._name, plan.start, plan.rows)
        except WriteError as error:
            return TriggerResponse(False, f"nothing saved: {error}")
        with self._lock:
            self._saved = plan.rows
        rospy.loginfo("saved %s", file)
        return TriggerResponse(True, f"saved {file}; {summary}")

    def _summary(self) -> str:
        """Say how long the plan is; needs the lock."""
        plan = self._plan
        if plan is None or not plan.rows:
            return "the plan has no row yet"
        seconds = plan.duration / NANOSECONDS
        return (
            f"the plan has {len(plan.rows)} rows, {prediction.length(plan):.3f} m, {seconds:.3f} s"
        )

    def _draw(self) -> None:
        """Publish the plan so far; needs the lock."""
        now = rospy.get_rostime().to_nsec()
        plan = self._plan
        if plan is None:
            self._path_pub.publish(conversions.path_to_msg([], now))
            return
        period = max(PERIOD, plan.duration // MAX_PATH_POSES)
        states = path(Pose(*plan.start), plan.rows, self._car, period)
        self._path_pub.publish(conversions.path_to_msg(states, now))


def _gear(row: Row) -> str:
    """Say whether a row goes backwards."""
    return ", in reverse" if row.speed < 0.0 else ""


def _same(one: Pose, other: Pose) -> bool:
    """Say whether two poses are the same, but for the rounding of messages."""
    apart = math.hypot(one.x - other.x, one.y - other.y)
    return max(apart, abs(math.remainder(one.theta - other.theta, math.tau))) <= SAME


def main() -> int:
    """Run the node; return its exit status."""
    init_node("click_planner")
    try:
        ClickPlanner()
    except ParameterError as error:
        rospy.logfatal("%s: %s", rospy.get_name(), error)
        return 1
    rospy.spin()
    return 0


if __name__ == "__main__":
    sys.exit(main())
