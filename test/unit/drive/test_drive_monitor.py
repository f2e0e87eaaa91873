"""Test what path_publisher prints when its drive is interrupted."""

import threading
from types import SimpleNamespace

import pytest
import rospy

from mushr_ros_intro.drive import drive_monitor
from mushr_ros_intro.drive.car_pose import CarPose
from mushr_ros_intro.drive.drive_monitor import DriveMonitor
from mushr_ros_intro.geometry import Pose

POSE = Pose(1.0, -2.0, 0.5)


@pytest.mark.parametrize(
    ("looks", "last", "printed"),
    [
        (3, POSE, f"stopped in line 2 of 3 at {POSE}"),
        (None, POSE, f"the drive ended in line 2 of 3; the last reported pose is {POSE}"),
        (None, None, "the drive ended in line 2 of 3"),
    ],
)
def test_where_the_car_stops(monkeypatch, looks, last, printed):
    """The node waits until the car stands; without that, it does not say that the car stopped."""
    seen, lines = [], []

    def stands():
        seen.append(None)
        return len(seen) == looks

    monkeypatch.setattr(drive_monitor, "HALT_TIMEOUT", 60.0 if looks else 0.0)
    monkeypatch.setattr(rospy, "logwarn", lambda text, *values: lines.append(text % values))
    monitor = DriveMonitor.__new__(DriveMonitor)
    monitor._is_done = False
    monitor._timetable = SimpleNamespace(start=1, stop_position=lambda: "line 2 of 3")
    monitor._car_pose = SimpleNamespace(
        stands=stands, last=SimpleNamespace(pose=last) if last else None
    )
    monitor._log_stop()
    monitor._log_stop()  # the drive has ended
    assert lines == [printed]


@pytest.mark.parametrize(
    ("poses", "expected"),
    [
        ([], False),
        ([1.0], False),
        ([1.0, 1.1], False),
        ([1.0, 1.0], True),
        ([1.0, 1.0, 1.1], False),
    ],
)
def test_when_the_car_stands(poses, expected):
    """Its newest two reports have the same pose."""
    car = CarPose.__new__(CarPose)
    car._lock = threading.Lock()
    car._reports = [SimpleNamespace(pose=POSE._replace(x=x)) for x in poses]
    assert car.stands() is expected
