"""Planar poses, and the arc that a bicycle drives.

A kinematic bicycle at the rear axle obeys x' = v cos(theta), y' = v sin(theta),
theta' = v tan(delta) / L. While v and delta are constant it drives a circular arc, and the pose
has a closed form (see e.g. Snider, "Automatic Steering Methods for Autonomous Automobile Path
Tracking", CMU-RI-TR-09-08, section 2.2, for the model).
"""

import math
from typing import NamedTuple

MAX_COORDINATE = 1e6
"""Poses beyond this are refused [m, rad]: they are mistakes, and would cost precision."""


class Pose(NamedTuple):
    """A pose in the plane: x [m], y [m], and the heading theta [rad], counter-clockwise."""

    x: float
    y: float
    theta: float

    def __str__(self) -> str:
        theta = math.remainder(self.theta, math.tau)
        x, y, theta = (round(value, 4) + 0.0 for value in (self.x, self.y, theta))  # no -0.0000
        return f"({x:.4f} m, {y:.4f} m, {theta:.4f} rad)"

    def distance_to(self, other: "Pose") -> float:
        """Return the distance to another pose [m]."""
        return math.hypot(self.x - other.x, self.y - other.y)

    def angle_to(self, other: "Pose") -> float:
        """Return the angle between two headings [rad], 0 to pi."""
        return abs(math.remainder(self.theta - other.theta, math.tau))

    def is_close_to(self, other: "Pose", tolerance: float) -> bool:
        """Return whether position and heading differ by at most `tolerance` [m, rad]."""
        return self.distance_to(other) <= tolerance and self.angle_to(other) <= tolerance


ORIGIN = Pose(0.0, 0.0, 0.0)


def compose(outer: Pose, inner: Pose) -> Pose:
    """Transform the pose `inner` from the frame `outer` to the frame in which `outer` is given."""
    cos, sin = math.cos(outer.theta), math.sin(outer.theta)
    return Pose(
        outer.x + cos * inner.x - sin * inner.y,
        outer.y + sin * inner.x + cos * inner.y,
        outer.theta + inner.theta,
    )


def inverse(pose: Pose) -> Pose:
    """Return the inverse transform: composed with `pose` it is the origin."""
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    return Pose(-cos * pose.x - sin * pose.y, sin * pose.x - cos * pose.y, -pose.theta)


def curvature(steering_angle: float, wheelbase: float) -> float:
    """Return the curvature [1/m] of the rear axle's path, tan(delta) / L, left positive.

    Args:
        steering_angle: angle of the virtual middle front wheel [rad], left positive.
        wheelbase: distance between the axles [m].
    """
    return math.tan(steering_angle) / wheelbase


def drive_arc(pose: Pose, distance: float, curvature: float) -> Pose:
    """Return the pose at the end of a circular arc, exactly.

    The chord of an arc of length s that turns by 2 h has the length s sin(h) / h and the direction
    theta + h. The straight line is the limit for h = 0.

    Args:
        pose: the pose at the beginning of the arc.
        distance: length of the arc [m], negative in reverse.
        curvature: curvature of the arc [1/m], left positive.
    """
    half_turn = 0.5 * distance * curvature
    chord = distance * (math.sin(half_turn) / half_turn if half_turn else 1.0)
    direction = pose.theta + half_turn
    return Pose(
        pose.x + chord * math.cos(direction),
        pose.y + chord * math.sin(direction),
        pose.theta + 2.0 * half_turn,
    )
