"""Check what the car does with messages: what it refuses, when they apply, and its warnings."""

import numpy as np
import pytest

from mushr_ros_intro.car.model import Car, Command, InitialPose
from mushr_ros_intro.geometry import ORIGIN, Pose
from mushr_ros_intro.simulator.car_core import CarCore
from mushr_ros_intro.stamps import NANOSECONDS
from mushr_ros_intro.world.footprint import World
from mushr_ros_intro.world.grid import Grid

SECOND = NANOSECONDS
NOW = 1000 * SECOND
TOPIC = "/car/commands"

CAR = Car()

ROOM = World(
    Grid(np.pad(np.zeros((40, 40), np.int8), 1, constant_values=100), 0.1, Pose(-2.1, -2.1, 0.0))
)
"""A room of 4 m by 4 m around the origin."""


class Logged(CarCore):
    """A car whose warnings are kept."""

    def __init__(self, car=CAR, start=ORIGIN):
        self.warnings = []
        warn = lambda _, text: self.warnings.append(text)  # noqa: E731
        super().__init__(car, start, NOW - 2 * SECOND, warn, SECOND)

    def drive(self, stamp, speed=1.0, steering_angle=0.0):
        return self.add(Command(stamp, speed, steering_angle), TOPIC, NOW)

    def pose(self, seconds):
        """Return the pose some seconds after NOW."""
        (state,) = self.states([NOW + round(seconds * SECOND)], NOW)
        return state.pose


@pytest.mark.parametrize(
    ("speed", "angle", "expected"),
    [
        (1.0, 0.1, None),  # the limits themselves; 0.1 is another number as a float32
        (1.5, 0.1, "a command asks for 1.5 m/s and 0.1 rad; within its limits, the car drives 1 m"),
        (1.0, -0.5, "a command asks for 1 m/s and -0.5 rad; within its limits, the car drives 1 "),
    ],
)
def test_commands_beyond_the_limits(speed, angle, expected):
    car = Logged(Car(speed_limit=1.0, steering_limit_left=0.1, steering_limit_right=0.2))
    angle = float(np.float32(angle))
    assert car.drive(NOW, speed, angle) == Command(NOW, speed, angle)
    assert [text[: len(expected or text)] for text in car.warnings] == [expected] * bool(expected)


@pytest.mark.parametrize(
    ("stamp", "applies", "warning"),
    [
        (NOW, NOW, ""),
        (NOW + SECOND // 2, NOW + SECOND // 2, ""),
        (NOW - SECOND, NOW - SECOND, ""),
        (0, NOW, ""),  # the stamp was never filled in
        (NOW + 10 * SECOND, NOW, f"{TOPIC} differs by +10.0 s from the car's clock; expected at"),
        (NOW - 10 * SECOND, NOW, f"{TOPIC} differs by -10.0 s from the car's clock; expected at"),
    ],
)
def test_when_a_command_applies(stamp, applies, warning):
    car = Logged()
    applied = car.drive(stamp)
    assert (applied.stamp, applied.has_stamp) == (applies, applies == stamp)
    begin = (applies - NOW) / SECOND
    assert car.pose(begin + 0.3) == pytest.approx((0.2, 0.0, 0.0))
    assert len(car.warnings) == bool(warning) and warning in "".join(car.warnings)


def test_a_stop_with_an_old_stamp_causes_no_warning():
    """MuSHR's mux repeats one while no input drives."""
    car = Logged()
    car.drive(NOW - 30 * SECOND, 0.0)
    assert car.warnings == []


def test_a_start_pose_in_a_wall():
    """It is refused if the map is known."""
    car = Logged()
    placed = InitialPose(NOW, Pose(2.0, 1.0, 0.0))
    assert car.add(placed, "/initialpose", NOW) == placed
    car.set_walls(ROOM, NOW)
    assert car.warnings[0].startswith(f"the car is inside a wall at {placed.pose}; drive it out, ")
    assert car.add(InitialPose(NOW, ORIGIN), "/initialpose", NOW)
    assert car.add(placed, "/initialpose", NOW) is None
    assert len(car.warnings) == 2
    assert car.warnings[1].startswith(f"rejected the initial pose {placed.pose} on /initialpose: ")
    assert car.pose(0.1) == ORIGIN


def test_a_wall_stops_the_car_also_after_a_reset():
    car = Logged(start=Pose(1.0, 0.0, 0.0))
    car.set_walls(ROOM, NOW)
    for _ in range(2):
        for tenth in range(10):
            car.drive(NOW + tenth * SECOND // 10, 2.0)
        assert car.pose(1.0) == pytest.approx((2.0 - 0.38, 0.0, 0.0), abs=1e-8)
        car.reset(NOW)
        assert car.pose(1.0) == (1.0, 0.0, 0.0)


def test_another_map_does_not_move_a_car_that_stands():
    """Walls apply from then on; only late commands of the last second are driven again."""
    car = Logged(start=Pose(1.0, 0.0, 0.0))
    car.set_walls(ROOM, NOW)
    for tenth in range(10):
        car.drive(NOW + tenth * SECOND // 10, 2.0)
    before = car.pose(2.0)
    later = NOW + 3600 * SECOND
    car.set_walls(World(Grid(np.zeros((80, 80), np.int8), 0.1, Pose(-4.0, -4.0, 0.0))), later)
    assert car.states([later], later)[0].pose == before


def test_a_clock_that_is_set_back():
    """The car stops where it was, and forgets its commands."""
    car = Logged()
    car.drive(NOW)
    (before,) = car.states([NOW + SECOND // 10], NOW + SECOND // 10)
    for later in (1, 50):
        (state,) = car.states([NOW - SECOND + later * SECOND], NOW - SECOND)
        assert (state.pose, state.speed) == (before.pose, 0.0)
    assert [text[:22] for text in car.warnings] == ["the clock was set back"]
