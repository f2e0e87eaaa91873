"""Computed recordings of replays, for tests that need no drive."""

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.preview.prediction import states_at
from mushr_ros_intro.replay.judge import judge
from mushr_ros_intro.replay.recording import Recorded, Sent
from mushr_ros_intro.replay.tolerances import default_tolerances
from mushr_ros_intro.world.grid import Grid
from support import cars
from support.geometry import float32

SECOND = 1_000_000_000
TENTH = SECOND // 10
BEGIN = 100 * SECOND
"""The stamp of the first command [ns]."""

ROWS = [(2.0, 0.1, 1.0), (1.0, -0.1, 0.5), (1.0, -0.1, 0.25)]
START = (1.0, 2.0, 0.5)


def plan_of(start, rows):
    """Return a plan of rows of (speed, steering angle, seconds)."""
    lines = [start, *rows]
    return cars.plan_of("\n".join(", ".join(map(str, line)) for line in lines))


PLAN = plan_of(START, ROWS)


def commands(rows=ROWS):
    """Return the commands for rows of (speed, steering angle, seconds) at 10 Hz."""
    sent, begin = [], BEGIN
    for speed, angle, seconds in rows:
        end = begin + round(seconds * SECOND)
        values = float32(speed), float32(angle)
        sent += [Sent(t, True, *values, t, t) for t in range(begin, end, TENTH)]
        begin = end
    return sent


STOP = (0.0, 0.0, 0.1)
COMMANDS = commands([*ROWS, STOP])


def map_of(width, height, origin):
    """Return a map without walls [m]."""
    return Grid(np.zeros((height, width), np.int8), 1.0, origin)


def replay(plan=PLAN, sent=COMMANDS, **changes):
    """Return a replay without faults, with `changes` of its fields."""
    instants = list(range(-TENTH, plan.duration + SECOND // 2, SECOND // 50))
    right = Recorded(
        plan=plan,
        car=Car(),
        outcome="",
        start=Pose(*plan.start),
        sent=tuple(sent),
        stamps=np.array(instants) + BEGIN,
        poses=np.array([state.pose for state in states_at(plan, Car(), instants)]),
        collisions=(),
        grid=map_of(20, 20, Pose(-5.0, -5.0, 0.0)),
    )
    return right._replace(**changes)


def reported(seen):
    """Return the report on a replay."""
    return judge(seen, default_tolerances(seen.plan, seen.car))


def judged(seen):
    """Return the messages of the failed checks of a replay, and the verdict."""
    report = reported(seen)
    return {each.name: each.message for each in report.checks if not each.passed}, report.verdict
