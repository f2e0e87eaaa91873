"""Many cars at once: against the single car, against fine quadrature, and against the moments."""

import itertools
import math
import os
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.car.bicycle import Pose, drive_arc
from mushr_ros_intro.car.model import Car, Command, at_rest
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.plan.find import read_plan
from mushr_ros_intro.plan.model import as_float32
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.preview import ensemble, prediction
from mushr_ros_intro.preview.ensemble import Errors
from support.paths import PLANS

ROUNDING = 1e-12
"""[m, rad] Between one arc a row and one a tick, in doubles."""

ANALYTIC = 1e-9
"""[m^2, m, rad] What a short sum of squares is known to; the quadrature is good to 1e-12."""

RAMP = 1e-10
"""[m, rad] For each ramp, between car.py's quadrature and the finer one of a single car."""

PATH = 1e-8
"""[m, rad] Along the path of noisy ramps; a hundred times that was promised, and 2e-9 measured."""

SIGMAS = 5.0
"""Standard errors that a mean of random numbers may be off: by chance 1 in 2 million is."""

IDEAL = Car()
NANO = Car(
    wheelbase=0.3,
    speed_limit=0.9286,
    steering_limit_left=0.4375,
    steering_limit_right=0.4375,
    acceleration=2.5,
    steering_rate=3.2,
)
FAST = NANO._replace(wheelbase=0.33, speed_limit=6.6, steering_limit_right=0.26)

NOISE = Errors(speed=0.05, steering_angle=0.02)
ALL = Errors(0.02, 0.01, 0.05, 0.03, 0.05, 0.02)


def plan_named(name):
    return read_plan(os.path.join(PLANS, name + ".txt"))


def plan_of(*rows, start="0, 0, 0"):
    return parse_plan("\n".join((start, *rows)).encode(), "plan")


def drive(plan, errors, runs=1, seed=1, every=10**9, car=IDEAL):
    """Return the poses (instants, runs, 3)."""
    return np.concatenate(list(ensemble.drive(plan, car, errors, runs, seed, every)), axis=1)


# Without errors ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(entry[:-4] for entry in os.listdir(PLANS)))
def test_without_errors_every_car_ends_where_the_single_car_does(name):
    plan = plan_named(name)
    poses = drive(plan, Errors(), runs=ensemble.WIDTH + 3)
    assert poses.shape == (1, ensemble.WIDTH + 3, 3)
    expected = np.array(prediction.final_pose(plan, Car()))
    assert np.abs(poses[0] - expected).max() <= ROUNDING


@given(
    st.lists(
        st.tuples(
            st.floats(-5, 5), st.floats(-0.6, 0.6), st.sampled_from([0.05, 0.1, 0.25, 1, 3.14])
        ),
        min_size=1,
        max_size=6,
    ),
    st.integers(1, 20),
)
def test_on_the_way_the_cars_are_where_the_single_car_is(rows, every):
    plan = plan_of(*("{:.6f}, {:.6f}, {}".format(*row) for row in rows), start="1, 2, 3")
    poses = drive(plan, Errors(), every=every)[:, 0]
    instants = ensemble.instants(plan, every)
    assert len(instants) == len(poses)
    assert instants[-1] == plan.duration
    for instant, pose in zip(instants, poses):
        assert tuple(pose) == pytest.approx(pose_at(plan, instant), abs=ROUNDING)


def pose_at(plan, instant):
    """Return where the ideal car is, from row to row and a part of the last one."""
    pose = Pose(*plan.start)
    for row in plan.rows:
        seconds = min(row.duration, instant) / 1e9
        bend = math.tan(row.steering_angle) / 0.33
        pose = drive_arc(pose, row.speed * seconds, bend)
        instant -= min(row.duration, instant)
    return pose


@pytest.mark.parametrize("angle", [0.0, 1e-30, 1e-15, 1e-8, 0.0099, -0.0099])
def test_there_is_no_dead_band(angle):
    plan = plan_of(f"2, {angle}, 22")
    expected = np.array(prediction.final_pose(plan, Car()))
    assert np.abs(drive(plan, Errors())[0, 0] - expected).max() <= ROUNDING


