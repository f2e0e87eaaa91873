"""Cars with limits, ramps and noise, against a fine-grained integration of what was ordered."""

import glob
import math
import os
import statistics

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.contact import World
from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Car, Command, InitialPose, at_rest
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.car.profile import car_from, read_profile
from mushr_ros_intro.parameters import ParameterError, Parameters
from mushr_ros_intro.plan.find import read_plan
from mushr_ros_intro.plan.model import as_float32
from mushr_ros_intro.world.footprint import Footprint, is_free
from mushr_ros_intro.world.grid import read_map
from support.paths import PACKAGE


def read(path):
    with open(path) as file:
        return yaml.safe_load(file)


PROFILES = {
    os.path.basename(path)[:-5]: read(path)
    for path in glob.glob(os.path.join(PACKAGE, "config", "cars", "*.yaml"))
}
CARS = {
    name: car_from(Parameters({**values, "noise": False}, "~")) for name, values in PROFILES.items()
}
NANO = CARS["mushr_nano"]

MS = 1_000_000
SECOND = 1000 * MS
"""[ns]"""

FINE = 2e-5
"""[s] Step of the reference: a hundredth of the car's own and less."""

REFERENCE = 1e-7
"""[m, rad] The midpoint rule at FINE is off by a FINE^2 / 24 a ramp, and by 1e-9 in all."""

ROUNDING = 1e-12
"""[m, rad, m/s] For some operations on doubles of the size of 10."""


def ramp(begin, aim, rate, seconds):
    """Return a value on its way to an aim after an array of times."""
    if math.isinf(rate):
        return np.full_like(seconds, aim)
    change = np.minimum(np.abs(aim - begin), rate * seconds)
    return begin + np.copysign(change, aim - begin)


class Reference:
    """A car driven by the midpoint rule, as if written down from the words of the profile."""

    def __init__(self, car, start):
        self.car, self.start = car, start
        self.speed = self.angle = 0.0
        self.x, self.y, self.theta = start
        self.way = 0.0

    def drive(self, speed, angle, seconds, acceleration=0.0, velocity=0.0):
        car = self.car
        speed = min(max(speed, -car.speed_limit), car.speed_limit)
        angle = min(max(angle, -car.steering_limit_right), car.steering_limit_left)
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
        self.way += float(np.sum(speeds)) * (seconds / count)
        end = np.array([seconds])
        self.speed = float(ramp(self.speed, speed, acceleration, end)[0])
        self.angle = float(ramp(self.angle, angle, velocity, end)[0])

    @property
    def pose(self):
        return self.x, self.y, self.theta


def ticks_of(plan):
    """Yield each command of a plan as path_publisher sends it: stamp, duration, speed, angle."""
    due = 0
    for row in plan.rows:
        for begin in range(0, row.duration, 100 * MS):
            duration = min(100 * MS, row.duration - begin)
            yield due + begin, duration, as_float32(row.speed), as_float32(row.steering_angle)
        due += row.duration
    yield due, 5 * SECOND, 0.0, 0.0


@pytest.mark.parametrize("name", sorted(CARS))
@pytest.mark.parametrize("plan_name", ["figure_8", "parallel_parking", "slalom"])
def test_along_a_plan_against_a_fine_step(name, plan_name):
    car = CARS[name]
    plan = read_plan(os.path.join(PACKAGE, "plans", f"{plan_name}.txt"))
    reference = Reference(car, plan.start)
    state = at_rest(0, Pose(*plan.start))
    for stamp, duration, speed, angle in ticks_of(plan):
        state = apply(advance(state, stamp, car), Command(stamp, speed, angle), car)
        assert state.pose == pytest.approx(reference.pose, abs=REFERENCE)
        reference.drive(speed, angle, duration / SECOND)
    state = advance(state, state.stamp + 5 * SECOND, car)
    assert state.pose == pytest.approx(reference.pose, abs=REFERENCE)
    assert (state.speed, state.steering_angle) == (0.0, 0.0)


