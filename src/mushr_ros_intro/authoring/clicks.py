"""Extend a plan to a clicked point, by the command that drives the circular arc to it.

Exactly one circle touches the car's heading at its rear axle and passes through the point. The car
drives along it forward, or in reverse if the point is behind, so it turns by at most half a circle.
"""

import math
from typing import Tuple

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.plan.plan import Plan, Row, as_float32
from mushr_ros_intro.preview.prediction import rest
from mushr_ros_intro.stamps import from_seconds

_EPSILON = 1e-9
"""Tolerances: a point at a smaller distance is where the car is [m]. A point at a smaller angle
behind the line of the axle is beside the car, which then drives forward [rad]."""

_SAME_POINT = 0.001
"""A click nearer to the end of the plan is the last one again, as in a double click [m]."""


def arc_to(pose: Pose, point: Tuple[float, float]) -> Tuple[float, float]:
    """Return the arc from `pose` to `point` (x [m], y [m]), both in the same frame.

    It begins along the heading. The result is its length [m], negative in reverse, and its
    curvature [1/m], left positive.

    Its chord has the direction theta + h and the length s sin(h) / h, where h is half the angle
    turned and s the length of the arc: the inverse of `drive_arc`.
    """
    dx, dy = point[0] - pose.x, point[1] - pose.y
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
    chord = math.hypot(ahead, left)
    if chord < _EPSILON:
        return 0.0, 0.0
    direction = -1.0 if ahead < -_EPSILON * chord else 1.0
    half_turn = math.atan2(direction * left, direction * ahead)
    distance = direction * chord * (half_turn / math.sin(half_turn) if half_turn else 1.0)
    return distance, 2.0 * half_turn / distance


def extend(plan: Plan, point: Tuple[float, float], speed: float, car: Car) -> Plan:
    """Return a plan with one more row, which ends at a point (x [m], y [m]) in the map frame.

    The row has the speed `speed` [m/s], forward or in reverse.

    Raises:
        UserError: the point is where the car is, or needs too much steering.
    """
    shown = f"({point[0]:.3f}, {point[1]:.3f})"
    distance, curvature = arc_to(rest(plan, car)[1], point)
    if abs(distance) < _SAME_POINT:
        raise UserError(f"the plan already ends at the point {shown}; expected another point")
    speed = as_float32(speed)
    duration = from_seconds(abs(distance) / car.response(speed, 0.0)[0])
    angle = car.command_for(math.atan(curvature * car.wheelbase))
    nearest = car.within_limits(0.0, angle)[1]
    if nearest != angle:
        raise UserError(
            f"the point {shown} needs a steering angle of {angle:.4f} rad; click_planner uses at "
            f"most {abs(nearest):.4f} rad to the {'left' if angle > 0.0 else 'right'}"
        )
    row = Row(math.copysign(speed, distance), as_float32(angle), duration)
    return plan._replace(rows=(*plan.rows, row))