def test_instants_end_ticks():
    plan = plan_of("1, 0, 0.25", "1, 0, 0.3")
    assert ensemble.count_ticks(plan) == 6
    milliseconds = [round(each / 1e6) for each in ensemble.instants(plan, 1)]
    assert milliseconds == [100, 200, 250, 350, 450, 550]
    assert [round(each / 1e6) for each in ensemble.instants(plan, 4)] == [350, 550]
    assert ensemble.instants(plan, 1000) == [plan.duration]


# The errors -------------------------------------------------------------------------------------


def test_the_seed_decides():
    plan = plan_named("slalom")
    poses = drive(plan, ALL, runs=50, seed=7)
    assert (poses == drive(plan, ALL, runs=50, seed=7)).all()
    assert (poses != drive(plan, ALL, runs=50, seed=8)).all()
    assert len(np.unique(poses[0, :, 0])) == 50


def test_what_a_car_does_does_not_depend_on_who_looks():
    plan = plan_named("slalom")
    seldom = drive(plan, ALL, runs=50, every=10**9)[-1]
    often = drive(plan, ALL, runs=50, every=3)[-1]
    assert np.abs(seldom - often).max() <= ROUNDING


def test_the_first_cars_are_the_same_however_many_there_are():
    plan = plan_named("slalom")
    few = drive(plan, ALL, runs=ensemble.WIDTH)
    many = drive(plan, ALL, runs=ensemble.WIDTH + 100)
    assert (many[:, : ensemble.WIDTH] == few).all()
    assert (many[:, ensemble.WIDTH :] != few[:, :100]).all()


def test_a_car_that_is_told_to_stand_stands():
    poses = drive(plan_of("0, 0.3, 5"), NOISE, runs=100)
    assert (poses == 0.0).all()


def test_a_car_that_is_told_to_stop_rolls_on_without_new_errors():
    slow = Car(acceleration=0.5)
    poses = drive(plan_of("2, 0, 1", "0, 0, 3"), NOISE, runs=100, every=10, car=slow)
    assert len(np.unique(poses[0, :, 2])) == 100
    assert (poses[:, :, 2] == poses[0, :, 2]).all()
    assert (np.diff(poses[:, :, 0], axis=0) >= 0.0).all()


def assert_is(values, mean, deviation):
    """Assert that random values have a mean and a standard deviation, within their errors."""
    count = len(values)
    assert abs(values.mean() - mean) <= SIGMAS * deviation / math.sqrt(count)
    assert abs(values.var() / deviation**2 - 1.0) <= SIGMAS * math.sqrt(2.0 / count)


@pytest.mark.parametrize(
    "errors, deviation",
    [
        (Errors(speed_scale=0.03), 0.03 * 20.0),
        (Errors(speed=0.1), 0.1 * 0.1 * math.sqrt(100)),
        (Errors(start_position=0.2), 0.2),
    ],
)
def test_straight_ahead_the_spread_is_known(errors, deviation):
    """100 ticks of 0.1 s at 2 m/s are 20 m."""
    plan = plan_of("2, 0, 10")
    x, y, theta = drive(plan, errors, runs=20_000)[0].T
    assert_is(x, 20.0, deviation)
    if errors.start_position:
        assert_is(y, 0.0, deviation)
        assert abs(np.corrcoef(x, y)[0, 1]) <= SIGMAS / math.sqrt(20_000)
    else:
        assert (y == 0.0).all()
    assert (theta == 0.0).all()


def test_the_steering_errors_turn_the_car():
    plan = plan_of("2, 0, 1")
    for errors, ticks in ((Errors(steering_offset=0.01), 1), (Errors(steering_angle=0.01), 10)):
        theta = drive(plan, errors, runs=20_000)[0, :, 2]
        deviation = 0.01 * 2.0 / 0.33 / math.sqrt(ticks)  # tan is its argument, to 1e-4 of it
        assert_is(theta, 0.0, deviation)
    theta = drive(plan, Errors(start_heading=0.2), runs=20_000)[0, :, 2]
    assert_is(theta, 0.0, 0.2)


