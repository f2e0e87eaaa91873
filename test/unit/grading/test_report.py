"""Check the verdicts on a replay, on drives that are computed and not driven."""

import json
import math

import numpy as np
import pytest

from mushr_ros_intro.car.bicycle import Pose
from mushr_ros_intro.car.model import Car
from mushr_ros_intro.grading.judge import (
    Replay,
    Sent,
    _first_pose,
    default_tolerances,
    drive,
    frechet_distance,
    judge,
    predicted_poses,
    verdict,
    write,
)
from mushr_ros_intro.plan.model import as_float32
from mushr_ros_intro.plan.parse import parse_plan
from mushr_ros_intro.preview.prediction import final_pose

PLAN = parse_plan(b"1,2,0.5\n2.0,0.1\n1.0,-0.1,0.5\n1.0,-0.1,0.25\n", "plan.txt")
SECOND = 1_000_000_000
TENTH = SECOND // 10
BEGIN = 100 * SECOND
DUES = [*range(0, SECOND, TENTH), *range(SECOND, 15 * TENTH, TENTH), 15 * TENTH, 16 * TENTH]
DUES += [17 * TENTH]
END = SECOND * 7 // 4
ROUNDING = 1e-9
"""[m] Of the sums behind a prediction."""


def commands(stop=True):
    """Return what path_publisher sends for PLAN."""
    angle = {True: np.float32(0.1).item(), False: np.float32(-0.1).item()}
    sent = [
        Sent(BEGIN + due, True, 2.0 if due < SECOND else 1.0, angle[due < SECOND]) for due in DUES
    ]
    return [*sent, Sent(BEGIN + END, True, 0.0, 0.0)] if stop else sent


