"""Check the driven and the predicted path of a replay, and their distance."""

import math

import numpy as np
import pytest

from mushr_ros_intro.car.history import History
from mushr_ros_intro.car.model import Car, Command, at_rest
from mushr_ros_intro.preview.prediction import rest
from mushr_ros_intro.replay.recording import drive, frechet_distance
from support.geometry import closed_form
from support.recorded import BEGIN, PLAN, ROWS, SECOND, START, judged, plan_of, replay

ROUNDING = 1e-9
"""[m, rad] Of the sums in a prediction."""
END = closed_form(START, ROWS)


def test_the_prediction_is_the_closed_form():
    path = drive(replay())
    assert path.times == pytest.approx(0.02 * np.arange(len(path.times)))
    assert path.times[-1] == pytest.approx(1.76)  # the first pose at rest
    assert path.driven == pytest.approx(path.predicted)
    for pose, wanted in ((path.predicted[0], START), (path.predicted[-1], END)):
        assert pose == pytest.approx(wanted, abs=ROUNDING)


def test_the_prediction_has_the_noise_of_the_car():
    """So a correct node ends where it is predicted to, and another node does not."""
    car = Car(speed_noise=0.1, steering_noise=0.1, seed=3)
    right = replay(car=car)
    history = History(car, at_rest(BEGIN - SECOND, PLAN.start))
    commands, poses = list(right.sent), []
    for stamp in right.stamps.tolist():
        while commands and commands[0].time <= stamp:
            time, _, *values = commands.pop(0)
            history.add(Command(time, *values), stamp)
        poses.append(history.state_at(stamp).pose)
    seen = right._replace(poses=np.array(poses))
    assert drive(seen).frechet_distance < ROUNDING < 0.01 < drive(right).frechet_distance
    assert judged(seen)[0] == {}


def test_a_car_that_brakes_slowly_is_predicted_until_it_stands():
    car = Car(acceleration=0.5)
    assert drive(replay(car=car)).predicted[-1] == pytest.approx(rest(PLAN, car)[1])


def test_after_a_recording_that_ends_early_the_car_stands():
    right = replay()
    count = int(np.searchsorted(right.stamps, BEGIN + SECOND // 2))
    path = drive(right._replace(stamps=right.stamps[:count], poses=right.poses[:count]))
    assert path.predicted[-1] == pytest.approx(END, abs=ROUNDING)
    assert path.times == pytest.approx(0.02 * np.arange(len(path.times)))
    assert (path.driven[count - 5 :] == right.poses[count - 1]).all()


@pytest.mark.parametrize("elsewhere", [(9.0, 9.0, 0.5), (1.0, 2.0, 0.0), (1.0, 2.0, 0.5 - 3.0)])
@pytest.mark.parametrize(
    ("placed", "has_stamp", "late", "begin"),
    [
        (0.02, True, 0.0, 0.02),
        (0.02, False, 0.0, 0.02),
        (0.02, False, 0.05, -0.03),
        (-0.04, True, 0.0, 0.0),
        (-0.04, False, 0.05, -0.09),
    ],
)
def test_a_drive_begins_when_the_car_is_placed(elsewhere, placed, has_stamp, late, begin):
    """But not before a stamped command. The time of an unstamped one may be late."""
    right = replay()
    time = BEGIN + round(late * SECOND)
    first = right.sent[0]._replace(time=time, has_stamp=has_stamp)
    delay = 1 if placed > 0.0 else 0
    poses = right.poses[np.maximum(np.arange(len(right.poses)) - delay, 0)]
    poses[right.stamps < BEGIN + round(placed * SECOND)] = elsewhere
    path = drive(right._replace(poses=poses, sent=(first, *right.sent[1:])))
    assert tuple(path.driven[0]) == START
    assert path.times[0] == pytest.approx(begin)


@pytest.mark.parametrize("has_stamp", [True, False])
def test_a_car_that_drives_off_before_it_reports_its_start(has_stamp):
    right = replay()
    poses = right.poses.copy()
    poses[right.stamps <= BEGIN] = (0.0, 0.0, 0.0)
    first = right.sent[0]._replace(has_stamp=has_stamp)
    path = drive(right._replace(poses=poses, sent=(first, *right.sent[1:])))
    assert path.times[0] == pytest.approx(0.02)
    assert path.driven[0] == pytest.approx(START, abs=0.05)


def test_commands_before_the_first_pose():
    right = replay()
    late = right.stamps > BEGIN + SECOND // 2
    path = drive(right._replace(stamps=right.stamps[late], poses=right.poses[late]))
    assert path.times[0] == pytest.approx(0.52)


def test_a_drive_that_begins_with_the_first_command():
    """Whatever the heading's range, and the noise of the car."""
    wrapped = replay(plan_of((0, 0, 3.14), [(2.0, 0.3, 1.0)]))
    theta = np.remainder(wrapped.poses[:, 2:] + np.pi, math.tau) - np.pi
    assert theta.min() < 0.0 < wrapped.poses[:, 2].min()
    wrapped = wrapped._replace(poses=np.hstack([wrapped.poses[:, :2], theta]))
    noisy = replay(plan_of((0, 0, 0), [(2.0, 0.0, 1.0)]))
    # Three standard deviations in each step.
    drift = np.arange(len(noisy.poses))[:, None] * [0.002, 0.0, 0.004]
    car = Car(speed_noise=0.03, steering_noise=0.01)
    noisy = noisy._replace(car=car, poses=noisy.poses + drift)
    assert drive(wrapped).times[0] == drive(noisy).times[0] == 0.0


def frechet_by_definition(one, other):
    """Fill the whole table of the recursion, cell by cell."""
    table = np.full((len(one) + 1, len(other) + 1), np.inf)
    table[0, 0] = 0.0
    for i, here in enumerate(one, 1):
        for j, there in enumerate(other, 1):
            before = min(table[i - 1, j], table[i, j - 1], table[i - 1, j - 1])
            table[i, j] = max(math.dist(here, there), before)
    return table[-1, -1]


@pytest.mark.parametrize(("n", "m"), [(1, 1), (1, 9), (30, 7), (40, 40), (25, 50)])
@pytest.mark.parametrize("error", [0.01, 1.0])
def test_frechet_distance_of_near_curves(n, m, error):
    """Only a part of the table is computed then; the distance is the same."""
    dice = np.random.default_rng(n)
    one = np.cumsum(dice.normal(size=(n, 2)), axis=0)
    other = one[np.sort(dice.integers(0, n, m))] + dice.normal(scale=error, size=(m, 2))
    expected = frechet_by_definition(one, other)
    assert frechet_distance(one, other) == pytest.approx(expected, rel=1e-12)


def test_frechet_distance_depends_on_the_direction():
    line = np.column_stack([np.linspace(0.0, 10.0, 101), np.zeros(101)])
    assert frechet_distance(line, line) == 0.0
    assert frechet_distance(line, line + [3.0, 4.0]) == pytest.approx(5.0)
    assert frechet_distance(line, line[::-1]) == pytest.approx(10.0)