def test_spread_is_mean_and_covariance():
    plan = plan_named("slalom")
    runs = 2 * ensemble.WIDTH + 17
    poses = drive(plan, ALL, runs=runs, seed=3, every=20)
    result = ensemble.spread(plan, Car(), ALL, runs, 3, 20)
    assert result.runs == runs
    assert (result.cloud == poses[-1]).all()
    for number, each in enumerate(poses):
        assert result.mean[number] == pytest.approx(each.mean(axis=0), abs=ROUNDING)
        assert result.covariance[number] == pytest.approx(np.cov(each.T), abs=ROUNDING)


def test_memory_does_not_grow_with_the_number_of_cars():
    plan = plan_of("1, 0.1, 0.3")
    peaks = []
    for runs in (20_000, 200_000):
        tracemalloc.start()
        result = ensemble.spread(plan, Car(), ALL, runs, 1, 1)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert len(result.cloud) == ensemble.CLOUD
    assert peaks[1] <= 1.1 * peaks[0]  # the Python objects of the moment come and go


# Ramps ------------------------------------------------------------------------------------------


def rolled_out(plan, car):
    """Return where car.py's car comes to rest, with a command every 0.1 s and a stop."""
    state, now = at_rest(0, Pose(*plan.start)), 0
    for tick in ensemble.ticks(plan, car):
        command = Command(now, tick.speed, tick.steering_angle)
        state = apply(advance(state, now, car), command, car)
        now += tick.duration
    state = apply(advance(state, now, car), Command(now, 0.0, 0.0), car)
    return advance(state, now + 10**11, car).pose


@pytest.mark.parametrize("car", [IDEAL, NANO, FAST, NANO._replace(steering_rate=math.inf)])
@pytest.mark.parametrize("name", sorted(entry[:-4] for entry in os.listdir(PLANS)))
def test_with_ramps_the_cars_come_to_rest_where_the_single_car_does(name, car):
    plan = plan_named(name)
    expected = np.array(rolled_out(plan, car))
    assert np.abs(drive(plan, Errors(), car=car)[-1, 0] - expected).max() <= PATH
    rows = ensemble.commands(plan, car)
    stop = (100 * 10**9, 0.0, 0.0)
    rows = [np.append(each, end) for each, end in zip(rows, stop)]
    track = ensemble.follow(plan.start, *rows, car)
    ramps = len(rows[0]) * 2
    assert np.abs(track.poses[-1] - expected).max() <= RAMP * ramps


def test_a_car_that_ends_in_reverse_rolls_out():
    plan, car = plan_of("-1, 0.1"), Car(acceleration=2.0)
    expected = np.array(rolled_out(plan, car))
    assert np.abs(drive(plan, Errors(), car=car)[-1, 0] - expected).max() <= PATH


def finely(car, commands):
    """Return the poses after commands (seconds, speed, angle), by quadrature in quadrature.

    Each stretch between the ends of ramps is cut in four, with 20 Gauss points for the way and
    as many again for the heading at each of them: good to 1e-13.
    """
    nodes, weights = np.polynomial.legendre.leggauss(20)
    nodes, weights = (nodes + 1.0) / 2.0, weights / 2.0
    speed = angle = x = y = theta = 0.0
    poses = []
    for seconds, aim, angle_aim in commands:
        ends = abs(aim - speed) / car.acceleration, abs(angle_aim - angle) / car.steering_rate
        ends = [min(end, seconds) for end in ends]
        rates = (
            math.copysign(car.acceleration, aim - speed),
            math.copysign(car.steering_rate, angle_aim - angle),
        )

        def speed_at(time, v=speed, a=rates[0], end=ends[0]):
            return v + a * np.minimum(time, end)

        def angle_at(time, delta=angle, rate=rates[1], end=ends[1]):
            return delta + rate * np.minimum(time, end)

        cuts = sorted({0.0, *ends, seconds})
        cuts = [np.linspace(low, high, 5) for low, high in zip(cuts, cuts[1:])]
        for low, high in ((a, b) for cut in cuts for a, b in zip(cut, cut[1:])):

            def turned(part, low=low, width=high - low):
                time = low + part * width * nodes
                rate = speed_at(time) * np.tan(angle_at(time)) / car.wheelbase
                return part * width * float(weights @ rate)

            headings = theta + np.array([turned(node) for node in nodes])
            ways = speed_at(low + (high - low) * nodes) * weights * (high - low)
            x += float(ways @ np.cos(headings))
            y += float(ways @ np.sin(headings))
            theta += turned(1.0)
        speed, angle = float(speed_at(seconds)), float(angle_at(seconds))
        poses.append((x, y, theta))
    return np.array(poses)


