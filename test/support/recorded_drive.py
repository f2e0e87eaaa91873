"""Drives of a simulated car with hidden parameters, as they would be recorded."""

from mushr_ros_intro.car.model import Command, at_rest
from mushr_ros_intro.car.motion import advance, apply
from mushr_ros_intro.comparison.drive_log import Received, drive_log
from mushr_ros_intro.stamps import COMMAND_PERIOD, NANOSECONDS, from_seconds
from support.cars import BEGIN

BEFORE = AFTER = 2 * NANOSECONDS
"""The recording begins before the first command and ends after the last one [ns]."""


def commands_of(plan):
    """Return the commands that path_publisher sends."""
    commands, now = [], BEGIN
    for row in plan.rows:
        end = now + row.duration
        stamps = range(now, end, COMMAND_PERIOD)
        commands += [Command(stamp, row.speed, row.steering_angle) for stamp in stamps]
        now = end
    return [*commands, Command(now, 0.0, 0.0)]


def poses_of(commands, start, car, rate):
    """Yield the stamp and the pose of a car at some instants; `rate` in Hz."""
    todo = list(commands)
    state = at_rest(BEGIN - BEFORE, start)
    now, end = BEGIN - BEFORE, commands[-1].stamp + AFTER
    while now < end:
        while todo and todo[0].stamp <= now:
            command = todo.pop(0)
            state = apply(advance(state, command.stamp, car), command, car)
        yield now, advance(state, now, car).pose
        now += round(NANOSECONDS / rate)


def received(plan, car, dice, rate=10.0, delay=0.05, position=0.02, heading=0.02):
    """Return the commands and the measured poses of a drive.

    Args:
        plan: what is driven.
        car: the true car.
        dice: a random.Random, for the errors of the measurement.
        rate: of the poses [Hz].
        delay: from a command to its effect on the pose [s].
        position: standard deviation of x and of y [m].
        heading: standard deviation of theta [rad].
    """
    commands = commands_of(plan)
    stamps, poses = [], []
    for stamp, (x, y, theta) in poses_of(commands, plan.start, car, rate):
        stamps.append(stamp + from_seconds(delay))
        poses.append((dice.gauss(x, position), dice.gauss(y, position), dice.gauss(theta, heading)))
    sent = [command.stamp for command in commands]
    values = [(command.speed, command.steering_angle) for command in commands]
    return Received("/commands", sent, sent, values), Received("/pose", stamps, stamps, poses)


def driven(plan, car, dice, **options):
    """Return the log of a drive; see `received`."""
    return drive_log("a.bag", *received(plan, car, dice, **options), car.command_timeout)
