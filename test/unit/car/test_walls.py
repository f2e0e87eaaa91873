"""The simulated car at walls: where it stops, how it comes away; asking changes nothing."""

import math
import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mushr_ros_intro.car.bicycle import Pose, drive_arc
from mushr_ros_intro.car.contact import World
from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Car, Command, Contact, InitialPose, at_rest, halted
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.world.footprint import Footprint, is_free
from mushr_ros_intro.world.grid import Grid, read_map
from support.paths import PACKAGE

MS = 1_000_000
SECOND = 1000 * MS
"""[ns]"""

NARROWED = 3e-9
"""[m] The way to a wall is narrowed down to 1e-9 m, and that much is no hit; then rounding."""

CAR = Car()
BODY = Footprint()
BEGIN = 1_700_000_000 * SECOND
SANDBOX = World(read_map(os.path.join(PACKAGE, "maps", "sandbox.yaml")))
WALL = 49.4
"""[m] Where the sandbox's free space ends, ahead, to the left, behind and to the right."""


def history(pose, *events, world=SANDBOX, ask=0):
    """Return a history with events of (ms after the beginning, speed, steering angle) or poses.

    The car is asked where it is every `ask` ms, between the events and beyond.
    """
    made = History(CAR, at_rest(BEGIN, pose), world)
    for offset, *what in events:
        stamp = BEGIN + offset * MS
        is_pose = isinstance(what[0], Pose)
        made.add(InitialPose(stamp, *what) if is_pose else Command(stamp, *what), stamp)
        for asked in range(0, 300 if ask else 0, ask or 1):
            made.state_at(stamp + asked * MS)
    return made


def at(made, offset):
    """Return the state some ms after the beginning."""
    return made.state_at(BEGIN + round(offset * MS))


def held(speed, steering_angle, first, last):
    """Return the same command every 100 ms."""
    return [(offset, speed, steering_angle) for offset in range(first, last, 100)]


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, -math.pi / 2])
@pytest.mark.parametrize("speed", [2.0, -2.0, 0.3, 40.0])
def test_straight_into_a_wall(heading, speed):
    """It stands where its bumper touches the wall, since the instant at which it got there."""
    reach = BODY.front if speed > 0 else BODY.back
    ahead = heading if speed > 0 else heading + math.pi
    way = 0.2
    start = [(WALL - reach - way) * round(c) for c in (math.cos(ahead), math.sin(ahead))]
    made = history(Pose(*start, heading), *held(speed, 0.0, 0, 1000))
    arrival = 1000 * way / abs(speed)
    driven = at(made, arrival - 1)
    assert driven.speed == speed and driven.collision is None
    for offset in (arrival + 1, 950, 2500, 10**6):
        state = at(made, offset)
        assert state.speed == state.turn_rate(CAR) == 0.0
        assert math.dist(state.pose[:2], start) == pytest.approx(way, abs=NARROWED)
        assert state.pose.theta == heading
        assert state.collision.pose == state.pose
        assert state.collision.stamp == pytest.approx(BEGIN + arrival * MS, abs=NARROWED * SECOND)
        assert state.wheel_angles.back_left == pytest.approx(
            math.copysign(way / CAR.wheel_radius, speed), abs=NARROWED / CAR.wheel_radius
        )


def test_the_contact_is_one_while_it_lasts_and_ends_with_driving_away():
    made = history(Pose(48.9, 3.0, 0.0), *held(2.0, 0.1, 0, 800), (800, 0.0, 0.0), (900, -1.0, 0.0))
    contacts = {at(made, offset).collision for offset in range(0, 901, 7)}
    assert len(contacts - {None}) == 1
    hit = at(made, 890).collision
    assert hit is not None and at(made, 900).collision is None
    away = at(made, 5000)
    assert away.collision is None
    assert away.pose == pytest.approx(drive_arc(hit.pose, -0.2, 0.0), abs=1e-12)


def test_leaning_on_a_wall_does_not_move_the_car():
    made = history(Pose(48.9, 3.0, 0.2), *held(2.0, 0.0, 0, 30_000))
    poses = {at(made, offset).pose for offset in range(29_500, 30_000, 50)}
    early = history(Pose(48.9, 3.0, 0.2), *held(2.0, 0.0, 0, 300))
    assert poses == {at(early, 300).pose}


def test_the_car_is_driven_against_the_wall_on_either_side():
    """From one wall back into the other, in a lane from 0.4 to 1.04 m."""
    cells = np.full((40, 40), 100, np.int8)
    cells[10:30, 10:26] = 0
    lane = World(Grid(cells, 0.04))
    start = Pose(0.4 + BODY.back + 0.1, 0.8, 0.0)
    made = history(start, *held(1.0, 0.0, 0, 500), *held(-1.0, 0.0, 500, 1500), world=lane)
    assert at(made, 400).pose.x == pytest.approx(1.04 - BODY.front, abs=NARROWED)
    assert at(made, 1600).pose.x == pytest.approx(0.4 + BODY.back, abs=NARROWED)
    assert at(made, 400).collision != at(made, 1600).collision


