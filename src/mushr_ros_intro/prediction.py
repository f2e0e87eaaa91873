"""Say where a plan takes the car, before it is driven."""

import struct
from typing import Iterator

from mushr_ros_intro.bicycle import Pose, curvature, drive_arc
from mushr_ros_intro.car import Car
from mushr_ros_intro.plan import Plan
from mushr_ros_intro.stamps import NANOSECONDS


def as_float32(value: float) -> float:
    """Round `value` to a float32, as every field of an AckermannDrive is when it travels."""
    return struct.unpack("<f", struct.pack("<f", value))[0]


def row_poses(plan: Plan, car: Car) -> Iterator[Pose]:
    """Yield the start pose of the plan, and the pose of the ideal car at the end of each row.

    One arc a row, in closed form, in the map frame; commands are rounded to float32, as the car
    gets them.
    """
    pose = Pose(*plan.start)
    yield pose
    for row in plan.rows:
        distance = as_float32(row.speed) * (row.duration / NANOSECONDS)
        bend = curvature(as_float32(row.steering_angle), car.wheelbase)
        pose = drive_arc(pose, distance, bend)
        yield pose


def final_pose(plan: Plan, car: Car) -> Pose:
    """Return the pose of the ideal car at the end of the plan, in the map frame."""
    pose = Pose(*plan.start)
    for pose in row_poses(plan, car):
        pass
    return pose


def length(plan: Plan) -> float:
    """Return how far the car drives [m], forward and in reverse."""
    return sum(abs(as_float32(row.speed)) * row.duration / NANOSECONDS for row in plan.rows)
