"""Find the circular arc that takes a car to a clicked point, and the command that drives it.

There is one circle that touches the car's heading at its rear axle and goes through the point.
The car drives along it forward, or in reverse if the point is behind, so it never turns by more
than half a circle.
"""

import math
from typing import Iterator, NamedTuple, Sequence, Tuple

from mushr_ros_intro.car.bicycle import Pose, curvature, drive_arc
from mushr_ros_intro.car.model import Car, State, at_rest
from mushr_ros_intro.plan.model import Row, as_float32
from mushr_ros_intro.sim.stamps import NANOSECONDS, from_seconds

MAX_DISTANCE = 1000.0
"""A point further from the car is refused [m]: float32 commands miss it by up to 1e-7 of that."""

_HERE = 1e-9
"""A point within this of the car [m] is where it stands; within this angle [rad], beside it."""


class ClickError(ValueError):
    """A point that the car cannot drive to; says why."""


class Arc(NamedTuple):
    """A circular arc that leaves a pose along its heading."""

    distance: float
    """Its length [m], negative in reverse."""
    curvature: float
    """Its curvature [1/m], left positive."""


def arc_to(pose: Pose, point: Tuple[float, float]) -> Arc:
    """Return the arc from `pose` to `point` [m, m], both in the same frame.

    Its chord has the direction theta + h, where h is half the angle turned, and the length
    s sin(h) / h.
    """
    dx, dy = point[0] - pose.x, point[1] - pose.y
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
    chord = math.hypot(ahead, left)
    if chord < _HERE:
        return Arc(0.0, 0.0)
    direction = -1.0 if ahead < -_HERE * chord else 1.0
    half_turn = math.atan2(direction * left, direction * ahead)
    distance = direction * chord * (half_turn / math.sin(half_turn) if half_turn else 1.0)
    return Arc(distance, 2.0 * half_turn / distance)


def row_to(pose: Pose, point: Tuple[float, float], speed: float, car: Car) -> Row:
    """Return the command that takes a car from a pose to a point, at a speed.

    Args:
        pose: of the car, in the map frame.
        point: x [m], y [m] in the map frame.
        speed: forward or in reverse [m/s], positive.
        car: its wheelbase and steering limits count.

    Raises:
        ClickError: the car cannot steer so far, or the point is where it stands, or far away.
    """
    shown = f"({point[0]:.3f}, {point[1]:.3f})"
    away = math.hypot(point[0] - pose.x, point[1] - pose.y)
    if away > MAX_DISTANCE:
        raise ClickError(
            f"the point {shown} is {away:.0f} m away from where the car will be; "
            f"expected {MAX_DISTANCE:g} m at most"
        )
    arc = arc_to(pose, point)
    speed = as_float32(speed)
    duration = from_seconds(abs(arc.distance) / speed)
    if duration == 0:
        raise ClickError(f"the point {shown} is where the car will be already")
    angle = math.atan(arc.curvature * car.wheelbase)
    nearest = car.within_limits(0.0, angle)[1]
    if nearest != angle:
        side = "left" if angle > 0.0 else "right"
        raise ClickError(
            f"the point {shown} needs a steering angle of {angle:.4f} rad (a circle of radius "
            f"{1.0 / abs(arc.curvature):.3f} m); the nearest that the car has is {nearest:.4f} rad "
            f"to the {side} (a radius of {_radius(nearest, car)} m)"
        )
    return Row(math.copysign(speed, arc.distance), as_float32(angle), duration, 0)


def pose_after(pose: Pose, row: Row, car: Car) -> Pose:
    """Return where a row's command, rounded to float32 as it travels, takes an ideal car."""
    distance = as_float32(row.speed) * row.duration / NANOSECONDS
    return drive_arc(pose, distance, curvature(as_float32(row.steering_angle), car.wheelbase))


def path(start: Pose, rows: Sequence[Row], car: Car, period: int) -> Iterator[State]:
    """Yield states along the rows, at least one every `period` [ns], and one where each row ends.

    Their stamps count from the start [ns].
    """
    stamp, pose = 0, start
    yield at_rest(stamp, pose)
    for row in rows:
        parts = -(-row.duration // period)
        for part in range(1, parts + 1):
            passed = row.duration * part // parts
            yield at_rest(stamp + passed, pose_after(pose, row._replace(duration=passed), car))
        stamp += row.duration
        pose = pose_after(pose, row, car)


def _radius(steering_angle: float, car: Car) -> str:
    """Return the radius of the circle that a steering angle drives, as text [m]."""
    bend = abs(curvature(steering_angle, car.wheelbase))
    return f"{1.0 / bend:.3f}" if bend else "infinite"
