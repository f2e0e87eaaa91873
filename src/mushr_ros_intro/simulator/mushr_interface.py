"""The topics and the services of MuSHR's simulator that car_sim does not have by itself.

The packages vesc_msgs and mushr_sim are needed for these only, so only car_sim imports this
module, and only with the parameter ``~mushr_interface``.
"""

import threading
from typing import Callable, Optional

import rospy
from geometry_msgs.msg import PointStamped, PoseStamped
from mushr_sim.srv import CarPose, CarPoseRequest
from nav_msgs.msg import Odometry
from std_msgs.msg import Float64, Header
from vesc_msgs.msg import VescState, VescStateStamped

from mushr_ros_intro.car.model import Car, Event, InitialPose, State
from mushr_ros_intro.car.odometry import Odometry as Measured
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.parameters import Parameters, number
from mushr_ros_intro.ros import conversions, ros_time
from mushr_ros_intro.simulator.state_publisher import StatePublisher

REPOSITION = "/mushr_sim/reposition"
"""The name of the service and of the topic that place a car."""

_TIMEOUT = 5.0
"""How long the service waits until the car reports its pose [s of wall-clock time]."""

_VESC = (
    number("speed_to_erpm_gain", 4614.0, "", -1e6, 1e6),
    number("speed_to_erpm_offset", 0.0, "", -1e6, 1e6),
    number("steering_angle_to_servo_gain", -1.2135, "", -10.0, 10.0),
    number("steering_angle_to_servo_offset", 0.5304, "", -10.0, 10.0),
)

Accept = Callable[[Event, str], Optional[int]]
"""Adds an event from a topic or service. Returns its stamp [ns], None if it was rejected."""


class MushrInterface:
    """The interface of MuSHR's simulator to one car.

    Publishes ``/mushr_sim/CAR/odom``, with the true pose in the map, and in the car's namespace
    ``vesc/odom``, ``vesc/sensors/core`` and ``vesc/sensors/servo_position_command``. Subscribes to
    /mushr_sim/reposition and to ``clicked_point``, which place the car, and offers the service
    /mushr_sim/reposition.
    """

    def __init__(self, car: Car, prefix: str, accept: Accept, publisher: StatePublisher) -> None:
        """Set up the topics and the service.

        Args:
            car: the car.
            prefix: of the car's frames.
            accept: adds an initial pose.
            publisher: of the states.
        """
        self._car, self._accept = car, accept
        self._name = rospy.get_namespace().strip("/")
        self._frames = f"{prefix}odom", f"{prefix}base_link"
        values = Parameters(rospy.get_param("vesc", {}), "vesc/").read(_VESC)
        self._erpm_gain, self._erpm_offset, self._servo_gain, self._servo_offset = values.values()
        rospy.set_param("vesc/chassis_length", car.wheelbase)
        rospy.set_param("vesc/wheelbase", car.track)  # MuSHR gives this name to the width
        self._reported = threading.Condition()
        self._stamp = 0  # of the newest published state [ns]
        publisher.add(f"/mushr_sim/{self._name}/odom", Odometry, self._true_odometry)
        publisher.add("vesc/odom", Odometry, self._vesc_odometry)
        publisher.add("vesc/sensors/core", VescStateStamped, self._motor_state)
        publisher.add("vesc/sensors/servo_position_command", Float64, self._servo_position)
        for topic, kind, read in (
            (REPOSITION, PoseStamped, conversions.initial_pose_from_msg),
            ("clicked_point", PointStamped, _initial_pose_from_point),
        ):
            rospy.Subscriber(topic, kind, self._on_message, read, tcp_nodelay=True)
        rospy.Service(REPOSITION, CarPose, self._on_request)

    def on_reported(self, stamp: int) -> None:
        """Answer the service: the state at `stamp` [ns] has been reported."""
        with self._reported:
            self._stamp = stamp
            self._reported.notify_all()

    def _true_odometry(self, state: State, _: Measured) -> Odometry:
        """Return the true pose, which is in the map, in MuSHR's form."""
        exact = Measured(state, state.yaw_rate(self._car))
        msg = conversions.odometry_to_msg(exact, *self._frames)
        msg.pose.pose = conversions.pose_to_msg(state.pose)
        return msg

    def _vesc_odometry(self, _: State, measured: Measured) -> Odometry:
        """Return the odometry of MuSHR's vesc_to_odom, from the speed and the steering angle."""
        return conversions.odometry_to_msg(measured, *self._frames)

    def _motor_state(self, state: State, measured: Measured) -> VescStateStamped:
        """Return the state of the motor controller: the electrical speed of the motor."""
        speed = self._erpm_gain * measured.state.speed + self._erpm_offset
        header = Header(stamp=ros_time.time_from(state.stamp))
        return VescStateStamped(header, VescState(speed=speed))

    def _servo_position(self, _: State, measured: Measured) -> Float64:
        """Return the position of the steering servo."""
        return Float64(self._servo_gain * measured.state.steering_angle + self._servo_offset)

    @conversions.ignore_bad_messages
    def _on_message(self, msg: rospy.Message, read: Callable[[rospy.Message], Event]) -> None:
        """Place the car."""
        self._accept(read(msg), msg._connection_header["topic"])

    def _on_request(self, request: CarPoseRequest) -> bool:
        """Place the car; return whether it reports its new pose."""
        try:
            if request.car_name != self._name:
                raise conversions.MessageError(
                    f"there is no car '{request.car_name}'; expected '{self._name}'"
                )
            pose = conversions.pose_to_msg(Pose(request.x, request.y, request.theta))
            event = conversions.initial_pose_from_msg(PoseStamped(pose=pose))
        except conversions.MessageError as error:
            rospy.logwarn("%s: %s", REPOSITION, error)
            return False
        stamp = self._accept(event, REPOSITION)
        if stamp is None:
            return False
        with self._reported:
            is_there = self._reported.wait_for(lambda: self._stamp >= stamp, _TIMEOUT)
        if not is_there:
            rospy.logwarn(
                "%s: the car did not report its pose within %g s; is the clock held?",
                *(REPOSITION, _TIMEOUT),
            )
        return is_there


def _initial_pose_from_point(msg: PointStamped) -> InitialPose:
    """Return an initial pose at a point, with the heading 0."""
    x, y = conversions.point_from_msg(msg)
    return InitialPose(msg.header.stamp.to_nsec(), Pose(x, y, 0.0))
