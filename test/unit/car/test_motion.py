"""Cars with limits, ramps and noise, against numerical integration in fine steps."""

import math
import statistics

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.car.model import Car, Command, at_rest
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.geometry import ORIGIN, Pose
from mushr_ros_intro.world.footprint import Footprint, World, is_free
from mushr_ros_intro.world.map_file import read_map
from support.cars import BEGIN, CARS, MS, ROUNDING, SECOND, at, history_of
from support.paths import PACKAGE

NANO = CARS["mushr_nano"]._replace(
    acceleration=2.5, steering_limit_left=0.4375, steering_limit_right=0.4375
)
"""With an acceleration that is easy to compute with, and the same limit to both sides."""
TRIMMED = NANO._replace(speed_gain=0.9, steering_gain=1.1, steering_offset=-0.05)
STANDING = at_rest(0, ORIGIN)

FINE = 2e-5
"""[s] Step of the reference."""

REFERENCE = 1e-7
"""[m, rad] The error of the midpoint rule is a FINE^2 / 24 per ramp, and 1e-9 in total."""


def ramp(begin, target, rate, seconds):
    """Return the values of a ramp from `begin` to `target` after an array of times."""
    if math.isinf(rate):
        return np.full_like(seconds, target)
    change = np.minimum(np.abs(target - begin), rate * seconds)
    return begin + np.copysign(change, target - begin)


class Reference:
    """A car that is integrated by the midpoint rule, directly from the profile's definitions."""

    def __init__(self, car, start):
        self.car, self.start = car, start
        self.speed = self.angle = 0.0
        self.x, self.y, self.theta = start

    def drive(self, speed, angle, seconds, acceleration=0.0, velocity=0.0):
        car = self.car
        speed = min(max(speed, -car.speed_limit), car.speed_limit)
        angle = min(max(angle, -car.steering_limit_right), car.steering_limit_left)
        speed, angle = car.speed_gain * speed, car.steering_gain * angle + car.steering_offset
        acceleration = min(abs(acceleration) or math.inf, car.acceleration)
        velocity = min(abs(velocity) or math.inf, car.steering_rate)
        count = round(seconds / FINE)
        middles = (np.arange(count) + 0.5) * (seconds / count)
        speeds = ramp(self.speed, speed, acceleration, middles)
        turns = speeds * np.tan(ramp(self.angle, angle, velocity, middles)) / car.wheelbase
        turned = np.cumsum(turns) * (seconds / count)
        headings = self.theta + turned - 0.5 * turns * (seconds / count)
        self.x += float(np.sum(speeds * np.cos(headings))) * (seconds / count)
        self.y += float(np.sum(speeds * np.sin(headings))) * (seconds / count)
        self.theta += float(turned[-1])
        end = np.array([seconds])
        self.speed = float(ramp(self.speed, speed, acceleration, end)[0])
        self.angle = float(ramp(self.angle, angle, velocity, end)[0])

    @property
    def pose(self):
        return self.x, self.y, self.theta


requests = st.lists(
    st.tuples(
        st.floats(-3, 3), st.floats(-0.6, 0.6), st.sampled_from([0.0, 0.5, -4.0]), st.floats(0, 5)
    ),
    min_size=1,
    max_size=4,
)


@given(requests, st.sampled_from([*CARS.values(), TRIMMED]))
def test_commands_with_rates_against_the_reference(requests, car):
    """A rate of 0 means the car's limit. Only the size of another rate counts, up to the limit."""
    reference = Reference(car, (0.0, 0.0, 0.0))
    state = STANDING
    for number, request in enumerate(requests):
        state = advance(state, number * 150 * MS, car)
        state = apply(state, Command(state.stamp, *request), car)
        reference.drive(request[0], request[1], 0.15, *request[2:])
        ahead = advance(state, state.stamp + 150 * MS, car)
        assert ahead.pose == pytest.approx(reference.pose, abs=REFERENCE)
        assert ahead.speed == pytest.approx(reference.speed, abs=ROUNDING)
        assert ahead.steering_angle == pytest.approx(reference.angle, abs=ROUNDING)


