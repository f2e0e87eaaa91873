"""The simulated car at walls: where it stops, and how it drives away."""

import math
import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Car, Command, at_rest, halted
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.geometry import Pose, drive_arc
from mushr_ros_intro.world.footprint import Footprint, World, is_free
from mushr_ros_intro.world.grid import Grid
from mushr_ros_intro.world.map_file import read_map
from support.cars import BEGIN, MS, SECOND, at, history_of
from support.paths import PACKAGE

NARROWED = 3e-9
"""[m] The free distance is known to 1e-9 m, contact begins 1e-9 m inside a wall; plus rounding."""

CAR = Car()
BODY = Footprint()
SANDBOX = World(read_map(os.path.join(PACKAGE, "maps", "sandbox.yaml")))
WALL = 49.4
"""[m] The distance of the sandbox's four walls from the origin."""


def history(pose, *events, world=SANDBOX):
    return history_of(CAR, at_rest(BEGIN, pose), *events, world=world)


def held(speed, steering_angle, first, last):
    """Return the same command every 100 ms, from `first` to before `last` [ms]."""
    return [(offset, speed, steering_angle) for offset in range(first, last, 100)]


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, -math.pi / 2])
@pytest.mark.parametrize("speed", [2.0, -2.0, 0.3, 40.0])
def test_straight_into_a_wall(heading, speed):
    """The car stops when its body touches the wall; the contact has the stamp of that instant."""
    reach = BODY.front if speed > 0 else BODY.back
    ahead = heading if speed > 0 else heading + math.pi
    distance = 0.2
    start = [(WALL - reach - distance) * round(c) for c in (math.cos(ahead), math.sin(ahead))]
    made = history(Pose(*start, heading), *held(speed, 0.0, 0, 1000))
    arrival = 1000 * distance / abs(speed)
    driven = at(made, arrival - 1)
    assert driven.speed == speed and driven.collision is None
    for offset in (arrival + 1, 950, 2500, 10**6):
        state = at(made, offset)
        assert state.speed == state.yaw_rate(CAR) == 0.0
        assert math.dist(state.pose[:2], start) == pytest.approx(distance, abs=NARROWED)
        assert state.pose.theta == heading
        assert state.collision.pose == state.pose
        assert state.collision.stamp == pytest.approx(BEGIN + arrival * MS, abs=NARROWED * SECOND)


def test_a_contact_lasts_until_the_car_drives_away_or_has_a_new_pose():
    made = history(Pose(48.9, 3.0, 0.0), *held(2.0, 0.1, 0, 800), (800, 0.0, 0.0), (900, -1.0, 0.0))
    contacts = {at(made, offset).collision for offset in range(0, 901, 7)}
    assert len(contacts - {None}) == 1
    hit = at(made, 890).collision
    assert hit is not None and at(made, 900).collision is None
    away = at(made, 5000)
    assert away.collision is None
    assert away.pose == pytest.approx(drive_arc(hit.pose, -0.2, 0.0), abs=1e-12)
    placed = history(Pose(48.9, 3.0, 0.0), *held(2.0, 0.0, 0, 400), (400, Pose(0.0, 0.0, 0.0)))
    assert at(placed, 399).collision and not at(placed, 400).collision


def test_from_one_wall_back_into_another():
    """The lane is free from 0.4 to 1.04 m."""
    cells = np.full((40, 40), 100, np.int8)
    cells[10:30, 10:26] = 0
    lane = World(Grid(cells, 0.04))
    start = Pose(0.4 + BODY.back + 0.1, 0.8, 0.0)
    made = history(start, *held(1.0, 0.0, 0, 500), *held(-1.0, 0.0, 500, 1500), world=lane)
    assert at(made, 400).pose.x == pytest.approx(1.04 - BODY.front, abs=NARROWED)
    assert at(made, 1600).pose.x == pytest.approx(0.4 + BODY.back, abs=NARROWED)
    assert at(made, 400).collision != at(made, 1600).collision


