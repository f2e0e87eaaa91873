"""The simulated car: a function of the stamped events, whatever the order they arrive in."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.car.bicycle import Pose, compose, inverse
from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Car, Command, InitialPose, at_rest, front_wheel_angles
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.sim.stamps import STAMP_TOLERANCE

MS = 1_000_000
SECOND = 1000 * MS
"""[ns]"""

CAR = Car()
BEGIN = 1_700_000_000 * SECOND
START = at_rest(BEGIN, Pose(1.0, 2.0, 0.5))

ROUNDING = 1e-12
"""[m, rad] For some operations on doubles of the size of 10."""

DIFFERENCE = 1e-5
"""[m/s, rad/s] Central differences over 1 ms are off by v w^2 (1 ms)^2 / 6, here under 1e-5."""


def driving(speed, steering_angle, car=CAR):
    """Return the state of a car that has just been told to drive."""
    return apply(START, Command(BEGIN, speed, steering_angle), car)


def history(*events):
    """Return a history with events of (ms after the beginning, speed, steering angle) or poses."""
    made = History(CAR, START)
    for offset, *what in events:
        stamp = BEGIN + offset * MS
        is_pose = isinstance(what[0], Pose)
        event = InitialPose(stamp, what[0]) if is_pose else Command(stamp, *what)
        made.add(event, stamp)
    return made


def at(made, offset):
    """Return the state some ms after the beginning."""
    return made.state_at(BEGIN + round(offset * MS))


def test_a_car_that_nobody_drives_stays():
    for offset in (0, 1, 10**6):
        state = at(history(), offset)
        assert state == START._replace(stamp=BEGIN + offset * MS)
        assert state.odom_pose == pytest.approx((0.0, 0.0, 0.0), abs=ROUNDING)


def test_a_command_is_good_for_its_timeout_and_then_the_car_stops():
    made = history((0, 2.0, 0.0))
    for offset, distance in ((0, 0.0), (50, 0.1), (199.999999, 0.4), (200, 0.4), (5000, 0.4)):
        state = at(made, offset)
        assert state.speed == (2.0 if offset < 200 else 0.0)
        assert state.turn_rate(CAR) == 0.0
        assert math.dist(state.pose[:2], START.pose[:2]) == pytest.approx(distance, abs=1e-8)


def test_the_timeout_runs_from_the_stamp_and_each_command_renews_it():
    late = History(CAR, START)
    late.add(Command(BEGIN, 2.0, 0.3), BEGIN + 900 * MS)
    assert at(late, 900).pose == at(history((0, 2.0, 0.3)), 900).pose
    renewed = history((0, 2.0, 0.0), (200, 2.0, 0.0), (300, 2.0, 0.0))
    assert math.dist(at(renewed, 900).pose[:2], START.pose[:2]) == pytest.approx(1.0, abs=ROUNDING)
    gap = history((0, 2.0, 0.0), (300, 2.0, 0.0))
    assert math.dist(at(gap, 900).pose[:2], START.pose[:2]) == pytest.approx(0.8, abs=ROUNDING)


def test_the_command_timeout_is_the_cars():
    state = driving(2.0, 0.0, Car(command_timeout=500 * MS))
    assert advance(state, BEGIN + SECOND, CAR).wheel_angles.back_left == pytest.approx(1.0 / 0.0488)


@pytest.mark.parametrize("again", range(10, 500, 70))
def test_a_stop_that_is_repeated_changes_nothing(again):
    """Not even the last bit: one that comes late does not change poses that have been told."""
    car = Car(acceleration=2.5, steering_rate=3.2)
    made = History(car, START)
    made.add(Command(BEGIN, 0.93, 0.3), BEGIN)
    made.add(Command(BEGIN + 150 * MS, 0.0, 0.0), BEGIN)
    told = [at(made, offset) for offset in range(150, 800, 7)]
    made.add(Command(BEGIN + again * MS + 150 * MS, 0.0, 0.0), BEGIN)
    for before, offset in zip(told, range(150, 800, 7)):
        after = at(made, offset)
        assert after._replace(command=None, ticks=0) == before._replace(command=None, ticks=0)


def test_commands_of_one_stamp_count_once_and_stops_count():
    """The noise of a command depends on how many there were."""
    made = history(
        (0, 1.0, 0.0), (100, 0.0, 0.0), (300, 0.0, 0.0), (300, 0.0, 0.0), (300, 1.0, 0.0)
    )
    assert at(made, 300).ticks == 3


@pytest.mark.parametrize(
    "stop", [(0.0, 0.1), (0.0, 0.0, 0.5), (0.0, 0.0, 0.0, 0.5), (1e-3, 0.0)], ids=str
)
def test_another_stop_counts(stop):
    """One that steers elsewhere or brakes otherwise, and also that one, when it is repeated."""
    car = Car(acceleration=2.5, steering_rate=3.2)
    orders = [(0, 0.93, 0.3), (150, 0.0, 0.0), (200, *stop), (350, *stop)]
    made = History(car, START)
    states = []
    for offset, *order in orders:
        made.add(Command(BEGIN + offset * MS, *order), BEGIN)
        states.append(at(made, 430))
    assert states[2][:6] != states[1][:6]
    if len(stop) == 3:  # braking gently, which it does for as long as it is told to
        assert states[3].speed > states[2].speed > 0.0


def test_a_placement_puts_the_car_at_rest_and_forgets_the_command():
    there = Pose(-7.0, 3.0, 3.0)
    made = history((0, 2.0, 0.3), (100, there))
    for offset in (100, 150, 5000):
        state = at(made, offset)
        assert state.pose == there
        assert (state.speed, state.steering_angle, state.turn_rate(CAR)) == (0.0, 0.0, 0.0)
    assert at(made, 99).pose != there


def test_the_next_command_drives_on_from_where_the_car_was_placed():
    made = history((0, 2.0, 0.3), (100, Pose(-7.0, 3.0, 0.0)), (150, 2.0, 0.0))
    assert at(made, 5000).pose == pytest.approx((-6.6, 3.0, 0.0), abs=ROUNDING)


def test_at_the_same_stamp_a_placement_comes_first_and_the_later_command_counts():
    there = Pose(0.0, 0.0, 0.0)
    for events in (
        [(0, there), (0, 9.0, 0.5), (0, 2.0, 0.0)],
        [(0, 9.0, 0.5), (0, there), (0, 2.0, 0.0)],
        [(0, 9.0, 0.5), (0, 2.0, 0.0), (0, there)],
    ):
        assert at(history(*events), 5000).pose == pytest.approx((0.4, 0.0, 0.0), abs=ROUNDING)


def test_what_is_stamped_before_the_history_applies_at_its_beginning():
    made = History(CAR, START)
    made.add(Command(BEGIN - 500 * MS, 2.0, 0.0), BEGIN)
    assert at(made, 100).speed == 2.0 and at(made, 200).speed == 0.0
    assert made.state_at(BEGIN - SECOND).stamp == BEGIN


def test_what_is_stamped_ahead_waits_for_its_time():
    made = History(CAR, START)
    made.add(Command(BEGIN + 500 * MS, 2.0, 0.0), BEGIN)
    assert at(made, 499) == START._replace(stamp=BEGIN + 499 * MS)
    assert at(made, 500).speed == 2.0


def test_a_history_stays_short():
    made = History(CAR, START)
    for tick in range(10_000):
        made.add(Command(BEGIN + tick * MS, 1.0, 0.1), BEGIN + tick * MS)
    assert len(made._events) == len(made._payload) == len(made._states) - 1 == 1001


offsets = st.integers(0, 60).map(lambda tick: tick * 50 * MS)
delays = st.integers(0, 20).map(lambda tick: tick * 50 * MS)
commands = st.dictionaries(
    offsets, st.tuples(st.floats(-3, 3), st.floats(-0.5, 0.5)), min_size=1, max_size=20
)
placements = st.dictionaries(
    offsets, st.builds(Pose, st.floats(-9, 9), st.floats(-9, 9), st.floats(-4, 4)), max_size=4
)


def expected_state(events, stamp):
    """Return the state at `stamp` by applying what is stamped until then, in order."""
    state = START
    for event in sorted(events, key=lambda each: (each.stamp, isinstance(each, Command))):
        if event.stamp <= stamp:
            state = apply(advance(state, event.stamp, CAR), event, CAR)
    return advance(state, stamp, CAR)


@given(commands, placements, st.data())
def test_late_double_and_shuffled_messages_give_the_state_as_in_order(commands, placements, data):
    """Every message comes once or twice, up to the tolerance late, and so in any order.

    After each, the state at any instant within the tolerance is, to the last bit, that of all
    events so far applied in order. Stamps and delays are multiples of 50 ms, so many coincide.
    """
    events = [Command(BEGIN + offset, *command) for offset, command in commands.items()]
    events += [InitialPose(BEGIN + offset, pose) for offset, pose in placements.items()]
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


@given(commands, placements)
def test_odometry_is_continuous_and_the_frames_agree(commands, placements):
    """Check before and after each event; in a nanosecond a car at 3 m/s moves by 3e-9 m."""
    made = History(CAR, START)
    stamps = sorted({*commands, *placements})
    for offset in stamps:
        stamp = BEGIN + offset
        before = made.state_at(stamp)
        if offset in placements:
            made.add(InitialPose(stamp, placements[offset]), stamp)
            assert made.state_at(stamp).pose == placements[offset]
        if offset in commands:
            made.add(Command(stamp, *commands[offset]), stamp)
        after = made.state_at(stamp)
        assert after.odom_pose == pytest.approx(before.odom_pose, abs=ROUNDING)
        assert after.wheel_angles == before.wheel_angles
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
    assert rates == pytest.approx([speed, 0.0, state.turn_rate(CAR)], abs=DIFFERENCE)


@pytest.mark.parametrize("speed, angle", [(1.0, 0.4), (-1.0, 0.4), (0.3, -1.3), (2.0, 0.0)])
def test_the_wheels_roll_where_they_point_and_do_not_slip(speed, angle):
    """Follow the point of the ground under each wheel; 1.3 rad turns within the track."""
    state = driving(speed, angle)
    before, now, after = (advance(state, BEGIN + tick * MS, CAR) for tick in (99, 100, 101))
    left, right = front_wheel_angles(angle, CAR)
    for place, (forward, aside, pointing) in enumerate(
        [
            (CAR.wheelbase, CAR.track / 2, left),
            (CAR.wheelbase, -CAR.track / 2, right),
            (0.0, CAR.track / 2, 0.0),
            (0.0, -CAR.track / 2, 0.0),
        ]
    ):
        wheel = Pose(forward, aside, pointing)
        mount = inverse(compose(now.pose, wheel))
        ahead = compose(mount, compose(after.pose, wheel))
        behind = compose(mount, compose(before.pose, wheel))
        wheel_angles = (after.wheel_angles[place] - before.wheel_angles[place]) * CAR.wheel_radius
        assert (ahead.x - behind.x) / 0.002 == pytest.approx(wheel_angles / 0.002, abs=DIFFERENCE)
        assert (ahead.y - behind.y) / 0.002 == pytest.approx(0.0, abs=DIFFERENCE)


def test_the_front_wheels_point_at_one_centre():
    """At a radius of 2 m: tan = L / (2 m -+ half the track)."""
    left, right = front_wheel_angles(math.atan(0.33 / 2.0), CAR)
    assert left == pytest.approx(math.atan(0.33 / 1.875), abs=ROUNDING)
    assert right == pytest.approx(math.atan(0.33 / 2.125), abs=ROUNDING)
    assert front_wheel_angles(-math.atan(0.33 / 2.0), CAR) == pytest.approx((-right, -left))
    assert front_wheel_angles(0.0, CAR) == (0.0, 0.0)