def test_a_straight_start_and_stop_by_hand():
    """At 2.5 m/s^2: v^2 / 2a up to 0.5 m/s, and as much to stop after the command has expired."""
    state = apply(STANDING, Command(0, 0.5, 0.0), NANO)
    for seconds, speed, distance in (
        (0.1, 0.25, 0.0125),
        (0.2, 0.5, 0.05),
        (0.3, 0.25, 0.05 + 0.0375),
        (0.4, 0.0, 0.1),
        (9.0, 0.0, 0.1),
    ):
        then = advance(state, round(seconds * SECOND), NANO)
        assert then.speed == pytest.approx(speed, abs=ROUNDING)
        assert then.pose == pytest.approx((distance, 0.0, 0.0), abs=ROUNDING)


def test_a_steered_start_by_hand():
    """While the car stands, only the front wheels steer: at 3.2 rad/s, up to 0.4375 rad."""
    state = apply(STANDING, Command(0, 0.0, 1.0), NANO)
    assert advance(state, 100 * MS, NANO).steering_angle == pytest.approx(0.32, abs=ROUNDING)
    for offset in (150 * MS, SECOND):
        then = advance(state, offset, NANO)
        assert then.steering_angle == 0.4375
        assert then.pose == state.pose
    tx2 = CARS["mushr_tx2"]
    right = apply(STANDING, Command(0, -9.0, -1.0), tx2)
    assert advance(right, 150 * MS, tx2).steering_angle == -0.3296
    # The command expires after 0.2 s, before the car reaches its limit of 1.625 m/s.
    assert advance(right, 200 * MS, tx2).speed == pytest.approx(-2.2222 * 0.2, abs=ROUNDING)


def test_the_ideal_car_follows_the_rates_of_a_command_and_stops_at_once():
    state = apply(STANDING, Command(0, 2.0, 0.3, 5.0, -2.0), Car())
    then = advance(state, 100 * MS, Car())
    assert (then.speed, then.steering_angle) == pytest.approx((0.5, 0.2), abs=ROUNDING)
    stopped = advance(state, 200 * MS, Car())
    assert stopped.speed == 0.0


def test_a_reversal_goes_through_standstill():
    state = apply(STANDING, Command(0, 0.5, 0.0), NANO)
    state = apply(advance(state, 200 * MS, NANO), Command(200 * MS, -0.5, 0.0), NANO)
    assert advance(state, 300 * MS, NANO).speed == pytest.approx(0.25)
    turn = advance(state, 400 * MS, NANO)
    assert turn.speed == pytest.approx(0.0, abs=ROUNDING)
    assert turn.pose.x == pytest.approx(0.1)
    # The command expires at that instant, so the car does not start in reverse.
    assert advance(state, 9 * SECOND, NANO).pose.x == pytest.approx(0.1)


SANDBOX = World(read_map(f"{PACKAGE}/maps/sandbox.yaml"))
STOP = 49.4 - Footprint().front
"""[m] The x coordinate at which the wall of the sandbox stops a car that drives along x."""


def test_a_limited_car_hits_a_wall_and_reverses_away():
    state = at_rest(0, Pose(48.9, 1.0, 0.0))
    hits = set()
    for tick in range(20):
        speed = 0.9 if tick < 10 else -0.9
        state = apply(state, Command(state.stamp, speed, 0.0), NANO, SANDBOX)
        for ahead in range(0, 100, 7):
            then = advance(state, state.stamp + ahead * MS, NANO)
            assert is_free(*SANDBOX, then.pose)
            assert then.collision is None or then.speed == 0.0
            hits.add(then.collision)
        state = advance(state, state.stamp + 100 * MS, NANO)
    (hit,) = hits - {None}
    # It drives 0.12 m from standstill, which takes sqrt(2 s / a).
    assert hit.stamp == pytest.approx(math.sqrt(2 * 0.12 / 2.5) * SECOND, abs=100)
    assert hit.pose == pytest.approx((STOP, 1.0, 0.0), abs=3e-9)
    # It reverses for 1 s, of which it accelerates to 0.9 m/s for 0.36 s.
    assert state.pose.x == pytest.approx(STOP - 0.9 * (1.0 - 0.18), abs=1e-8)