def test_the_car_can_drive_off_the_map_and_in_a_wall():
    beyond = history(Pose(60.0, -70.0, 0.0), *held(2.0, 0.0, 0, 1000))
    assert at(beyond, 5000).pose == pytest.approx((62.2, -70.0, 0.0), abs=1e-12)
    far = history(Pose(1e6, -1e6, 1.0), *held(1000.0, 1.5, 0, 1000))
    assert at(far, 5000).collision is None
    inside = Pose(WALL - BODY.front + 0.05, 0.0, 0.0)
    for speed, distance in ((1.0, 0.6), (-1.0, -0.6)):
        state = at(history(inside, *held(speed, 0.0, 0, 500)), 1000)
        assert state.pose == pytest.approx((inside.x + distance, 0.0, 0.0), abs=1e-12)
        assert state.collision is None


@pytest.mark.parametrize("events", [held(2.0, 0.1, 0, 900), [(0, 6.0, 0.1)]])
def test_a_late_map_applies_to_the_last_second(events):
    made = history(Pose(48.5, 3.0, 0.0), *events, world=None)
    assert at(made, 1000).pose.x > WALL
    made.set_walls(SANDBOX, BEGIN + 1000 * MS)
    assert at(made, 1000) == at(history(Pose(48.5, 3.0, 0.0), *events), 1000)


def test_a_halted_car_keeps_its_pose():
    state = at(history(Pose(1.0, 2.0, 0.5), *held(2.0, 0.1, 0, 300)), 250)
    before = halted(state, state.stamp - 10 * SECOND)
    assert (before.pose, before.speed) == (state.pose, 0.0)
    assert advance(before, before.stamp + SECOND, CAR).pose == state.pose


POLES = np.where(np.random.default_rng(1).random((60, 60)) < 0.02, 100, 0).astype(np.int8)
POLES[20:40, 20:40] = 0
CLUTTER = World(Grid(POLES, 0.1, Pose(-3.0, -3.0, 0.0)))
"""Random poles, none within 1 m of the origin."""

offsets = st.integers(0, 30).map(lambda tick: tick * 50)
commands = st.dictionaries(
    offsets, st.tuples(st.floats(-4, 4), st.floats(-0.5, 0.5)), min_size=5, max_size=25
)


@settings(max_examples=8)
@given(commands, st.randoms(), st.integers(3, 90))
def test_late_repeated_and_shuffled_commands_and_queries_change_nothing(commands, dice, interval):
    """The states equal those of commands that arrive in order, to the last bit."""
    in_order = [(offset, *commands[offset]) for offset in sorted(commands)]
    shuffled = in_order * 2
    dice.shuffle(shuffled)
    start = Pose(0.0, 0.0, 0.0)
    one = history(start, *in_order, world=CLUTTER)
    other, third = (History(CAR, at_rest(BEGIN, start), CLUTTER) for _ in range(2))
    for offset, *values in shuffled:
        other.add(Command(BEGIN + offset * MS, *values), BEGIN)
    for offset, *values in in_order:
        third.add(Command(BEGIN + offset * MS, *values), BEGIN)
        for query in range(0, 300, interval):
            at(third, offset + query)
    for offset in range(1000, 2000, 13):
        state = at(one, offset)
        assert state == at(other, offset) == at(third, offset)
        assert is_free(*CLUTTER, state.pose)
        assert state.collision is None or state.collision.pose == state.pose


def test_contacts_happen_in_the_clutter():
    """Otherwise the test above would show nothing."""
    hits = 0
    for seed in range(10):
        dice = np.random.default_rng(seed)
        state = at_rest(BEGIN, Pose(0.0, 0.0, dice.uniform(-3, 3)))
        for _ in range(30):
            command = Command(state.stamp, 3.0, dice.uniform(-0.5, 0.5))
            state = advance(apply(state, command, CAR, CLUTTER), state.stamp + 100 * MS, CAR)
        hits += state.collision is not None
    assert hits > 5
