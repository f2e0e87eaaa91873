"""Drive a plan with thousands of cars at once, each with errors of its own: the spread of a plan.

There are two independent ways to the spread. `drive` draws the errors and drives the cars, in
blocks of ticks by cars that fit into a processor's cache. `moments` gives mean and covariance in
closed form, for cars without ramps.

A tick is what one command of path_publisher covers: 0.1 s, or what is left of the row.
"""

import math
import time
from typing import Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.plan.model import Plan
from mushr_ros_intro.sim.stamps import COMMAND_PERIOD, NANOSECONDS

PERIOD = COMMAND_PERIOD
"""How long a tick is [ns], but for the last one of a row."""

WIDTH = 1024
"""How many cars are driven at a time."""

_BLOCK = 16 * WIDTH  # car-ticks; an array of them is 128 KiB, and a processor's cache holds several
_LIMITED_BLOCK = 4 * WIDTH  # likewise, where ramps need three times as many arrays

CLOUD = 5000
"""Of so many cars at most the final pose is kept."""

_TINY = 1e-250  # makes 0 / 0 the limit that is meant, and changes no other number
_TAU = 2.0 * math.pi
_AT_ONCE = 1e200  # as good as infinity, but finite when multiplied by zero


class Errors(NamedTuple):
    """How far a car is from what it should be: standard deviations of normal distributions.

    The first four are drawn once a run, the last two anew for each tick in which the car is to
    drive. They come on top of the command after the car's limits have cut it.
    """

    speed_scale: float = 0.0
    """Of the speed, as a part of it."""
    steering_offset: float = 0.0
    """Of the steering angle [rad]."""
    start_position: float = 0.0
    """Of x and of y where the car is placed [m]."""
    start_heading: float = 0.0
    """Of theta where the car is placed [rad]."""
    speed: float = 0.0
    """Of the speed, in each tick [m/s]."""
    steering_angle: float = 0.0
    """Of the steering angle, in each tick [rad]."""


class Tick(NamedTuple):
    """A command and how long it holds."""

    duration: int
    """[ns]"""
    speed: float
    """[m/s]"""
    steering_angle: float
    """[rad]"""


def ticks(plan: Plan, car: Car) -> Iterator[Tick]:
    """Yield the commands of a plan as the car gets them, float32 and within its limits."""
    for row in plan.rows:
        speed, angle = car.within_limits(row.speed, row.steering_angle)
        tick = Tick(PERIOD, speed, angle)
        count, rest = divmod(row.duration, PERIOD)
        for _ in range(count):
            yield tick
        if rest:
            yield Tick(rest, speed, angle)


