"""The drive in recorded messages, and what is refused."""

import random

import numpy as np
import pytest

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.comparison.drive_log import drive_log, start_pose
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds
from support.cars import plan_of
from support.recorded_drive import received

CAR = Car()
PLAN = plan_of("1, 2, 0.5\n0.5, 0.1, 2\n0.5, -0.1, 2")

NEAR = 1e-9
"""[m, rad] Poses without noise differ by rounding errors only."""


def messages(plan=PLAN, **options):
    """Return the commands and the poses of a drive without errors."""
    exact = {"position": 0.0, "heading": 0.0, "delay": 0.0, **options}
    return received(plan, CAR, random.Random(1), **exact)


def log_of(commands, poses):
    return drive_log("a.bag", commands, poses, CAR.command_timeout)


def test_commands_become_rows_and_times_count_from_the_first_one():
    log = log_of(*messages())
    assert [row[:3] for row in log.plan.rows] == [row[:3] for row in PLAN.rows]
    assert log.stamps[0] == -2 * NANOSECONDS
    assert start_pose(log, 0) == pytest.approx(PLAN.start, abs=NEAR)
    assert not log.notes


def test_poses_until_the_first_command_takes_effect_give_the_start_pose():
    start = start_pose(log_of(*messages(delay=1.5)), from_seconds(1.5))
    assert start == pytest.approx(PLAN.start, abs=NEAR)


@pytest.mark.parametrize("shift", [-3600.5, 12.0])
def test_stamps_of_another_clock_are_corrected(shift):
    commands, poses = messages()
    stamps = [stamp + from_seconds(shift) for stamp in poses.stamps]
    log = log_of(commands, poses._replace(stamps=stamps))
    assert np.array_equal(log.stamps, log_of(commands, poses).stamps)
    (note,) = log.notes
    assert f"{shift:+.3f} s from the clock" in note


def test_messages_without_stamps_count_when_they_arrive():
    commands, poses = messages()
    zeros = [0] * len(poses.stamps)
    log = log_of(commands, poses._replace(stamps=zeros))
    assert np.array_equal(log.stamps, log_of(commands, poses).stamps)


@pytest.mark.parametrize("before", [Pose(9.0, 9.0, 0.0), Pose(1.3, 2.0, 0.5)])
def test_a_car_that_is_placed_before_the_drive(before):
    commands, poses = messages()
    count = 17  # until 0.3 s before the first command
    values = [before] * count + poses.values[count:]
    log = log_of(commands, poses._replace(values=values))
    assert start_pose(log, 0) == pytest.approx(PLAN.start, abs=NEAR)


def part(messages, count):
    """Return the first messages only."""
    return messages._replace(
        arrivals=messages.arrivals[:count],
        stamps=messages.stamps[:count],
        values=messages.values[:count],
    )


def test_what_is_refused():
    commands, poses = messages()
    still = commands._replace(values=[(0.0, 0.1)] * len(commands.values))
    still_there = [poses.values[0]] * len(poses.values)
    for wrong, expected in [
        ((part(commands, 0), poses), "/commands has 0 commands, and none of them moves the car"),
        ((still, poses), "41 commands, and none of them moves the car"),
        ((commands, part(poses, 0)), "/pose has 0 poses after the first command"),
        ((commands, part(poses, 30)), "/pose has 9 poses after the first command"),
        ((commands, poses._replace(values=still_there)), "stay within 0.000 m, .* for 2.00 m"),
    ]:
        with pytest.raises(UserError, match=f"^a.bag: .*{expected}.*; expected"):
            log_of(*wrong)


def test_poses_that_stop_during_the_drive():
    commands, poses = messages(plan_of("0, 0, 0\n0.5, 0, 8"))
    keep = [index for index in range(len(poses.stamps)) if not 45 < index < 75]
    arrivals, stamps, values = (
        [each[index] for index in keep] for each in (poses.arrivals, poses.stamps, poses.values)
    )
    poses = poses._replace(arrivals=arrivals, stamps=stamps, values=values)
    with pytest.raises(UserError, match="no pose for 3.0 s from 2.5 s after the first command"):
        log_of(commands, poses)


def test_poses_that_begin_long_after_the_first_command():
    commands, poses = messages(plan_of("0, 0, 0\n0.5, 0.1, 9"))
    late = [i for i, stamp in enumerate(poses.stamps) if stamp > commands.stamps[0] + 3 * 10**9]
    columns = ([column[i] for i in late] for column in (poses.arrivals, poses.stamps, poses.values))
    with pytest.raises(UserError, match=r"no pose for 3.\d s from 0.0 s after the first command"):
        log_of(commands, poses.__class__(poses.topic, *columns))


def test_a_note_says_that_the_poses_end_before_the_commands():
    commands, poses = messages()
    (note,) = log_of(commands, part(poses, 51)).notes
    assert "the poses end 0.9 s before the commands" in note


def test_of_two_commands_with_one_stamp_the_later_one_applies():
    """As in the car: here a stop that ends the drive early."""
    commands, poses = messages()
    count = next(i for i, value in enumerate(commands.values) if value[1] < 0.0)
    values = [*commands.values[:count], (0.0, 0.0)]
    stamps = [*commands.stamps[:count], commands.stamps[count - 1]]
    log = log_of(commands._replace(values=values, stamps=stamps, arrivals=stamps), poses)
    assert sum(row.duration for row in log.plan.rows if row.speed) == from_seconds(1.9)
