"""How far a replay may deviate from the plan."""

from typing import NamedTuple, Optional, Tuple

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.geometry import Pose, curvature
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.replay.recording import START_TOLERANCE
from mushr_ros_intro.stamps import NANOSECONDS


class Tolerances(NamedTuple):
    """How far a replay may deviate from the plan."""

    position: float
    """Of the start pose and the final pose [m]."""
    angle: float
    """Of the start pose and the final pose [rad]."""
    path: float
    """Largest distance between the driven and the predicted path [m]."""


def compare(pose: Pose, wanted: Pose, position: float, angle: Optional[float]) -> Tuple[bool, str]:
    """Return whether a pose is the wanted one, and a description of their difference.

    The tolerances are `position` [m] and `angle` [rad], or None if any heading is right.
    """
    distance, turn = pose.distance_to(wanted), pose.angle_to(wanted)
    far, far_limit = unequal(distance, position)
    if angle is None:
        place = f"({wanted.x:.4f} m, {wanted.y:.4f} m)"
        difference = f"{pose}, {far} m from the expected {place}; tolerance {far_limit} m"
        return distance <= position, difference
    turned, turn_limit = unequal(turn, angle)
    difference = (
        f"{pose}, {far} m and {turned} rad from the expected {wanted}; "
        f"tolerances {far_limit} m and {turn_limit} rad"
    )
    return distance <= position and turn <= angle, difference


def unequal(value: float, limit: float) -> Tuple[str, str]:
    """Return two numbers as texts, which differ if the value exceeds the limit.

    A value below 1e-9, such as 4.4e-15 m, is a rounding error, and shown as 0.
    """
    texts = (f"{round(value, 9):.3g}", f"{limit:.3g}")
    return texts if value <= limit or texts[0] != texts[1] else (f"{value:.9g}", f"{limit:.9g}")


def default_tolerances(plan: Plan, car: Car) -> Tolerances:
    """Return how far the plan drives and turns the car within its command timeout.

    This is the motion of the car if the node sends no stop at the end. START_TOLERANCE is added.
    """
    seconds = car.command_timeout / NANOSECONDS
    distance = START_TOLERANCE + seconds * max(abs(row.speed) for row in plan.rows)
    rates = [abs(row.speed * curvature(row.steering_angle, car.wheelbase)) for row in plan.rows]
    return Tolerances(distance, START_TOLERANCE + seconds * max(rates), distance)
