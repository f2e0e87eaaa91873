"""Poses, headings, and the closed form of a drive."""

import cmath
import math
import struct

POSITION_TOLERANCE = 1e-6
"""[m] The promise of the package. Rounding errors add up to about 1e-12 only."""
ANGLE_TOLERANCE = 1e-6
"""[rad] As above."""


def float32(value):
    """Return `value` as an AckermannDrive holds it."""
    return struct.unpack("f", struct.pack("f", value))[0]


def closed_form(start, rows, wheelbase=0.33):
    """Return the pose (x, y, theta) at the end of `rows` of (speed, steering angle, seconds).

    This uses complex numbers and the turning centre, so it is independent of the car's code.
    """
    position, heading = complex(start[0], start[1]), start[2]
    for speed, steering_angle, duration in rows:
        speed, steering_angle = float32(speed), float32(steering_angle)
        yaw_rate = speed * math.tan(steering_angle) / wheelbase
        if yaw_rate == 0.0:
            position += speed * duration * cmath.exp(1j * heading)
        else:
            turned = heading + yaw_rate * duration
            centre = position + 1j * speed / yaw_rate * cmath.exp(1j * heading)
            position = centre - 1j * speed / yaw_rate * cmath.exp(1j * turned)
            heading = turned
    return position.real, position.imag, heading


def yaw_of(quaternion):
    """Return the yaw [rad] of a rotation about the z axis."""
    return 2.0 * math.atan2(quaternion.z, quaternion.w)


def planar(pose):
    """Return the (x, y, theta) of a geometry_msgs/Pose on the ground."""
    return pose.position.x, pose.position.y, yaw_of(pose.orientation)


def angle_between(one, other):
    """Return the size of the angle [rad] between two headings."""
    return abs(math.remainder(one - other, math.tau))