orders = st.lists(
    st.tuples(
        st.floats(-3, 3), st.floats(-0.6, 0.6), st.sampled_from([0.0, 0.5, -4.0]), st.floats(0, 5)
    ),
    min_size=1,
    max_size=4,
)


@given(orders, st.sampled_from(sorted(CARS)))
@settings(max_examples=40)
def test_any_orders_with_rates_of_their_own_against_a_fine_step(orders, name):
    """A rate of zero is as fast as the car can; others count by their size, within its limits."""
    car = CARS[name]
    reference = Reference(car, (0.0, 0.0, 0.0))
    state = at_rest(0, Pose(0.0, 0.0, 0.0))
    for number, order in enumerate(orders):
        state = advance(state, number * 150 * MS, car)
        state = apply(state, Command(state.stamp, *order), car)
        reference.drive(order[0], order[1], 0.15, *order[2:])
        ahead = advance(state, state.stamp + 150 * MS, car)
        assert ahead.pose == pytest.approx(reference.pose, abs=10 * REFERENCE)
        assert ahead.speed == pytest.approx(reference.speed, abs=ROUNDING)
        assert ahead.steering_angle == pytest.approx(reference.angle, abs=ROUNDING)


def test_a_straight_start_and_stop_by_hand():
    """To 0.9 m/s at 2.5 m/s^2: v^2 / 2a on the way up, and the same after the command's end."""
    state = apply(at_rest(0, Pose(0.0, 0.0, 0.0)), Command(0, 0.5, 0.0), NANO)
    for seconds, speed, way in (
        (0.1, 0.25, 0.0125),
        (0.2, 0.5, 0.05),
        (0.3, 0.25, 0.05 + 0.0375),
        (0.4, 0.0, 0.1),
        (9.0, 0.0, 0.1),
    ):
        then = advance(state, round(seconds * SECOND), NANO)
        assert then.speed == pytest.approx(speed, abs=ROUNDING)
        assert then.pose == pytest.approx((way, 0.0, 0.0), abs=ROUNDING)
        assert then.wheel_angles == pytest.approx([way / 0.0488] * 4)


def test_a_steered_start_by_hand():
    """While the car stands, only the front wheels move: 3.2 rad/s, and 0.4375 rad at most."""
    state = apply(at_rest(0, Pose(0.0, 0.0, 0.0)), Command(0, 0.0, 1.0), NANO)
    assert advance(state, 100 * MS, NANO).steering_angle == pytest.approx(0.32, abs=ROUNDING)
    for offset in (150 * MS, SECOND):
        then = advance(state, offset, NANO)
        assert then.steering_angle == 0.4375
        assert then.pose == state.pose
    tx2 = CARS["mushr_tx2"]
    right = apply(at_rest(0, Pose(0.0, 0.0, 0.0)), Command(0, -9.0, -1.0), tx2)
    assert advance(right, 150 * MS, tx2).steering_angle == -0.3296
    # 1.625 m/s takes 0.65 s; by then the command is over, and it has brought 0.5 m/s
    assert advance(right, 200 * MS, tx2).speed == pytest.approx(-0.5, abs=ROUNDING)


def test_the_wheels_roll_as_far_as_the_car_while_it_is_steered():
    """The rear wheels, on average, as far as the middle between them: 0.2 m in reverse."""
    car = Car(steering_rate=1.0, wheel_radius=0.1)
    state = apply(at_rest(0, Pose(0.0, 0.0, 0.0)), Command(0, -1.0, 0.2), car)
    wheel_angles = advance(state, 200 * MS, car).wheel_angles
    assert 0.5 * (wheel_angles.back_left + wheel_angles.back_right) == pytest.approx(
        -2.0, abs=ROUNDING
    )