def test_without_a_world_there_are_no_walls_and_far_from_them_nothing_changes():
    events = held(3.0, 0.2, 0, 2000) + held(-2.0, -0.3, 2000, 4000)
    free, walled = history(Pose(1, 2, 3), *events, world=None), history(Pose(1, 2, 3), *events)
    for offset in range(2900, 5000, 37):
        one, other = at(free, offset), at(walled, offset)
        assert one == other and one.collision is None


def test_off_the_map_the_car_drives():
    beyond = history(Pose(60.0, -70.0, 0.0), *held(2.0, 0.0, 0, 1000))
    assert at(beyond, 5000).pose == pytest.approx((62.2, -70.0, 0.0), abs=1e-12)
    far = history(Pose(1e6, -1e6, 1.0), *held(1000.0, 1.5, 0, 1000))
    assert at(far, 5000).collision is None


def test_in_a_wall_the_car_can_only_get_out():
    inside = Pose(WALL - BODY.front + 0.05, 0.0, 0.0)
    deeper = at(history(inside, *held(1.0, 0.0, 0, 500)), 1000)
    assert deeper.pose == inside
    assert deeper.collision == Contact(BEGIN, inside)
    out = at(history(inside, *held(-1.0, 0.0, 0, 300)), 1000)
    assert out.pose == pytest.approx((inside.x - 0.4, 0.0, 0.0), abs=1e-12)
    assert out.collision is None


def test_a_placement_ends_the_contact():
    made = history(Pose(48.9, 3.0, 0.0), *held(2.0, 0.0, 0, 400), (400, Pose(0.0, 0.0, 0.0)))
    assert at(made, 399).collision and not at(made, 400).collision


def test_walls_that_come_late_stand_for_all_that_is_remembered():
    events = held(2.0, 0.1, 0, 900)
    made = history(Pose(48.5, 3.0, 0.0), *events, world=None)
    assert at(made, 1000).pose.x > WALL
    made.build(SANDBOX)
    assert at(made, 1000) == at(history(Pose(48.5, 3.0, 0.0), *events), 1000)


def test_a_halted_car_stands_where_it_is():
    state = at(history(Pose(1.0, 2.0, 0.5), *held(2.0, 0.1, 0, 300)), 250)
    before = halted(state, state.stamp - 10 * SECOND)
    assert (before.pose, before.speed) == (state.pose, 0.0)
    assert advance(before, before.stamp + SECOND, CAR).pose == state.pose


def cluttered(seed):
    """Return a map of poles, and none within 1 m of the origin."""
    dice = np.random.default_rng(seed)
    cells = np.where(dice.random((60, 60)) < 0.02, 100, 0).astype(np.int8)
    cells[20:40, 20:40] = 0
    return World(Grid(cells, 0.1, Pose(-3.0, -3.0, 0.0)))


CLUTTER = cluttered(1)
offsets = st.integers(0, 30).map(lambda tick: tick * 50)
commands = st.dictionaries(
    offsets, st.tuples(st.floats(-4, 4), st.floats(-0.5, 0.5)), min_size=5, max_size=25
)


@given(commands, st.randoms(use_true_random=False), st.integers(3, 90))
@settings(max_examples=60)
def test_late_double_and_shuffled_commands_and_questions_do_not_count(commands, dice, ask):
    """Where each command comes in its order, and where they come anyhow, the car is the same."""
    in_order = [(offset, *commands[offset]) for offset in sorted(commands)]
    shuffled = in_order * 2
    dice.shuffle(shuffled)
    start = Pose(0.0, 0.0, 0.0)
    one = history(start, *in_order, world=CLUTTER)
    other = History(CAR, at_rest(BEGIN, start), CLUTTER)
    for offset, *what in shuffled:
        other.add(Command(BEGIN + offset * MS, *what), BEGIN)
    third = history(start, *in_order, world=CLUTTER, ask=ask)
    for offset in range(1000, 2000, 13):
        state = at(one, offset)
        assert state == at(other, offset) == at(third, offset)
        assert is_free(*CLUTTER, state.pose)
        assert state.collision is None or state.collision.pose == state.pose


def test_contacts_happen_in_the_clutter():
    """Or the test above would show nothing."""
    hits = 0
    for seed in range(10):
        dice = np.random.default_rng(seed)
        state = at_rest(BEGIN, Pose(0.0, 0.0, dice.uniform(-3, 3)))
        for _ in range(30):
            command = Command(state.stamp, 3.0, dice.uniform(-0.5, 0.5))
            state = advance(apply(state, command, CAR, CLUTTER), state.stamp + 100 * MS, CAR)
        hits += state.collision is not None
    assert hits > 5