@pytest.mark.parametrize("car, speed", [(NANO, 0.9), (FAST, 6.0)])
def test_noisy_ramps_are_those_of_fine_quadrature(car, speed):
    """At every tick; most ramps end inside theirs, where the commands change some do not."""
    rng = np.random.Generator(np.random.SFC64(2))
    commands = []
    for _ in range(20):
        v, angle = rng.uniform(-speed, speed), rng.uniform(-0.25, 0.25)
        for seconds in (0.1, 0.1, 0.1, 0.1, 0.05):
            noise = rng.normal(0.0, (0.05, 0.02))
            commands.append((seconds, v + noise[0], angle + noise[1]))
    fleet, pose, poses = ensemble._Limited(car, 1), np.zeros((3, 1)), []
    for command in commands:
        fleet.drive(pose, *(np.array([[each]]) for each in command))
        poses.append(pose[:, 0].copy())
    assert np.abs(np.array(poses) - finely(car, commands)).max() <= PATH


def test_ramps_roll_out_on_the_straight_as_in_the_textbook():
    """From 0 to 0.9286 m/s at 2.5 m/s^2, then steady, then back: v^2 / 2a each way."""
    plan = plan_of("2, 0, 3")
    track = ensemble.follow(plan.start, *ensemble.commands(plan, NANO), NANO)
    expected = 0.9286 * 3 - 0.9286**2 / 2.5 / 2
    assert track.poses[-1, 0] == pytest.approx(expected, abs=RAMP)
    assert track.distances == pytest.approx([expected], abs=RAMP)
    poses = drive(plan, Errors(), runs=3, car=NANO)
    assert poses[-1, :, 0] == pytest.approx(0.9286 * 3, abs=RAMP)


def test_the_way_there_and_back_counts_twice():
    """1 m/s forward, then in reverse: the ramp leads through zero."""
    plan = plan_of("1, 0, 1", "-1, 0, 1")
    car = Car(acceleration=2.0)
    track = ensemble.follow(plan.start, *ensemble.commands(plan, car), car)
    assert track.distances == pytest.approx([0.75, 0.25 + 0.25], abs=RAMP)
    assert track.poses[:, 0] == pytest.approx([0.0, 0.75, 0.75 + 0.25 - 0.25], abs=RAMP)


def test_limits_cut_the_command_and_errors_come_on_top():
    plan = plan_of("9, 0.4, 2", "9, -0.4, 2")
    ticks = list(ensemble.ticks(plan, FAST))
    assert ticks[0][1:] == (6.6, as_float32(0.4))
    assert ticks[-1][1:] == (6.6, -0.26)
    durations, speeds, angles = ensemble.commands(plan, FAST)
    assert [*zip(speeds, angles)] == [ticks[0][1:], ticks[-1][1:]]
    assert durations.tolist() == [2 * 10**9] * 2
    ideal = FAST._replace(acceleration=math.inf, steering_rate=math.inf)
    x = drive(plan_of("9, 0, 2"), Errors(speed_scale=0.02), runs=20_000, car=ideal)[-1, :, 0]
    assert_is(x, 13.2, 0.02 * 13.2)