def test_the_ideal_car_ramps_where_it_is_told_to_and_stops_at_once():
    state = apply(at_rest(0, Pose(0.0, 0.0, 0.0)), Command(0, 2.0, 0.3, 5.0, -2.0), Car())
    then = advance(state, 100 * MS, Car())
    assert (then.speed, then.steering_angle) == pytest.approx((0.5, 0.2), abs=ROUNDING)
    assert advance(state, 200 * MS, Car()).speed == 0.0


def test_turning_round_goes_through_standing():
    state = apply(at_rest(0, Pose(0.0, 0.0, 0.0)), Command(0, 0.5, 0.0), NANO)
    state = apply(advance(state, 200 * MS, NANO), Command(200 * MS, -0.5, 0.0), NANO)
    assert advance(state, 300 * MS, NANO).speed == pytest.approx(0.25)
    turn = advance(state, 400 * MS, NANO)
    assert turn.speed == pytest.approx(0.0, abs=ROUNDING)
    assert turn.pose.x == pytest.approx(0.1)
    # The command ends just then; the car does not start on the way back.
    assert advance(state, 9 * SECOND, NANO).pose.x == pytest.approx(0.1)


def test_a_limited_car_hits_a_wall_and_comes_away():
    body = Footprint()
    world = World(read_map(os.path.join(PACKAGE, "maps", "sandbox.yaml")), body)
    state = at_rest(0, Pose(48.9, 1.0, 0.0))
    hits = set()
    for tick in range(20):
        speed = 0.9 if tick < 10 else -0.9
        state = apply(state, Command(state.stamp, speed, 0.0), NANO, world)
        for ahead in range(0, 100, 7):
            then = advance(state, state.stamp + ahead * MS, NANO)
            assert is_free(*world, then.pose)
            assert then.collision is None or then.speed == 0.0
            hits.add(then.collision)
        state = advance(state, state.stamp + 100 * MS, NANO)
    (hit,) = hits - {None}
    # 0.12 m from a standstill: sqrt(2 s / a)
    assert hit.stamp == pytest.approx(math.sqrt(2 * 0.12 / 2.5) * SECOND, abs=100)
    assert hit.pose == pytest.approx((49.4 - body.front, 1.0, 0.0), abs=3e-9)
    # Back for 1 s, of which 0.36 s speeding up to 0.9 m/s.
    assert state.pose.x == pytest.approx(49.4 - body.front - 0.9 * (1.0 - 0.18), abs=1e-8)


def test_it_brakes_into_a_wall_and_goes_back_and_it_steers_while_it_leans_on_one():
    world = World(read_map(os.path.join(PACKAGE, "maps", "sandbox.yaml")))
    state = at_rest(0, Pose(48.96, 1.0, 0.0))._replace(speed=0.9)
    state = apply(state, Command(0, -0.9, 0.0), NANO, world)
    at_wall = advance(state, 150 * MS, NANO)
    assert at_wall.collision is None  # it hit the wall, and has already turned round
    assert at_wall.speed < 0.0
    furthest = max(advance(state, ms * MS, NANO).pose.x for ms in range(400))
    assert furthest == pytest.approx(49.4 - Footprint().front, abs=1e-4)  # it looks once a ms
    stuck = apply(at_rest(0, Pose(49.02, 1.0, 0.0)), Command(0, 0.9, 0.4), NANO, world)
    later = advance(stuck, 150 * MS, NANO)
    assert later.collision and later.speed == 0.0 and later.steering_angle == 0.4


offsets = st.integers(0, 30).map(lambda tick: tick * 50)
commands = st.dictionaries(
    offsets, st.tuples(st.floats(-2, 2), st.floats(-0.5, 0.5)), min_size=3, max_size=15
)