def count_ticks(plan: Plan) -> int:
    """Return how many ticks a plan has."""
    return sum(-(-row.duration // PERIOD) for row in plan.rows)


def instants(plan: Plan, every: int) -> List[int]:
    """Return when `every`-th tick ends, and the last one [ns], counted from the plan's start."""
    result = []
    now = number = 0
    for row in plan.rows:
        for begin in range(0, row.duration, PERIOD):
            number += 1
            if number % every == 0:
                result.append(now + min(begin + PERIOD, row.duration))
        now += row.duration
    if number % every:
        result.append(now)
    return result


# The sampler ------------------------------------------------------------------------------------


def drive(
    plan: Plan, car: Car, errors: Errors, runs: int, seed: int, every: int
) -> Iterator[np.ndarray]:
    """Drive a plan `runs` times and yield the poses, WIDTH cars at a time.

    What a car does depends on the seed and on its number, and for the last up to WIDTH cars on
    `runs` too, but not on `every`. A car with ramps rolls out after the plan's end, and its last
    pose is where it comes to rest.

    Args:
        plan: to be driven.
        car: that drives it.
        errors: of each run.
        runs: how many.
        seed: of the random numbers, not negative.
        every: after so many ticks the poses are noted, and in the end.

    Yields:
        Arrays (instants, cars, 3) of x [m], y [m] and theta [rad] in the map frame; the instants
        are those of `instants`.
    """
    for first in range(0, runs, WIDTH):
        count = min(WIDTH, runs - first)
        rng = np.random.Generator(np.random.SFC64(np.random.SeedSequence((seed, first // WIDTH))))
        yield _drive_block(plan, car, errors, count, rng, every)


def _drive_block(
    plan: Plan, car: Car, errors: Errors, count: int, rng: np.random.Generator, every: int
) -> np.ndarray:
    """Drive `count` cars; see `drive`."""
    per_run = rng.standard_normal((5, count))
    scale = 1.0 + errors.speed_scale * per_run[0]
    offset = errors.steering_offset * per_run[1]
    pose = np.array(plan.start)[:, np.newaxis] + per_run[2:] * np.array(
        [[errors.start_position], [errors.start_position], [errors.start_heading]]
    )
    has_ramps = not (math.isinf(car.acceleration) and math.isinf(car.steering_rate))
    fleet = _Limited(car, count) if has_ramps else _Fleet(car, count)
    is_noisy = errors.speed != 0.0 or errors.steering_angle != 0.0

    noted = []
    block: List[Tick] = []
    total = count_ticks(plan)
    for number, tick in enumerate(ticks(plan, car), 1):
        block.append(tick)
        is_noted = number % every == 0 or number == total
        if len(block) < fleet.most and not is_noted:
            continue
        durations, speed, angle = np.array(block).T[..., np.newaxis]
        speeds, angles = fleet.commands(len(block))
        if is_noisy:
            fleet.draw(rng, speeds, angles)
            speeds *= errors.speed * (speed != 0.0)
            angles *= errors.steering_angle * (speed != 0.0)
        else:
            speeds.fill(0.0)
            angles.fill(0.0)
        speeds += np.multiply(speed, scale, out=fleet.array(2, len(block)))
        angles += angle
        angles += offset
        fleet.drive(pose, durations / NANOSECONDS, speeds, angles)
        block = []
        if number == total:
            fleet.stop(pose, offset)
        if is_noted:
            noted.append(pose.T.copy())
    return np.array(noted)


class _Fleet:
    """Cars that obey at once, and the arrays in which they are driven.

    All arrays are (ticks, cars), and used again and again: they stay in the processor's cache.
    """

    BLOCK = 16 * WIDTH
    ARRAYS = 6

    def __init__(self, car: Car, count: int):
        self._car = car
        self._count = count
        self.most = max(1, self.BLOCK // count)
        """How many ticks fit into the arrays."""
        self._flat = np.empty((self.ARRAYS, (self.most + 1) * count))

    def array(self, index: int, length: int) -> np.ndarray:
        """Return one of the arrays, cut down to `length` ticks."""
        return self._flat[index, : length * self._count].reshape(length, self._count)

    def commands(self, length: int) -> Tuple[np.ndarray, np.ndarray]:
        """Return the arrays for the speeds [m/s] and steering angles [rad] of `length` ticks."""
        return self.array(0, length), self.array(1, length)

    def draw(self, rng: np.random.Generator, one: np.ndarray, other: np.ndarray) -> None:
        """Fill two arrays with independent standard normal numbers (Box and Muller, 1958)."""
        length = len(one)
        uniform = self._flat[2:4].reshape(-1)[: 2 * one.size].reshape(length, 2, self._count)
        rng.random(out=uniform)  # tick by tick, so that no number depends on the blocks
        radius = np.subtract(1.0, uniform[:, 0], out=self.array(4, length))
        np.log(radius, out=radius)
        radius *= -2.0
        np.sqrt(radius, out=radius)
        angle = np.multiply(uniform[:, 1], 2.0 * math.pi, out=other)
        np.cos(angle, out=one)
        one *= radius
        np.sin(angle, out=other)
        other *= radius

    def drive(
        self, pose: np.ndarray, seconds: np.ndarray, speeds: np.ndarray, angles: np.ndarray
    ) -> None:
        """Drive a block of ticks; overwrites `speeds` and `angles`.

        Args:
            pose: x, y and theta of the cars, (3, cars); moved on in place.
            seconds: how long the ticks last [s], (ticks, 1).
            speeds: of each car in each tick [m/s].
            angles: steering angles likewise [rad].
        """
        speeds *= seconds
        self._arc(speeds, angles, self.array(2, len(speeds)))
        self._move(pose, speeds, self.array(2, len(speeds)), angles)

    def stop(self, pose: np.ndarray, offset: np.ndarray) -> None:
        """Let the cars stop, which these do at once."""

    def _arc(self, distance: np.ndarray, angle: np.ndarray, left: np.ndarray) -> None:
        """Turn distances [m] and steering angles [rad] into where arcs lead.

        Args:
            distance: becomes how far ahead the end is [m].
            angle: becomes the angle turned [rad].
            left: becomes how far to the left the end is [m].
        """
        np.tan(angle, out=angle)
        angle *= 0.5 / self._car.wheelbase
        angle *= distance
        half_turn = angle
        # The chord, sin(h) / h of the distance, where 0 / 0 becomes the limit that is meant.
        half_turn += _TINY
        distance /= half_turn
        np.sin(half_turn, out=left)
        distance *= left
        left -= _TINY
        left *= distance
        distance *= np.cos(half_turn, out=self.array(3, len(angle)))
        angle -= _TINY
        angle *= 2.0

    def _move(
        self, pose: np.ndarray, ahead: np.ndarray, left: np.ndarray, turn: np.ndarray
    ) -> None:
        """Join the ways of the ticks to one, and move the poses on.

        Args:
            pose: (3, cars), moved on in place.
            ahead: [m], as seen from where a tick begins; overwritten.
            left: [m], likewise.
            turn: [rad], likewise.
        """
        length = len(turn)
        heading = self.array(3, length + 1)
        heading[0] = pose[2]
        for tick in range(length):
            np.add(heading[tick], turn[tick], out=heading[tick + 1])
        pose[2] = heading[-1]
        heading = heading[:-1]
        cos = np.cos(heading, out=self.array(4, length))
        sin = np.sin(heading, out=heading)
        product = np.multiply(ahead, cos, out=turn)
        product -= np.multiply(left, sin, out=self.array(5, length))
        pose[0] += product.sum(axis=0)
        ahead *= sin
        left *= cos
        ahead += left
        pose[1] += ahead.sum(axis=0)


class _Limited(_Fleet):
    """Cars that take their time, with speed and steering angle as ramps.

    A tick is cut where a ramp ends, so it has at most three pieces: in the first both may change,
    in the second the steering angle alone, and in the last the steering angle stands still and the
    way is an arc. In the others the way is a Gauss-Legendre collocation, which is no more than
    quadrature here, because the turn rate does not depend on the pose (Hairer, Norsett, Wanner,
    "Solving Ordinary Differential Equations I", section II.7).
    """

    def __init__(self, car: Car, count: int, points: int = 4):
        super().__init__(car, count)
        # Once a large array has been freed, the C library keeps the memory of smaller ones; if it
        # gave that back each time, fetching it again would take as long as the arithmetic.
        np.empty(2_000_000)
        self._acceleration, self._steering_rate = (
            min(each, _AT_ONCE) for each in (car.acceleration, car.steering_rate)
        )
        self._speed = np.zeros(count)
        self._angle = np.zeros(count)
        nodes, weights = np.polynomial.legendre.leggauss(points)
        self._nodes, self._weights = 0.5 * (nodes + 1.0), 0.5 * weights
        powers = np.arange(points)
        # From 0 to each node, the integral of the polynomial through given values at the nodes.
        integrals = self._nodes[:, np.newaxis] ** (powers + 1) / (powers + 1)
        self._to_nodes = integrals @ np.linalg.inv(self._nodes[:, np.newaxis] ** powers)

    def drive(
        self, pose: np.ndarray, seconds: np.ndarray, speeds: np.ndarray, angles: np.ndarray
    ) -> None:
        """Drive a block of ticks; see the base class."""
        speed = self._ramp(self._speed, speeds, self._acceleration * seconds[:, 0])
        angle = self._ramp(self._angle, angles, self._steering_rate * seconds[:, 0])
        self._speed, self._angle = speed[-1].copy(), angle[-1].copy()
        self._move(pose, *self.way(seconds, speed, angle))

    def way(
        self, seconds: np.ndarray, speed: np.ndarray, angle: np.ndarray
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return how far ahead [m] and to the left [m] ticks lead, and how far they turn [rad].

        Args:
            seconds: how long they last [s], (ticks, 1).
            speed: where they begin, and where the last one ends [m/s], (ticks + 1, cars).
            angle: the steering angle there [rad].

        Returns:
            Three arrays (ticks, cars).
        """
        acceleration, steering_rate = self._acceleration, self._steering_rate
        speed_change, angle_change = speed[1:] - speed[:-1], angle[1:] - angle[:-1]
        speed_ramp = np.abs(speed_change) / acceleration  # [s], how long it lasts
        angle_ramp = np.minimum(np.abs(angle_change) / steering_rate, seconds)
        first = np.minimum(speed_ramp, angle_ramp)
        # How much of each change the first piece makes, where 0 / 0 is nothing.
        speed_change *= first / (speed_ramp + _TINY)
        angle_change *= first / (angle_ramp + _TINY)
        between = angle[:-1] + angle_change

        way = self._collocate(first, speed[:-1], angle[:-1], between, speed_change)
        # Few ticks have a second piece, unless the command changes: leave out the others.
        second = angle_ramp - first
        some = np.flatnonzero(second)
        parts = tuple(each.take(some) for each in way)
        _append(
            parts,
            self._collocate(*(each.take(some) for each in (second, speed[1:], between, angle[1:]))),
        )
        for each, part in zip(way, parts):
            each.put(some, part)
        # What is left of the speed's ramp in the last piece makes the way shorter, or longer.
        distance = (seconds - angle_ramp) * speed[1:]
        missing = speed[1:] - speed[:-1] - speed_change
        missing *= np.maximum(speed_ramp - first, 0.0)
        distance -= 0.5 * missing
        arc_turn = angle[1:].copy()
        arc_left = np.empty_like(distance)
        self._arc(distance, arc_turn, arc_left)
        _append(way, (distance, arc_left, arc_turn))
        return way

    def stop(self, pose: np.ndarray, offset: np.ndarray) -> None:
        """Let the cars roll out, each until it stands."""
        longest = float(np.abs(self._speed).max()) / self._acceleration
        standing = np.zeros((1, self._count))
        self.drive(pose, np.array([[longest]]), standing, offset[np.newaxis].copy())

    @staticmethod
    def _ramp(begin: np.ndarray, targets: np.ndarray, most: np.ndarray) -> np.ndarray:
        """Return where each tick of a ramp begins, and where the last one ends.

        Args:
            begin: where the first one begins, (cars,).
            targets: to which each tick leads, (ticks, cars).
            most: the largest change in each tick, (ticks,).
        """
        values = np.empty((len(targets) + 1, len(begin)))
        values[0] = begin
        for tick, target in enumerate(targets):
            change = target - values[tick]
            np.minimum(change, most[tick], out=change)
            np.maximum(change, -most[tick], out=change)
            np.add(values[tick], change, out=values[tick + 1])
        return values

    def _collocate(
        self,
        seconds: np.ndarray,
        speed: np.ndarray,
        angle: np.ndarray,
        angle_end: np.ndarray,
        speed_change: Optional[np.ndarray] = None,
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return how far ahead [m] and left [m] pieces lead, and how far they turn [rad].

        Args:
            seconds: how long they last [s].
            speed: at their begin [m/s].
            angle: steering angle at their begin [rad].
            angle_end: and at their end.
            speed_change: of the speed, until their end [m/s]; None for none.
        """
        angle_change = angle_end - angle
        ways, turns = [], []
        for node in self._nodes:
            way = speed if speed_change is None else speed_change * node + speed
            way = way * seconds
            turn = np.tan(angle_change * node + angle)
            turn *= way
            turn *= 1.0 / self._car.wheelbase
            ways.append(way)
            turns.append(turn)
        ahead, left, turned = (np.zeros_like(seconds) for _ in range(3))
        for way, weight, turn, row in zip(ways, self._weights, turns, self._to_nodes):
            heading = turns[0] * row[0]
            for part, other in zip(row[1:], turns[1:]):
                heading += other * part
            way = way * weight
            ahead += way * np.cos(heading)
            left += way * np.sin(heading)
            turned += turn * weight
        return ahead, left, turned


def _append(way: Sequence[np.ndarray], more: Sequence[np.ndarray]) -> None:
    """Append a way to another, in place: how far it leads ahead and to the left, and turns."""
    ahead, left, turn = way
    cos, sin = np.cos(turn), np.sin(turn)
    ahead += cos * more[0] - sin * more[1]
    left += sin * more[0] + cos * more[1]
    turn += more[2]


def car_ticks_per_second(plan: Plan, car: Car, errors: Errors, runs: int) -> float:
    """Return how many ticks of how many cars `drive` makes in a second of this machine's time."""
    begin = time.process_time()
    for _ in drive(plan, car, errors, runs, 0, count_ticks(plan)):
        pass
    return runs * count_ticks(plan) / (time.process_time() - begin)


# The single car ---------------------------------------------------------------------------------


class Track(NamedTuple):
    """Where a car without errors is where each of a sequence of commands begins and ends."""

    instants: np.ndarray
    """When the commands begin, and when the last one ends [ns], (commands + 1,)."""
    poses: np.ndarray
    """x [m], y [m] and theta [rad] then, in the map frame, (commands + 1, 3)."""
    speeds: np.ndarray
    """The speed then [m/s], (commands + 1,); a car that obeys at once has that of the past."""
    angles: np.ndarray
    """The steering angle then [rad], likewise."""
    distances: np.ndarray
    """How far the car drives during each command, forward or in reverse [m], (commands,)."""


def commands(plan: Plan, car: Car) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return each row of a plan as a car gets it, float32 and within its limits.

    Returns:
        Durations [ns], speeds [m/s] and steering angles [rad], (rows,).
    """
    durations = np.array([row.duration for row in plan.rows], np.int64)
    speeds = np.array([row.speed for row in plan.rows])
    angles = np.array([row.steering_angle for row in plan.rows])
    np.clip(speeds, -car.speed_limit, car.speed_limit, out=speeds)
    np.clip(angles, -car.steering_limit_right, car.steering_limit_left, out=angles)
    return durations, speeds, angles


def follow(
    start: Sequence[float],
    durations: np.ndarray,
    speeds: np.ndarray,
    angles: np.ndarray,
    car: Car,
) -> Track:
    """Drive one car, without errors, through commands that may last as long as one likes.

    This is for plans of a million rows. It agrees with car.py to less than a nanometre a ramp.

    Args:
        start: x [m], y [m] and theta [rad]; the car is at rest there.
        durations: of the commands [ns], (commands,).
        speeds: within the car's limits [m/s], likewise.
        angles: steering angles within the car's limits [rad], likewise.
        car: that drives them.
    """
    instants = np.zeros(len(durations) + 1, np.int64)
    np.cumsum(durations, out=instants[1:])
    seconds = durations / NANOSECONDS
    speeds = _single_ramp(speeds, min(car.acceleration, _AT_ONCE) * seconds)
    angles = _single_ramp(angles, min(car.steering_rate, _AT_ONCE) * seconds)
    fleet = _Limited(car, 1, points=8)
    poses = np.empty((len(durations) + 1, 3))
    poses[0] = start
    for first in range(0, len(durations), fleet.most):
        end = min(first + fleet.most, len(durations))
        columns = seconds[first:end], speeds[first : end + 1], angles[first : end + 1]
        ahead, left, turn = fleet.way(*(each[:, np.newaxis] for each in columns))
        steps = np.concatenate((poses[first : first + 1, 2], turn[:, 0])).cumsum()
        poses[first + 1 : end + 1, 2] = steps[1:]
        cos, sin = np.cos(steps[:-1]), np.sin(steps[:-1])
        poses[first + 1 : end + 1, 0] = cos * ahead[:, 0] - sin * left[:, 0]
        poses[first + 1 : end + 1, 1] = sin * ahead[:, 0] + cos * left[:, 0]
        np.cumsum(poses[first : end + 1, :2], axis=0, out=poses[first : end + 1, :2])
    before, after = speeds[:-1], speeds[1:]
    acceleration = min(car.acceleration, _AT_ONCE)
    ramp = np.abs(after - before) / acceleration
    there_and_back = 0.5 * (before**2 + after**2) / acceleration
    distances = np.where(before * after < 0.0, there_and_back, 0.5 * np.abs(before + after) * ramp)
    distances += np.abs(after) * np.maximum(seconds - ramp, 0.0)
    return Track(instants, poses, speeds, angles, distances)


def _single_ramp(targets: np.ndarray, most: np.ndarray) -> np.ndarray:
    """Return where each part of a ramp from zero begins, and where the last one ends."""
    values = [0.0]
    value = 0.0
    for target, change in zip(targets.tolist(), most.tolist()):
        value = max(value - change, min(value + change, target))
        values.append(value)
    return np.array(values)


# What comes out ---------------------------------------------------------------------------------


class Spread(NamedTuple):
    """Where many cars are at some instants of a plan."""

    runs: int
    """How many cars there were; 0 if they were not counted but calculated."""
    mean: np.ndarray
    """Of x [m], y [m] and theta [rad] at each instant, (instants, 3)."""
    covariance: np.ndarray
    """Of the same, (instants, 3, 3)."""
    cloud: np.ndarray
    """The final poses of the first CLOUD cars at most, (cars, 3)."""


def spread(plan: Plan, car: Car, errors: Errors, runs: int, seed: int, every: int) -> Spread:
    """Drive a plan `runs` times, 2 at least, and return mean and covariance; see `drive`."""
    count = 0
    mean = squares = np.zeros(0)
    cloud: List[np.ndarray] = []
    for poses in drive(plan, car, errors, runs, seed, every):
        if count < CLOUD:
            cloud.append(poses[-1, : CLOUD - count])
        # The sums of squares of two samples, joined (Chan, Golub, LeVeque, 1979).
        more = poses.shape[1]
        more_mean = poses.mean(axis=1)
        deviations = poses - more_mean[:, np.newaxis]
        more_squares = np.matmul(deviations.transpose(0, 2, 1), deviations)
        if count:
            apart = more_mean - mean
            mean = mean + apart * (more / (count + more))
            between = apart[:, :, np.newaxis] * apart[:, np.newaxis, :]
            squares = squares + more_squares + between * (count * more / (count + more))
        else:
            mean, squares = more_mean, more_squares
        count += more
    return Spread(count, mean, squares / (count - 1), np.concatenate(cloud))


def ellipse(covariance: np.ndarray, probability: float = 0.95) -> Tuple[float, float, float]:
    """Return the ellipse round the mean in which a normal point in the plane lies.

    Args:
        covariance: of x and y [m^2], (2, 2) or the larger one of a pose.
        probability: that the point lies in it.

    Returns:
        Half the longer and half the shorter axis [m], and the direction of the longer one [rad].
    """
    (xx, xy), (_, yy) = covariance[:2, :2].tolist()
    middle, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    scale = -2.0 * math.log1p(-probability)  # chi-square with two degrees of freedom
    major = math.sqrt(scale * (middle + half))
    minor = math.sqrt(scale * max(middle - half, 0.0))
    return major, minor, 0.5 * math.atan2(2.0 * xy, xx - yy)


# The closed form --------------------------------------------------------------------------------


class _Way(NamedTuple):
    """Mean and covariance of a random way, as seen from where it begins.

    It leads to the complex number c = ahead + i left [m] and turns by d [rad], with e = exp(i d).
    Each is an array over the nodes of a quadrature. What is centred has its mean subtracted.
    """

    c: np.ndarray
    """The mean of c."""
    e: np.ndarray
    """The mean of e."""
    d: np.ndarray
    """The mean of d."""
    cc: np.ndarray
    """The mean of c c, centred."""
    cC: np.ndarray  # noqa: N815, a capital is a conjugate
    """The mean of c and its conjugate, centred."""
    ce: np.ndarray
    """The mean of c e, centred."""
    Ce: np.ndarray
    """The mean of the conjugate of c, and e, centred."""
    ee: np.ndarray
    """The mean of e e, centred."""
    eE: np.ndarray  # noqa: N815
    """The mean of e and its conjugate, centred: 1 - |<e>|^2 without the cancellation."""
    dc: np.ndarray
    """The mean of d c, centred."""
    de: np.ndarray
    """The mean of d e, centred."""
    dd: np.ndarray
    """The variance of d."""


def _join(one: _Way, two: _Way) -> _Way:
    """Return the way that leads along one way and then along another, independent one.

    c = c1 + e1 c2, e = e1 e2 and d = d1 + d2; so the centred parts are c~1 + e~1 <c2> + e1 c~2 and
    e~1 <e2> + e1 e~2, where the last terms are not correlated with the others.
    """
    square = one.ee + one.e * one.e  # the mean of e1 e1; that of e1 and its conjugate is 1
    C2 = two.c.conjugate()  # noqa: N806
    return _Way(
        c=one.c + one.e * two.c,
        e=one.e * two.e,
        d=one.d + two.d,
        cc=one.cc + 2.0 * one.ce * two.c + one.ee * two.c * two.c + square * two.cc,
        cC=one.cC + 2.0 * (one.Ce * two.c).real + one.eE * abs(two.c) ** 2 + two.cC,
        ce=(one.ce + one.ee * two.c) * two.e + square * two.ce,
        Ce=(one.Ce + one.eE * C2) * two.e + two.Ce,
        ee=one.ee * two.e * two.e + square * two.ee,
        eE=one.eE * abs(two.e) ** 2 + two.eE,
        dc=one.dc + one.de * two.c + one.e * two.dc,
        de=one.de * two.e + one.e * two.de,
        dd=one.dd + two.dd,
    )


def moments(plan: Plan, car: Car, errors: Errors, every: int) -> Spread:
    """Return mean and covariance in closed form, for a car without ramps.

    A tick's errors are independent of what was before. So the moments of ways that follow one
    another obey a linear recursion, and n equal ticks are joined in log n steps. The errors of a
    whole run are integrated by Gauss-Hermite quadrature.

    Args:
        plan: to be driven.
        car: that drives it; its ramps are left out of account.
        errors: of each run; steering angles beyond a right angle must be out of their reach.
        every: after so many ticks the moments are noted, and in the end; see `instants`.

    Returns:
        The spread, without a cloud.
    """
    commands = list(_grouped(ticks(plan, car), every))
    turned = max((abs(tick.steering_angle) for tick, _, _ in commands), default=0.0)
    length = sum(abs(tick.speed) * tick.duration * times for tick, times, _ in commands)
    bend = length / NANOSECONDS / (car.wheelbase * math.cos(turned) ** 2)
    scales, scale_weights = _hermite(errors.speed_scale, bend * turned * errors.speed_scale)
    offsets, offset_weights = _hermite(errors.steering_offset, bend * errors.steering_offset)
    scale = 1.0 + np.repeat(scales, len(offsets))
    offset = np.tile(offsets, len(scales))
    weights = np.outer(scale_weights, offset_weights).ravel()

    x, y, theta = plan.start
    variance = errors.start_heading**2
    zero = np.zeros(scale.shape)
    e = _cis(zero + theta) * math.exp(-0.5 * variance)
    way = _Way(
        c=zero + complex(x, y),
        e=e,
        d=zero + theta,
        cc=zero,
        cC=zero + 2.0 * errors.start_position**2,
        ce=zero,
        Ce=zero,
        ee=e * e * math.expm1(-variance),
        eE=zero - math.expm1(-variance),
        dc=zero,
        de=1j * variance * e,
        dd=zero + variance,
    )
    known: Dict[Tuple[Tick, int], _Way] = {}
    noted = []
    for tick, times, is_noted in commands:
        if (tick, times) not in known:
            if len(known) > 1000:
                known.clear()
            known[tick, times] = _power(_tick_way(tick, car, errors, scale, offset), times)
        way = _join(way, known[tick, times])
        if is_noted:
            noted.append(_over_nodes(way, weights))
    mean, covariance = (np.array(each) for each in zip(*noted))
    return Spread(0, mean, covariance, np.empty((0, 3)))


def _grouped(all_ticks: Iterator[Tick], every: int) -> Iterator[Tuple[Tick, int, bool]]:
    """Yield equal ticks that follow one another as one, with their number.

    The last item says whether the poses are noted after them.
    """
    tick, times = None, 0
    for number, following in enumerate(all_ticks):
        is_noted = number > 0 and number % every == 0
        if tick is not None and (is_noted or following != tick):
            yield tick, times, is_noted
            times = 0
        tick = following
        times += 1
    if tick is not None:
        yield tick, times, True


def _hermite(deviation: float, phase: float) -> Tuple[np.ndarray, np.ndarray]:
    """Return nodes and weights that integrate over a normal distribution.

    Args:
        deviation: the standard deviation.
        phase: by what angle [rad] one standard deviation turns the car.

    Returns:
        As many as integrate the cosine of twice the phase to about 1e-12, but 200 at most.
    """
    if deviation == 0.0:
        return np.zeros(1), np.ones(1)
    nodes, weights = np.polynomial.hermite_e.hermegauss(
        min(8 + round(6.0 * phase**2 + 4.0 * phase), 200)
    )
    return nodes * deviation, weights / math.sqrt(2.0 * math.pi)


def _tick_way(tick: Tick, car: Car, errors: Errors, scale: np.ndarray, offset: np.ndarray) -> _Way:
    """Return the moments of one tick, for each node of the errors of a run."""
    seconds = tick.duration / NANOSECONDS
    is_driving = tick.speed != 0.0
    speeds, speed_weights = _hermite(errors.speed * is_driving, 0.0)
    angles, angle_weights = _hermite(errors.steering_angle * is_driving, 0.0)
    weights = np.outer(speed_weights, angle_weights).ravel()
    speed = (tick.speed * scale)[:, np.newaxis] + np.repeat(speeds, len(angles))
    angle = (tick.steering_angle + offset)[:, np.newaxis] + np.tile(angles, len(speeds))
    half_turn = 0.5 * seconds * speed * np.tan(angle) / car.wheelbase + _TINY
    d = 2.0 * half_turn
    c = seconds * speed * np.sin(half_turn) / half_turn * _cis(half_turn)
    e = _cis(d)

    def mean(values: np.ndarray) -> np.ndarray:
        return (values * weights).sum(axis=1)

    means = mean(c), mean(e), mean(d)
    c, e, d = (each - part[:, np.newaxis] for each, part in zip((c, e, d), means))
    conjugate = c.conjugate()
    return _Way(
        *means,
        cc=mean(c * c),
        cC=mean((c * conjugate).real),
        ce=mean(c * e),
        Ce=mean(conjugate * e),
        ee=mean(e * e),
        eE=mean((e * e.conjugate()).real),
        dc=mean(d * c),
        de=mean(d * e),
        dd=mean(d * d),
    )


def _cis(angle: np.ndarray) -> np.ndarray:
    """Return exp(i `angle`)."""
    return np.cos(angle) + 1j * np.sin(angle)


def _power(way: _Way, times: int) -> _Way:
    """Return a way repeated `times` times, 1 at least, each time with new errors."""
    result: Optional[_Way] = None
    while True:
        if times & 1:
            result = way if result is None else _join(result, way)
        times >>= 1
        if not times:
            assert result is not None
            return result
        way = _join(way, way)


def _over_nodes(way: _Way, weights: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Return mean (3,) and covariance (3, 3) of x, y and theta over the errors of a run."""
    means = np.stack((way.c.real, way.c.imag, way.d))
    mean = (means * weights).sum(axis=1)
    apart = means - mean[:, np.newaxis]
    xx, yy = 0.5 * (way.cC + way.cc.real), 0.5 * (way.cC - way.cc.real)
    xy, xt, yt = 0.5 * way.cc.imag, way.dc.real, way.dc.imag
    within = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, way.dd]])
    between = apart[:, np.newaxis] * apart
    return mean, ((within + between) * weights).sum(axis=2)