def test_a_mean_over_ramps_is_close_to_the_closed_form_without_them():
    """Where the ramps are steep they do not matter."""
    steep = Car(acceleration=1e6, steering_rate=1e6)
    plan = plan_named("slalom")
    poses = drive(plan, NOISE, runs=5000, car=steep)[-1]
    assert np.abs(poses - drive(plan, NOISE, runs=5000)[-1]).max() <= 1e-4  # [m, rad] 0.1 us late


# The moments ------------------------------------------------------------------------------------


def brute_force(plan, errors):
    """Return mean and covariance by quadrature over every random number of every tick at once."""
    ticks = list(ensemble.ticks(plan, Car()))
    deviations = [
        *(errors.speed_scale, errors.steering_offset, errors.start_heading),
        *([errors.speed, errors.steering_angle] * len(ticks)),
    ]
    axes, weights = [], []
    for deviation in deviations:
        node, weight = np.polynomial.hermite_e.hermegauss(7 if deviation else 1)
        axes.append(node * deviation)
        weights.append(weight / weight.sum())
    values = np.array(list(itertools.product(*axes)))
    weight = np.array([math.prod(each) for each in itertools.product(*weights)])
    scale, offset, heading = values[:, :3].T
    x, y, theta = plan.start[0] + 0 * scale, plan.start[1] + 0 * scale, plan.start[2] + heading
    for number, tick in enumerate(ticks):
        distance = tick.speed * (1 + scale) + values[:, 3 + 2 * number]
        distance = distance * tick.duration / 1e9
        angle = tick.steering_angle + offset + values[:, 4 + 2 * number]
        turn = distance * np.tan(angle) / 0.33
        x = x + distance * np.sinc(turn / math.tau) * np.cos(theta + turn / 2)
        y = y + distance * np.sinc(turn / math.tau) * np.sin(theta + turn / 2)
        theta = theta + turn
    poses = np.stack((x, y, theta))
    mean = (poses * weight).sum(axis=1)
    apart = poses - mean[:, np.newaxis]
    covariance = (apart * weight) @ apart.T
    covariance[[0, 1], [0, 1]] += errors.start_position**2
    return mean, covariance


@pytest.mark.parametrize(
    "errors",
    [
        Errors(speed=0.3, steering_angle=0.05),
        Errors(speed=0.3, start_heading=0.2, start_position=0.1),
        Errors(speed_scale=0.1, steering_offset=0.02, start_heading=0.2),
        Errors(steering_angle=0.05, steering_offset=0.02, start_position=0.3),
    ],
)
def test_moments_are_those_of_every_random_number_at_once(errors):
    plan = plan_of("3, 0.2, 0.1", "-2, -0.1, 0.15", start="1, 2, 0.5")
    mean, covariance = brute_force(plan, errors)
    result = ensemble.moments(plan, Car(), errors, 1000)
    assert result.mean[-1] == pytest.approx(mean, abs=ANALYTIC)
    assert result.covariance[-1] == pytest.approx(covariance, abs=ANALYTIC)


def test_moments_of_a_start_that_is_turned():
    """Straight ahead, with theta normal: <cos theta> is exp(-s^2 / 2), and so on."""
    s, way = 0.3, 10.0
    result = ensemble.moments(plan_of("2, 0, 5"), Car(), Errors(start_heading=s), 1000)
    cos = math.exp(-0.5 * s * s)
    assert result.mean[-1] == pytest.approx((way * cos, 0.0, 0.0), abs=ANALYTIC)
    cos_2 = math.exp(-2.0 * s * s)
    xx = way**2 * (0.5 + 0.5 * cos_2 - cos**2)
    yy = way**2 * (0.5 - 0.5 * cos_2)
    expected = [[xx, 0, 0], [0, yy, way * s * s * cos], [0, way * s * s * cos, s * s]]
    assert result.covariance[-1] == pytest.approx(np.array(expected), abs=ANALYTIC)