@given(commands, st.randoms(use_true_random=False))
@settings(max_examples=50)
def test_late_double_and_shuffled_commands_give_the_same_noise(commands, dice):
    car = car_from(Parameters({**PROFILES["mushr_nano"], "noise": True, "seed": 7}, "~"))
    start = at_rest(0, Pose(0.0, 0.0, 0.0))
    in_order, anyhow = History(car, start), History(car, start)
    events = [Command(offset * MS, *what) for offset, what in sorted(commands.items())]
    events.insert(0, InitialPose(0, Pose(1.0, 2.0, 3.0)))
    for event in events:
        in_order.add(event, event.stamp)
    shuffled = events * 2
    dice.shuffle(shuffled)
    for event in shuffled:
        anyhow.add(event, 0)
        anyhow.state_at(dice.randrange(0, SECOND))
    for stamp in range(events[-1].stamp, 3 * SECOND, 37 * MS):
        assert in_order.state_at(stamp) == anyhow.state_at(stamp)


def driven(seed, noise=True, since=0):
    """Return where a noisy car ends that is placed and driven for a second."""
    car = car_from(Parameters({**PROFILES["mushr_nano"], "noise": noise, "seed": seed}, "~"))
    state = apply(at_rest(0, Pose(5.0, 5.0, 5.0)), Command(0, 1.0, 0.2), car)
    state = apply(advance(state, since, car), InitialPose(since, Pose(0.0, 0.0, 0.0)), car)
    for tick in range(10):
        stamp = since + tick * 100 * MS
        state = apply(advance(state, stamp, car), Command(stamp, 0.8, 0.2), car)
    return advance(state, since + 5 * SECOND, car).pose


def test_noise_is_the_same_for_a_seed_and_off_unless_asked_for():
    assert driven(1) == driven(1) == driven(1, since=77 * SECOND)
    assert driven(1) != driven(2)
    assert driven(1, noise=False) == driven(2, noise=False)
    error = math.dist(driven(1)[:2], driven(1, noise=False)[:2])
    assert 1e-4 < error < 0.1
    noisy = car_from(Parameters({**PROFILES["mushr_nano"], "noise": True}, "~"))
    state = apply(at_rest(0, Pose(0.0, 0.0, 0.0)), Command(0, 0.0, 0.0), noisy)
    assert advance(state, SECOND, noisy).pose == (0.0, 0.0, 0.0)


def test_noise_has_the_deviation_that_it_should_have():
    car = Car(speed_noise=0.25, steering_noise=0.0625)
    speeds, angles = [], []
    for seed in range(4000):
        state = apply(at_rest(0, Pose(0, 0, 0)), Command(0, 1.0, 0.5), car._replace(seed=seed))
        speeds.append(state.speed - 1.0)
        angles.append(state.steering_angle - 0.5)
    # The standard error of a mean is s / sqrt(4000), and that of a deviation s / sqrt(8000).
    for values, deviation in ((speeds, 0.25), (angles, 0.0625)):
        assert statistics.mean(values) == pytest.approx(0.0, abs=4 * deviation / 4000**0.5)
        assert statistics.stdev(values) == pytest.approx(deviation, rel=4 / 8000**0.5)
    assert abs(np.corrcoef(speeds, angles)[0, 1]) < 4 / 4000**0.5


def test_profiles():
    assert set(CARS) == {"ideal", "mushr_nano", "mushr_tx2", "racecar_mit"}
    assert CARS["ideal"] == Car() == car_from(Parameters({}, "~"))
    assert [name for name, car in CARS.items() if car.is_ideal] == ["ideal"]
    for limited in (Car(acceleration=1.0), Car(speed_noise=0.1), Car(steering_noise=0.1)):
        assert not limited.is_ideal
    keys = {tuple(values) for values in PROFILES.values()}
    assert len(keys) == 1  # the same ones in the same order, so that none is left from another


@pytest.mark.parametrize(
    "name, erpm_gain, servo_gain, servo_offset",
    [
        ("mushr_nano", -3500.0, 0.8, 0.5),
        ("mushr_tx2", -2000.0, 1.2135, 0.55),
        ("racecar_mit", 4614.0, -1.2135, 0.5304),
    ],
)
def test_limits_are_what_the_motor_controller_clips_at(name, erpm_gain, servo_gain, servo_offset):
    """MuSHR's vesc.yaml: erpm and servo are gain times order plus offset, and then clipped."""
    car = CARS[name]
    servo = sorted((servo - servo_offset) / servo_gain for servo in (0.15, 0.85))
    assert (-car.steering_limit_right, car.steering_limit_left) == pytest.approx(servo, abs=1e-4)
    assert car.speed_limit == pytest.approx(3250.0 / abs(erpm_gain), abs=1e-4)


