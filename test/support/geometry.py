"""Poses, headings, and the closed form of a drive."""

import cmath
import math
import struct

POSITION_TOLERANCE = 1e-6
"""[m] What the package promises; the sums of 1e-16 that are behind it reach about 1e-12."""
ANGLE_TOLERANCE = 1e-6
"""[rad] Likewise."""


def float32(value):
    """Return `value` as it travels in an AckermannDrive."""
    return struct.unpack("f", struct.pack("f", value))[0]


def closed_form(start, rows, wheelbase=0.33):
    """Return the pose (x, y, theta) at the end of `rows` of (speed, steering angle, seconds).

    Written in complex numbers, with the turning centre, and so not as the car does it.
    """
    position, heading = complex(start[0], start[1]), start[2]
    for speed, steering_angle, duration in rows:
        speed, steering_angle = float32(speed), float32(steering_angle)
        turn_rate = speed * math.tan(steering_angle) / wheelbase
        if turn_rate == 0.0:
            position += speed * duration * cmath.exp(1j * heading)
        else:
            turned = heading + turn_rate * duration
            centre = position + 1j * speed / turn_rate * cmath.exp(1j * heading)
            position = centre - 1j * speed / turn_rate * cmath.exp(1j * turned)
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