def test_a_car_that_brakes_into_a_wall_reverses_and_a_car_at_a_wall_steers():
    state = at_rest(0, Pose(48.96, 1.0, 0.0))._replace(speed=0.9)
    state = apply(state, Command(0, -0.9, 0.0), NANO, SANDBOX)
    at_wall = advance(state, 150 * MS, NANO)
    assert at_wall.collision is None  # it has hit the wall, and already reverses
    assert at_wall.speed < 0.0
    furthest = max(advance(state, ms * MS, NANO).pose.x for ms in range(400))
    assert furthest == pytest.approx(STOP, abs=1e-4)  # sampled once a ms
    stuck = apply(at_rest(0, Pose(49.02, 1.0, 0.0)), Command(0, 0.9, 0.4), NANO, SANDBOX)
    later = advance(stuck, 150 * MS, NANO)
    assert later.collision and later.speed == 0.0 and later.steering_angle == 0.4


NOISY = Car(acceleration=2.5, steering_rate=3.2, speed_noise=0.3, steering_noise=0.1, seed=7)
offsets = st.integers(0, 18).map(lambda tick: tick * 50)
commands = st.dictionaries(
    offsets, st.tuples(st.floats(-2, 2), st.floats(-0.5, 0.5)), min_size=3, max_size=15
)


@given(commands, st.randoms())
def test_late_repeated_and_shuffled_commands_have_the_same_noise(commands, dice):
    start = at_rest(BEGIN, Pose(1.0, 2.0, 3.0))
    events = [(offset, *values) for offset, values in sorted(commands.items())]
    shuffled = events * 2
    dice.shuffle(shuffled)
    in_order, in_disorder = (history_of(NOISY, start, *each) for each in (events, shuffled))
    for offset in range(900, 3000, 37):
        assert at(in_order, offset) == at(in_disorder, offset)


def noisy_end(*events, seed=7):
    """Return where a car with noise ends after events; it stands 0.2 s after a command."""
    car = Car(speed_noise=0.3, steering_noise=0.1, seed=seed)
    return at(history_of(car, at_rest(BEGIN, ORIGIN), *events), 5000).pose


DRIVE = [(100, 1.0, 0.2), (600, 1.0, -0.2)]


@pytest.mark.parametrize(
    "events",
    [
        [(350, 0.0, 0.0)],
        [(0, 0.0, 0.0), (600, 0.0, 0.0), (50, 0.0, 0.1)],
        [(300, 0.0, 0.2, 0.5), (900, 0.0, 0.0)],
        [(100, 2.0, 0.5), (100, 1.0, 0.2)],
        [(0, 1.0, 0.5), (50, ORIGIN)],
    ],
    ids=["stop", "stops", "gentle stop", "replaced", "before the initial pose"],
)
def test_only_commands_to_drive_change_the_noise_of_later_ones(events):
    """A stop can arrive late. Each of these events leaves a car that stands as it was."""
    assert noisy_end(*events, *DRIVE) == noisy_end(*DRIVE)


def test_each_command_to_drive_has_its_own_noise_which_depends_on_the_seed():
    assert noisy_end(*DRIVE, seed=1) == noisy_end(*DRIVE, seed=1) != noisy_end(*DRIVE, seed=2)
    events = ((0, 1e3, 0.0), (100, 0.2, 0.0), (200, 0.2, 0.0))
    drive = history_of(NOISY, at_rest(BEGIN, ORIGIN), *events)
    assert len({at(drive, offset).steering_angle for offset in (90, 190, 290)}) == 3


def test_noise_has_the_requested_standard_deviation():
    car = Car(speed_noise=0.25, steering_noise=0.0625)
    speeds, angles = [], []
    for seed in range(4000):
        state = apply(STANDING, Command(0, 1.0, 0.5), car._replace(seed=seed))
        speeds.append(state.speed - 1.0)
        angles.append(state.steering_angle - 0.5)
    # The standard error of a mean is s / sqrt(4000), and that of a deviation s / sqrt(8000).
    for values, deviation in ((speeds, 0.25), (angles, 0.0625)):
        assert statistics.mean(values) == pytest.approx(0.0, abs=4 * deviation / 4000**0.5)
        assert statistics.stdev(values) == pytest.approx(deviation, rel=4 / 8000**0.5)
    assert abs(np.corrcoef(speeds, angles)[0, 1]) < 4 / 4000**0.5