@pytest.mark.parametrize(
    "name, value, expected",
    [
        ("wheelbase", 0.0, "from 0.01 to 100 m"),
        ("track", 0.0, "from 0.01 to 100 m"),
        ("wheel_radius", 0.0, "from 0.001 to 10 m"),
        ("command_timeout", 0.0, "from 0.001 to 10 s"),
        ("speed_limit", -1.0, "from 0.001 to inf m/s"),
        ("speed_limit", math.nan, "from 0.001 to inf m/s"),
        ("acceleration", 0, "from 0.01 to inf m/s^2"),
        ("steering_rate", 0.0, "from 0.01 to inf rad/s"),
        ("steering_limit_left", "wide", "from 0 to inf rad"),
        ("noise", 1, "true or false"),
        ("seed", 1.5, "a whole number"),
        ("speed_noise", math.inf, "from 0 to 10 m/s"),
        ("steering_noise", 2.0, "from 0 to 1 rad"),
    ],
)
def test_a_bad_parameter_is_named(name, value, expected):
    with pytest.raises(ParameterError) as error:
        car_from(Parameters({name: value}, "/car/car_sim/"))
    assert str(error.value).startswith(f"parameter /car/car_sim/{name} is ")
    assert expected in str(error.value)


@pytest.mark.parametrize(
    "data, expected",
    [
        (b"wheelbase: [", "expected the node content"),
        (b"- wheelbase", "there are no parameters; expected such as"),
        (b"wheelbase: !!int ''", "expected parameters in yaml"),
        (b"wheelbase: caf\xe9", "unacceptable character"),
        (b"a: &a [x, x]\nwheelbase: *a", "found an alias"),
        pytest.param(b"[" * 500, "expected parameters in yaml", id="nested"),
        (None, "No such file or directory"),
    ],
)
def test_a_file_that_is_no_profile(tmp_path, data, expected):
    path = tmp_path / "mine.yaml"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(ParameterError) as error:
        read_profile(str(path))
    assert str(error.value).startswith(f"{path}: ") and expected in str(error.value)


def test_a_profile_without_a_key_is_the_ideal_car(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("# nothing yet\n")
    assert car_from(Parameters(read_profile(str(path)), "~")) == Car()


values = st.sampled_from(
    [0, -1, 1, 0.3, 1e-45, 1e30, 10**400, math.nan, math.inf, -math.inf]
    + [True, None, "", "1", [1.0], {"a": 1}]
)
keys = st.sampled_from(sorted(PROFILES["ideal"]))
bytes_of_a_profile = st.binary(max_size=60) | st.lists(
    st.builds("{}: {}".format, keys, values), max_size=4
).map(lambda lines: "\n".join(lines).encode())


@given(st.dictionaries(keys, values, max_size=3))
def test_any_parameters_are_a_car_or_refused(values):
    check_car(values)


@given(bytes_of_a_profile)
def test_any_bytes_are_a_profile_or_refused(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("any") / "mine.yaml"
    path.write_bytes(data)
    try:
        values = read_profile(str(path))
    except ParameterError as error:
        assert "; expected" in str(error)
        return
    check_car(values)


def check_car(values):
    """See that parameters either are refused in words, or make a car that stays somewhere."""
    try:
        car = car_from(Parameters(values, "~"))
    except ParameterError as error:
        assert "; expected" in str(error)
        return
    driven = apply(at_rest(0, Pose(0.0, 0.0, 0.0)), Command(0, 1.0, 0.3), car)
    state = advance(driven, SECOND, car)
    assert all(map(math.isfinite, (*state.pose, *state.wheel_angles, *state.odom_pose)))