@pytest.mark.parametrize("row", ["2, 0, 60", "2, 1.0, 12", "2, 0, 120"])
def test_the_quadrature_has_nodes_enough_for_long_ways(row, monkeypatch):
    """On these a small offset turns the car by far; 180 nodes are more than enough."""
    plan, errors = plan_of(row), Errors(steering_offset=0.01)
    result = ensemble.moments(plan, Car(), errors, 10**9)

    def of_180_nodes(deviation, phase):
        if deviation == 0.0:
            return np.zeros(1), np.ones(1)
        nodes, weights = np.polynomial.hermite_e.hermegauss(180)
        return nodes * deviation, weights / math.sqrt(2.0 * math.pi)

    monkeypatch.setattr(ensemble, "_hermite", of_180_nodes)
    expected = ensemble.moments(plan, Car(), errors, 10**9)
    assert result.mean == pytest.approx(expected.mean, rel=1e-6, abs=1e-6)
    assert result.covariance == pytest.approx(expected.covariance, rel=1e-6, abs=1e-6)


def test_without_errors_the_moments_are_the_single_car():
    plan = plan_named("figure_8")
    result = ensemble.moments(plan, Car(), Errors(), 7)
    assert (result.covariance == 0.0).all()
    for instant, mean in zip(ensemble.instants(plan, 7), result.mean):
        assert tuple(mean) == pytest.approx(pose_at(plan, instant), abs=ROUNDING)


@pytest.mark.parametrize("errors", [NOISE, ALL])
@pytest.mark.parametrize("name", ["figure_8", "parallel_parking", "slalom"])
def test_the_sampler_agrees_with_the_moments(name, errors):
    """All along the plan, every entry of mean and covariance, within its standard error."""
    plan, every = plan_named(name), 7
    expected = ensemble.moments(plan, Car(), errors, every)
    poses = drive(plan, errors, runs=20_000, seed=1, every=every)
    assert len(poses) == len(expected.mean) == len(ensemble.instants(plan, every))
    deviations = poses - expected.mean[:, np.newaxis]
    products = deviations[..., :, np.newaxis] * deviations[..., np.newaxis, :]
    for values, mean in ((poses, expected.mean), (products, expected.covariance)):
        error = values.std(axis=1) / math.sqrt(20_000)
        assert (np.abs(values.mean(axis=1) - mean) <= SIGMAS * error + ROUNDING).all()


def test_ellipse():
    squared = -2.0 * math.log(0.05)
    major, minor, direction = ensemble.ellipse(np.diag([1.0, 9.0]))
    assert (major, minor) == pytest.approx((3.0 * squared**0.5, squared**0.5))
    assert abs(direction) == pytest.approx(0.5 * math.pi)
    major, minor, direction = ensemble.ellipse(np.array([[2.0, 1.0, 7], [1.0, 2.0, 7], [7, 7, 7]]))
    assert (major, minor) == pytest.approx(((3.0 * squared) ** 0.5, squared**0.5))
    assert direction == pytest.approx(0.25 * math.pi)
    assert ensemble.ellipse(np.zeros((2, 2))) == (0.0, 0.0, 0.0)


def test_an_ellipse_that_is_a_line():
    """Rounded, the shorter axis is the root of a number on either side of zero."""
    for number in range(1, 200):
        x, y = number / 7.0, number / 3.0
        covariance = np.array([[x * x, x * y], [x * y, y * y]])
        assert ensemble.ellipse(covariance)[1] == pytest.approx(0.0, abs=1e-5)


def test_of_all_cars_19_of_20_are_in_the_ellipse():
    covariance = np.array([[2.0, 0.8], [0.8, 1.0]])
    major, minor, direction = ensemble.ellipse(covariance)
    points = np.random.Generator(np.random.SFC64(1)).multivariate_normal((0, 0), covariance, 20_000)
    along = points @ (math.cos(direction), math.sin(direction))
    across = points @ (-math.sin(direction), math.cos(direction))
    inside = ((along / major) ** 2 + (across / minor) ** 2 <= 1.0).mean()
    assert abs(inside - 0.95) <= SIGMAS * math.sqrt(0.95 * 0.05 / 20_000)
