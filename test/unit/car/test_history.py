"""The simulated car: its state depends on the stamped events alone, in any order of arrival."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import (
    Car,
    Command,
    InitialPose,
    at_rest,
    front_wheel_angles,
    wheel_rates,
)
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.geometry import Pose, compose, inverse
from mushr_ros_intro.stamps import STAMP_TOLERANCE
from support.cars import BEGIN, MS, ROUNDING, SECOND, at, history_of

CAR = Car()
START = at_rest(BEGIN, Pose(1.0, 2.0, 0.5))

DIFFERENCE = 1e-5
"""[m/s, rad/s] Central differences over 1 ms are off by v w^2 (1 ms)^2 / 6, here under 1e-5."""


def driving(speed, steering_angle, car=CAR):
    """Return the state of a car right after a command."""
    return apply(START, Command(BEGIN, speed, steering_angle), car)


def history(*events, car=CAR):
    return history_of(car, START, *events)


def test_a_command_expires_after_its_timeout():
    made = history((0, 2.0, 0.0))
    for offset, distance in ((0, 0.0), (50, 0.1), (199.999999, 0.4), (200, 0.4), (5000, 0.4)):
        state = at(made, offset)
        assert state.speed == (2.0 if offset < 200 else 0.0)
        assert state.yaw_rate(CAR) == 0.0
        assert state.pose.distance_to(START.pose) == pytest.approx(distance, abs=1e-8)
    slow = driving(2.0, 0.0, Car(command_timeout=500 * MS))
    end = advance(slow, BEGIN + SECOND, CAR).pose
    assert end.distance_to(START.pose) == pytest.approx(1.0, abs=ROUNDING)


def test_the_timeout_counts_from_the_stamp_and_each_command_renews_it():
    late = History(CAR, START)
    late.add(Command(BEGIN, 2.0, 0.3), BEGIN + 900 * MS)
    assert at(late, 900).pose == at(history((0, 2.0, 0.3)), 900).pose
    for stamps, distance in (((0, 200, 300), 1.0), ((0, 300), 0.8)):
        end = at(history(*((stamp, 2.0, 0.0) for stamp in stamps)), 900).pose
        assert end.distance_to(START.pose) == pytest.approx(distance, abs=ROUNDING)


LIMITED = Car(acceleration=2.5, steering_rate=3.2)


@pytest.mark.parametrize("again", range(160, 650, 70))
def test_a_repeated_stop_changes_no_pose(again):
    """The poses stay the same to the last bit, so a late stop contradicts no published pose."""
    made = history((0, 0.93, 0.3), (150, 0.0, 0.0), car=LIMITED)
    before = [at(made, offset)._replace(command=None) for offset in range(150, 800, 7)]
    made.add(Command(BEGIN + again * MS, 0.0, 0.0), BEGIN)
    assert before == [at(made, offset)._replace(command=None) for offset in range(150, 800, 7)]


@pytest.mark.parametrize("late", [0, 3, 250])
def test_a_stop_after_the_last_command_has_expired_changes_no_pose(late):
    """So it does not matter when the mux's stop arrives. An earlier stop turns the wheels back."""
    events = (0, 0.93, 0.3), (150, 0.93, 0.3)
    alone = history(*events, car=LIMITED)
    before = [at(alone, offset)._replace(command=None) for offset in range(150, 900, 7)]
    for stop, is_same in ((350 + late, True), (349 - late // 2, False)):
        made = history(*events, (stop, 0.0, 0.0), car=LIMITED)
        after = [at(made, offset)._replace(command=None) for offset in range(150, 900, 7)]
        assert (before == after) == is_same
    steered = history(*events, (350 + late, 0.0, 0.1), car=LIMITED)
    assert at(steered, 5000).steering_angle == 0.1


@pytest.mark.parametrize(
    "stop", [(0.0, 0.1), (0.0, 0.0, 0.5), (0.0, 0.0, 0.0, 0.5), (1e-3, 0.0)], ids=str
)
def test_a_different_stop_applies(stop):
    """A stop applies if its steering angle or one of its rates differs from the last stop's."""
    plain = [(0, 0.93, 0.3), (150, 0.0, 0.0)]
    once, twice = [*plain, (200, *stop)], [*plain, (200, *stop), (350, *stop)]
    states = [at(history(*events, car=LIMITED), 430) for events in (plain, once, twice)]
    assert states[1][:6] != states[0][:6]
    if len(stop) == 3:  # it brakes gently, and longer if the stop is repeated
        assert states[2].speed > states[1].speed > 0.0


def test_an_initial_pose_stops_the_car_and_the_next_command_starts_there():
    there = Pose(-7.0, 3.0, 0.0)
    made = history((0, 2.0, 0.3), (100, there))
    for offset in (100, 150, 5000):
        state = at(made, offset)
        assert state.pose == there
        assert (state.speed, state.steering_angle, state.yaw_rate(CAR)) == (0.0, 0.0, 0.0)
    assert at(made, 99).pose != there
    made.add(Command(BEGIN + 150 * MS, 2.0, 0.0), BEGIN)
    assert at(made, 5000).pose == pytest.approx((-6.6, 3.0, 0.0), abs=ROUNDING)


def test_with_equal_stamps_an_initial_pose_comes_first_and_the_last_command_wins():
    there = Pose(0.0, 0.0, 0.0)
    for events in (
        [(0, there), (0, 9.0, 0.5), (0, 2.0, 0.0)],
        [(0, 9.0, 0.5), (0, there), (0, 2.0, 0.0)],
        [(0, 9.0, 0.5), (0, 2.0, 0.0), (0, there)],
    ):
        assert at(history(*events), 5000).pose == pytest.approx((0.4, 0.0, 0.0), abs=ROUNDING)


def test_a_stamped_command_replaces_earlier_commands_without_a_stamp():
    """Only those that arrived earlier, but would apply later."""
    zero = Command(BEGIN + 30 * MS, 0.0, 0.0, has_stamp=False)
    drive = Command(BEGIN + 20 * MS, 2.0, 0.0)
    for events, distance in (
        ((zero, drive), 0.4),
        ((drive, zero), 0.02),
        ((zero._replace(stamp=BEGIN + 10 * MS), drive), 0.4),
        ((zero._replace(has_stamp=True), drive), 0.02),
    ):
        made = History(CAR, at_rest(BEGIN, Pose(0.0, 0.0, 0.0)))
        for event in events:
            made.add(event, BEGIN + 40 * MS)
        assert at(made, 5000).pose == pytest.approx((distance, 0.0, 0.0), abs=ROUNDING)
    made = History(CAR, START)
    for event in (zero, InitialPose(BEGIN + 25 * MS, Pose(1.0, 0.0, 0.0)), drive):
        made.add(event, BEGIN + 40 * MS)
    assert at(made, 5000).pose == Pose(1.0, 0.0, 0.0)  # placing the car stops it


def test_a_stamped_initial_pose_replaces_earlier_ones_without_a_stamp():
    """A command without a stamp stays."""
    there, here = Pose(1.0, 0.0, 0.0), Pose(2.0, 0.0, 0.0)
    unstamped = InitialPose(BEGIN + 30 * MS, there, has_stamp=False)
    drive = Command(BEGIN + 30 * MS, 2.0, 0.0, has_stamp=False)
    for events, x in (
        ((unstamped, drive, InitialPose(BEGIN + 20 * MS, here)), 2.4),
        ((drive, InitialPose(BEGIN + 20 * MS, here), unstamped), 1.4),
        ((unstamped._replace(has_stamp=True), drive, InitialPose(BEGIN + 20 * MS, here)), 1.4),
    ):
        made = History(CAR, START)
        for event in events:
            made.add(event, BEGIN + 40 * MS)
        assert at(made, 5000).pose == pytest.approx((x, 0.0, 0.0), abs=ROUNDING)


def test_an_event_from_before_the_history_applies_at_its_beginning():
    made = history((-500, 2.0, 0.0))
    assert at(made, 100).speed == 2.0 and at(made, 200).speed == 0.0
    assert at(made, -1000).stamp == BEGIN
    # One ahead of the clock applies at its stamp.
    made = History(CAR, START)
    made.add(Command(BEGIN + 500 * MS, 2.0, 0.0), BEGIN)
    assert at(made, 499) == START._replace(stamp=BEGIN + 499 * MS)
    assert at(made, 500).speed == 2.0


def test_a_history_forgets_events_beyond_the_tolerance():
    """After 2.9 s its beginning is the last event before 1.9 s."""
    made = history(*((offset, 1.0, 0.1) for offset in range(0, 3000, 100)))
    assert at(made, 0).stamp == BEGIN + 1800 * MS


offsets = st.integers(0, 60).map(lambda tick: tick * 50 * MS)
delays = st.integers(0, 20).map(lambda tick: tick * 50 * MS)
commands = st.dictionaries(
    offsets, st.tuples(st.floats(-3, 3), st.floats(-0.5, 0.5)), min_size=1, max_size=20
)
initial_poses = st.dictionaries(
    offsets, st.builds(Pose, st.floats(-9, 9), st.floats(-9, 9), st.floats(-4, 4)), max_size=4
)


def expected_state(events, stamp):
    """Return the state at `stamp` after the events until then, applied in order."""
    state = START
    for event in sorted(events, key=lambda each: (each.stamp, isinstance(each, Command))):
        if event.stamp <= stamp:
            state = apply(advance(state, event.stamp, CAR), event, CAR)
    return advance(state, stamp, CAR)


@given(commands, initial_poses, st.data())
def test_late_repeated_and_shuffled_messages_give_the_state_as_in_order(
    commands, initial_poses, data
):
    """Each message arrives once or twice, up to the tolerance late, and so in any order.

    After each arrival, the state at any instant within the tolerance equals, to the last bit, that
    of all events so far in order. Stamps and delays are multiples of 50 ms, so many coincide.
    """
    events = [Command(BEGIN + offset, *command) for offset, command in commands.items()]
    events += [InitialPose(BEGIN + offset, pose) for offset, pose in initial_poses.items()]
    arrivals = []
    for event in events:
        for delay in data.draw(st.lists(delays, min_size=1, max_size=2)):
            arrivals.append((event.stamp + delay, data.draw(st.floats(0, 1)), event))
    arrivals.sort(key=lambda arrival: arrival[:2])

    made = History(CAR, START)
    arrived = set()
    for now, _, event in arrivals:
        made.add(event, now)
        arrived.add(event)
        oldest = max(BEGIN, now - STAMP_TOLERANCE)
        for stamp in [*range(oldest, now + STAMP_TOLERANCE, 75 * MS), now]:
            assert made.state_at(stamp) == expected_state(arrived, stamp)


@given(commands, initial_poses)
def test_odometry_is_continuous_and_the_frames_agree(commands, initial_poses):
    """Compare the states right before and after each event."""
    made = History(CAR, START)
    for offset in sorted({*commands, *initial_poses}):
        stamp = BEGIN + offset
        before = made.state_at(stamp)
        if offset in initial_poses:
            made.add(InitialPose(stamp, initial_poses[offset]), stamp)
            assert made.state_at(stamp).pose == initial_poses[offset]
        if offset in commands:
            made.add(Command(stamp, *commands[offset]), stamp)
        after = made.state_at(stamp)
        assert after.odom_pose == pytest.approx(before.odom_pose, abs=ROUNDING)
        assert compose(after.map_from_odom, after.odom_pose) == pytest.approx(
            after.pose, abs=ROUNDING
        )


@pytest.mark.parametrize("speed, angle", [(2.0, 0.3), (-1.5, 0.5), (3.0, -0.2), (2.0, 0.0)])
def test_the_twist_is_the_derivative_of_the_odometry(speed, angle):
    state = driving(speed, angle)
    before, now, after = (
        advance(state, BEGIN + tick * MS, CAR).odom_pose for tick in (99, 100, 101)
    )
    here = inverse(now)
    ahead, behind = compose(here, after), compose(here, before)
    rates = [(a - b) / 0.002 for a, b in zip(ahead, behind)]
    assert rates == pytest.approx([speed, 0.0, state.yaw_rate(CAR)], abs=DIFFERENCE)


@pytest.mark.parametrize("speed, angle", [(1.0, 0.4), (-1.0, 0.4), (0.3, -1.3), (2.0, 0.0)])
def test_each_wheel_rolls_in_its_direction_and_does_not_slip(speed, angle):
    """Observe the ground below each wheel; at 1.3 rad the turning centre is between the wheels."""
    state = driving(speed, angle)
    before, now, after = (advance(state, BEGIN + tick * MS, CAR) for tick in (99, 100, 101))
    left, right = front_wheel_angles(angle, CAR)
    half = CAR.track / 2
    front = Pose(CAR.wheelbase, half, left), Pose(CAR.wheelbase, -half, right)
    wheels = [*front, Pose(0.0, half, 0.0), Pose(0.0, -half, 0.0)]
    for wheel, rate in zip(wheels, wheel_rates(now, CAR)):
        mount = inverse(compose(now.pose, wheel))
        ahead = compose(mount, compose(after.pose, wheel))
        behind = compose(mount, compose(before.pose, wheel))
        rolled = rate * CAR.wheel_radius
        assert (ahead.x - behind.x) / 0.002 == pytest.approx(rolled, abs=DIFFERENCE)
        assert (ahead.y - behind.y) / 0.002 == pytest.approx(0.0, abs=DIFFERENCE)


def test_the_front_wheels_turn_about_one_centre():
    """At a radius of 2 m: tan = L / (2 m -+ half the track)."""
    left, right = front_wheel_angles(math.atan(0.33 / 2.0), CAR)
    assert left == pytest.approx(math.atan(0.33 / 1.875), abs=ROUNDING)
    assert right == pytest.approx(math.atan(0.33 / 2.125), abs=ROUNDING)
    assert front_wheel_angles(-math.atan(0.33 / 2.0), CAR) == pytest.approx((-right, -left))
    assert front_wheel_angles(0.0, CAR) == (0.0, 0.0)