def replay(**changes):
    """Return a replay in which everything is right, but for `changes`."""
    instants = list(range(-TENTH, END + SECOND // 2, SECOND // 50))
    right = Replay(
        plan=PLAN,
        car=Car(),
        outcome="",
        starts=(Pose(1.0, 2.0, 0.5),),
        sent=tuple(commands()),
        stamps=np.array(instants) + BEGIN,
        poses=predicted_poses(PLAN, Car(), instants),
        collisions=(),
        map_origin=Pose(-5.0, -5.0, 0.0),
        map_size=(20.0, 20.0),
    )
    return right._replace(**changes)


def replay_of(data, *values):
    """Return a replay of another plan, in which commands of these values came at 10 Hz."""
    plan = parse_plan(data, "plan.txt")
    instants = list(range(-TENTH, plan.duration + SECOND // 2, SECOND // 50))
    return replay(
        plan=plan,
        starts=(Pose(*plan.start),),
        sent=tuple(
            Sent(BEGIN + k * TENTH, True, as_float32(speed), as_float32(angle))
            for k, (speed, angle) in enumerate(values)
        ),
        stamps=np.array(instants) + BEGIN,
        poses=predicted_poses(plan, Car(), instants),
    )


def failed(seen):
    """Return the checks that a replay fails, and the verdict."""
    checks = judge(seen, default_tolerances(seen.plan, seen.car))
    return {check.name for check in checks if not check.passed}, verdict(checks, seen)


def test_all_is_right():
    assert failed(replay()) == (set(), "everything is right")


@pytest.mark.parametrize("plan", [PLAN, parse_plan(b"1,2,0.5\n-2.0,0.1\n", "plan.txt")])
def test_the_tolerances_are_what_a_missing_stop_costs(plan):
    """Also where the command that goes on was rounded up, as 0.1 is, on its way."""
    tolerances = default_tolerances(plan, Car())
    assert tolerances.position == tolerances.path == pytest.approx(0.2 * 2.0, abs=2e-6)
    angle = 0.2 * 2.0 * math.tan(0.1) / 0.33
    assert angle + 1e-8 < tolerances.angle == pytest.approx(angle, abs=2e-6)


def test_the_tolerances_of_a_plan_that_stands_leave_room_for_rounding():
    assert default_tolerances(parse_plan(b"0,0,0\n0,0\n", "plan.txt"), Car()) == 3 * (1e-6,)


def test_no_stop():
    names, said = failed(replay(sent=tuple(commands(stop=False))))
    assert names == set()
    assert said.startswith("everything is right, but the node sends no stop")


@pytest.mark.parametrize(
    ("changes", "name", "message"),
    [
        ({"outcome": "it crashed"}, "node", "it crashed"),
        ({"sent": ()}, "commands", "no command came"),
        ({"stamps": np.array([], int), "poses": np.zeros((0, 3))}, "path", "never reported"),
        ({"starts": ()}, "start_pose", "sent no start pose"),
        ({"starts": (Pose(1.0, 2.002, 0.5),)}, "start_pose", "start pose (1.0000 m, 2.0020 m"),
        ({"starts": (Pose(1.0, 2.0, 0.502),)}, "start_pose", "2.0000 m, 0.5020 rad); expected"),
        ({"starts": (Pose(9.0, 9.0, 0.5), Pose(1.0, 2.0, 0.5))}, "start_pose", "pose (9.0000 m"),
        ({"starts": (Pose(math.nan, 2.0, 0.5),)}, "start_pose", "nan"),
        ({"collisions": (Pose(3.0, 2.0, 0.0),)}, "collision", "a wall at (3.0000 m, 2.0000 m"),
        ({"map_size": (7.0, 20.0)}, "map", "left the map of 7 m x 20 m"),
        ({"map_origin": Pose(2.0, -5.0, 0.0)}, "map", "left"),
        ({"map_origin": Pose(-5.0, 2.2, 0.0)}, "map", "left"),
        ({"map_origin": Pose(-5.0, 8.0, -math.pi / 2), "map_size": (9.0, 7.0)}, "map", "left"),
    ],
)
def test_what_is_wrong(changes, name, message):
    seen = replay(**changes)
    checks = {check.name: check for check in judge(seen, default_tolerances(PLAN, Car()))}
    assert not checks[name].passed
    assert message in checks[name].message


def altered(change):
    sent = commands()
    change(sent)
    return replay(sent=tuple(sent))


def drop(sent):
    del sent[4]


def hurry(sent):
    sent[:10] = [
        each._replace(time=BEGIN + k * TENTH * 7 // 10) for k, each in enumerate(sent[:10])
    ]


def pause(sent):
    sent[5] = sent[5]._replace(time=sent[5].time + TENTH * 6 // 10)


def turn_back(sent):
    sent[5] = sent[5]._replace(time=sent[4].time - TENTH // 2)


def swap(sent):
    values = [each[2:] for each in sent[10:18] + sent[:10]]
    sent[:18] = [Sent(*each[:2], *value) for each, value in zip(sent, values)]


def mirror(sent):
    sent[:10] = [each._replace(steering_angle=-each.steering_angle) for each in sent[:10]]


def cut(sent):
    del sent[10:]


def prolong(sent):
    sent[-1:] = [sent[-1]._replace(speed=3.0)]


def stand(sent):
    sent[:] = [sent[-1]._replace(time=BEGIN)]


def spoil(sent):
    sent[3] = sent[3]._replace(speed=math.inf)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (drop, "rate: row 1 (1 s) came with 9 messages, 8.89 a second; expected 10"),
        (hurry, "rate: the 10 commands of row 1 (1 s) are stamped within 0.63 s"),
        (pause, "rate: in row 1 (1 s) nothing came for 0.16 s; expected a command every 0.1 s"),
        (turn_back, "rate: in row 1 (1 s) a stamp goes back by 0.05 s; expected rising stamps"),
        (
            swap,
            "commands: the rows are in the wrong order: where row 1 of the plan has 2 m/s, 0.1 rad,"
            " there came 1 m/s, -0.1 rad",
        ),
        (
            mirror,
            "commands: where row 1 of the plan has 2 m/s, 0.1 rad, there came 2 m/s, -0.1 rad; "
            "left is positive",
        ),
        (cut, "commands: the commands end with row 1 of 3"),
        (
            prolong,
            "commands: after the last row came a command that the plan has not: 3 m/s, 0 rad",
        ),
        (
            stand,
            "commands: where row 1 of the plan has 2 m/s, 0.1 rad, there came 0 m/s, 0 rad",
        ),
        (spoil, "commands: command 4 has the speed inf and the steering angle 0.1; expected"),
    ],
)
def test_what_is_wrong_with_the_commands(change, message):
    assert failed(altered(change))[1].startswith(message)


def test_a_command_that_is_a_little_late():
    sent = commands()
    sent[5] = sent[5]._replace(time=sent[5].time + TENTH * 4 // 10)
    assert failed(replay(sent=tuple(sent)))[0] == set()


@pytest.mark.parametrize(
    ("data", "values", "names"),
    [
        (b"0,0,0\n1,0\n0,0,0.5\n", 10 * [(1.0, 0.0)] + 5 * [(0.0, 0.0)], set()),
        (b"0,0,0\n1,0\n0,0,0.5\n", 10 * [(1.0, 0.0)] + 6 * [(0.0, 0.0)], set()),
        (
            b"0,0,0\n1,0\n0,0.3,0.5\n",
            10 * [(1.0, 0.0)] + 5 * [(0.0, 0.3)] + [(0.0, 0.0)],
            set(),
        ),
        (b"0,0,0\n1,0\n", 11 * [(1.0, 0.0)] + [(0.0, 0.0)], {"rate"}),
    ],
)
def test_one_stop_is_allowed_beyond_the_plan(data, values, names):
    """Where the plan ends standing, it is a command like those before it, or a group of its own."""
    assert failed(replay_of(data, *values))[0] == names


def test_a_car_that_is_off():
    seen = replay()
    shifted = seen._replace(poses=seen.poses + [0.5, 0.0, 0.0])
    names, said = failed(shifted)
    assert names == {"start_pose", "path", "final_pose"}
    path = next(check for check in judge(shifted, default_tolerances(PLAN, Car()))[4:5])
    assert path.name == "path"
    assert "0.5 m from the predicted one" in path.message
    assert failed(seen._replace(poses=seen.poses + [0.3, 0.0, 0.0]))[0] == set()
    names, _ = failed(seen._replace(poses=seen.poses + [0.0, 0.0, 0.3]))
    assert names == {"start_pose", "final_pose"}


@pytest.mark.parametrize("elsewhere", [(9.0, 9.0, 0.5), (1.0, 2.0, 0.0), (1.0, 2.0, 0.5 - 3.0)])
def test_a_car_that_is_placed_after_the_first_command(elsewhere):
    """Also where it stood already, but looked elsewhere, as figure_8's does."""
    poses = replay().poses.copy()
    poses[:7] = elsewhere
    assert failed(replay(poses=poses))[0] == set()


def test_a_heading_that_goes_on_at_the_other_end_of_its_range_is_no_jump():
    seen = replay_of(b"0,0,3.14\n2.0,0.3\n", *10 * [(2.0, 0.3)])
    theta = seen.poses[:, 2]
    assert theta.max() > math.pi
    wrapped = np.column_stack([seen.poses[:, :2], np.remainder(theta + np.pi, math.tau) - np.pi])
    assert wrapped[:, 2].min() < 0.0
    assert _first_pose(seen._replace(poses=wrapped)) == _first_pose(seen)


def test_the_noise_of_a_car_is_no_jump():
    seen = replay_of(b"0,0,0\n2.0,0\n", *10 * [(2.0, 0.0)])
    drift = np.arange(len(seen.poses))[:, None] * [0.002, 0.0, 0.004]  # three deviations a step
    noisy = seen._replace(car=Car(speed_noise=0.03, steering_noise=0.01), poses=seen.poses + drift)
    assert _first_pose(noisy) == _first_pose(seen)


def test_a_car_that_is_moved_while_it_drives():
    poses = replay().poses.copy()
    poses[60:] += (5.0, 0.0, 0.0)
    assert failed(replay(poses=poses))[0] == {"path", "final_pose"}


def test_a_car_that_does_not_stand_at_the_end():
    poses = replay().poses.copy()
    poses[-5, 0] += 1e-6
    assert failed(replay(poses=poses))[0] == {"rest"}


def test_a_drive_that_ends_early():
    """However soon the recording ends, the plan's end is what was expected."""
    count = int(np.searchsorted(replay().stamps, BEGIN + SECOND // 2))
    seen = replay(stamps=replay().stamps[:count], poses=replay().poses[:count])
    checks = {check.name: check for check in judge(seen, default_tolerances(PLAN, Car()))}
    wanted = predicted_poses(PLAN, Car(), [END])[0]
    assert not checks["path"].passed
    assert f"rad from ({wanted[0]:.4f} m, {wanted[1]:.4f} m" in checks["final_pose"].message
    assert not checks["final_pose"].passed


@pytest.mark.parametrize("car", [Car(), Car(speed_noise=0.1), Car(steering_noise=0.1)])
def test_the_prediction_is_the_closed_form(car):
    """Two arcs, written out with their turning centres."""
    pose = complex(1.0, 2.0), 0.5
    for speed, angle, seconds in ((2.0, 0.1, 1.0), (1.0, -0.1, 0.75)):
        radius = 0.33 / math.tan(np.float32(angle).item())
        turned = pose[1] + speed * seconds / radius
        centre = pose[0] + 1j * radius * np.exp(1j * pose[1])
        pose = centre - 1j * radius * np.exp(1j * turned), turned
    got = predicted_poses(PLAN, car, [0, END, END + SECOND])
    assert got[0] == pytest.approx([1.0, 2.0, 0.5])
    for row in got[1:]:
        assert row == pytest.approx([pose[0].real, pose[0].imag, pose[1]], abs=ROUNDING)


def test_a_car_that_brakes_slowly_is_predicted_until_it_stands():
    car = Car(acceleration=0.5)
    _, _, predicted = drive(replay(car=car), 0)
    assert predicted[-1] == pytest.approx(final_pose(PLAN, car))


def frechet_by_definition(one, other):
    """Fill the whole table of the recursion, cell by cell."""
    table = np.full((len(one) + 1, len(other) + 1), np.inf)
    table[0, 0] = 0.0
    for i, here in enumerate(one, 1):
        for j, there in enumerate(other, 1):
            before = min(table[i - 1, j], table[i, j - 1], table[i - 1, j - 1])
            table[i, j] = max(math.dist(here, there), before)
    return table[-1, -1]


@pytest.mark.parametrize(("n", "m"), [(1, 1), (1, 7), (7, 1), (2, 3), (20, 33), (40, 40)])
def test_frechet_distance(n, m):
    random = np.random.default_rng(n + m)
    one, other = random.normal(size=(n, 2)), random.normal(size=(m, 2))
    assert frechet_distance(one, other) == pytest.approx(frechet_by_definition(one, other))
    assert frechet_distance(one, one) == 0.0
    assert frechet_distance(one, one + [3.0, 4.0]) <= 5.0 + ROUNDING


def test_frechet_distance_minds_the_direction():
    there = np.column_stack([np.linspace(0.0, 10.0, 101), np.zeros(101)])
    assert frechet_distance(there, there[::-1]) == pytest.approx(10.0)


def test_one_fault_fails_the_report(tmp_path):
    seen = replay(outcome="it crashed")
    write(str(tmp_path), seen, judge(seen, default_tolerances(PLAN, Car())), {})
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["passed"] is False
    assert report["verdict"] == "node: it crashed"
