"""Check the verdicts on replays."""

import math
import re

import numpy as np
import pytest
import rospy
from ackermann_msgs.msg import AckermannDrive, AckermannDriveStamped
from geometry_msgs.msg import PoseWithCovarianceStamped

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.replay import recording
from mushr_ros_intro.replay.judge import CHECK_NAMES, STILL_SENDS
from mushr_ros_intro.replay.mistakes import POSE_TYPE, printed_error
from mushr_ros_intro.replay.received import Received
from mushr_ros_intro.replay.recording import START_TOLERANCE
from mushr_ros_intro.replay.tolerances import compare, default_tolerances
from support import cars, recorded
from support.geometry import closed_form, float32
from support.recorded import (
    BEGIN,
    COMMANDS,
    ROWS,
    SECOND,
    STOP,
    TENTH,
    commands,
    judged,
    map_of,
    replay,
)

CONTROL = "/car/mux/ackermann_cmd_mux/input/navigation"
COMMANDS_TYPE = "ackermann_msgs/AckermannDriveStamped"
STANDING = [(1.0, 0.0, 1.0), (0.0, 0.0, 0.5)]
STEERED = [(1.0, 0.0, 1.0), (0.0, 0.3, 0.5)]


def test_all_is_right():
    failed, verdict = judged(replay())
    assert failed == {} and len(verdict.splitlines()) == len(CHECK_NAMES) + 1
    assert verdict.startswith("ok   node: the node ran") and verdict.endswith("checks passed")
    failed, verdict = judged(replay(sent=commands()))
    assert failed == {}
    assert "all checks passed\nnote: the node sends no stop at the end, so the car" in verdict
    assert judged(replay(grid=None))[0] == {}  # without a map


@pytest.mark.parametrize("rows", [ROWS, [(-2.0, 0.1, 1.0)]])
def test_the_tolerances_are_what_a_missing_stop_costs(rows):
    """0.2 s of driving, and the allowed rounding of a start pose."""
    tolerances = default_tolerances(recorded.plan_of((1, 2, 0.5), rows), Car())
    assert tolerances.position == tolerances.path == pytest.approx(0.2 * 2.0 + START_TOLERANCE)
    angle = 0.2 * 2.0 * math.tan(float32(0.1)) / 0.33
    assert tolerances.angle == pytest.approx(angle + START_TOLERANCE)
    standing = recorded.plan_of((0, 0, 0), [(0.0, 0.0, 1.0)])
    assert default_tolerances(standing, Car())[:3] == 3 * (START_TOLERANCE,)


def test_a_rounded_start_pose():
    """Also if no row turns the car."""
    rounded = replay(recorded.plan_of((0, 0, 0.7854), [(1.0, 0.0, 1.0)]), commands([(1, 0, 1.0)]))
    plan = recorded.plan_of((0, 0, 0.7853981634), [(1.0, 0.0, 1.0)])
    assert judged(rounded._replace(plan=plan))[0] == {}


def test_an_ignored_message_is_noted():
    _, verdict = judged(replay(ignored="a message on /initialpose: wrong frame"))
    assert verdict.endswith("passed\nnote: the car ignored a message on /initialpose: wrong frame")


def test_a_parameter_before_init_node_is_noted():
    outcome = "the node ended with exit status 1; its last output:\nKeyError: '~plan_file'"
    _, verdict = judged(replay(outcome=outcome, plan_is_read=False))
    (note,) = re.findall("^note: (.*)$", verdict, re.M)
    assert note == "~plan_file exists only after rospy.init_node; call rospy.get_param after it"


def test_a_node_that_does_not_read_the_plan_is_noted():
    _, verdict = judged(replay(plan_is_read=False))
    assert verdict.endswith(
        "passed\nnote: the node did not read its parameter ~plan_file, the path of the plan; "
        "plan_file without ~ is another parameter"
    )


def test_a_node_that_was_not_loaded_could_not_read_the_plan():
    """It may read the plan in a line after the fault."""
    for error, count in (("TabError: inconsistent", 0), ("KeyError: 'plan_file'", 1)):
        _, verdict = judged(replay(outcome=f"the node ended:\n{error}", plan_is_read=False))
        assert verdict.count("note: the node did not read") == count


def test_a_module_that_is_missing_on_this_machine_is_noted():
    """It may not be the student's fault."""
    for module, count in (("pandas", 1), ("numpy.pandas", 0)):
        error = f"ModuleNotFoundError: No module named '{module}'"
        outcome = f"the node ended with exit status 1; its last output:\n{error}"
        _, verdict = judged(replay(outcome=outcome, plan_is_read=False, sent=()))
        assert verdict.count("note: the module pandas is neither in the node's files nor") == count
        assert verdict.count("nor on the machine that ran the node; if nodes may") == count


def no_start(published):
    """Return the changes of a drive whose node sent no start pose, but published on a topic."""
    return {"start": None, "published": (published,)}


@pytest.mark.parametrize(
    ("changes", "name", "message"),
    [
        ({"outcome": "it crashed"}, "node", "it crashed"),
        ({"actions": ("publishes on /clock",)}, "topics", "the node publishes on /clock; expected"),
        (
            no_start((CONTROL, COMMANDS_TYPE)),
            "start_pose",
            f"launch file); it publishes {CONTROL}; expected (1.0000",
        ),
        (
            no_start(("/rosout", "rosgraph_msgs/Log")),
            "start_pose",
            "does not publish /initialpose (only this node is run, no other node of a",
        ),
        (
            no_start(("/initialpose", "a/B")),
            "start_pose",
            "publishes a/B on /initialpose, not geom",
        ),
        (
            no_start(("/initialpose", POSE_TYPE)),
            "start_pose",
            "wait until its get_num_connections(",
        ),
        (
            {"start": None, "start_delay": 12 * TENTH},
            "start_pose",
            "1.20 s after the first command",
        ),
        ({"start": Pose(1, 2.002, 0.5)}, "start_pose", "start pose (1.0000 m, 2.0020 m"),
        ({"start": Pose(1, 2, 0.502)}, "start_pose", "2.0000 m, 0.5020 rad); expected"),
        ({"start": Pose(2, 1, 0.5)}, "start_pose", "0.5000 rad). Perhaps x and y are swapped"),
        ({"start": Pose(1, 2, math.degrees(0.5))}, "start_pose", "Perhaps theta is in degrees; e"),
        ({"start": Pose(1, 2, math.radians(0.5))}, "start_pose", "theta is converted from degr"),
        ({"start": Pose(1, 2, 2 * math.atan(0.5))}, "start_pose", "Perhaps theta itself is z of"),
        ({"start": Pose(1, 2, -0.5)}, "start_pose", "Perhaps theta has the wrong sign"),
        ({"start": Pose(1, 2, 0)}, "start_pose", "Perhaps theta is not used"),
        (
            {"start": Pose(math.nan, 2, 0.5), "ignored": "a message: x is nan"},
            "start_pose",
            "ignored a message: x is nan; the plan starts at (1.0000 m, 2.0000",
        ),
        ({"collisions": (Pose(3, 2, 0),)}, "map", "a wall at (3.0000 m, 2.0000 m"),
        ({"grid": map_of(7, 20, Pose(-5, -5, 0))}, "map", "left the map at (2.0"),
        ({"grid": map_of(20, 20, Pose(2, -5, 0))}, "map", "the map is 20 m x 20 m"),
        ({"grid": map_of(20, 20, Pose(-5, 2.2, 0))}, "map", "left"),
        ({"grid": map_of(9, 7, Pose(-5, 8, -math.pi / 2))}, "map", "left"),
    ],
)
def test_one_fault(changes, name, message):
    failed, verdict = judged(replay(**changes))
    assert set(failed) == {name}
    assert message in failed[name]
    assert verdict.startswith(f"FAIL {name}: {failed[name]}\nok   ")
    assert "1 check failed" in verdict


def test_a_crash_is_the_first_line():
    """Then come the checks that failed, then those that were not judged, then those that passed.

    Those not judged for the same reason share a line.
    """
    outcome = "the node ended with exit status 1; its last output:\nTraceback\nIndexError: 3"
    failed, verdict = judged(replay(outcome=outcome, sent=COMMANDS[:10]))
    lines = verdict.splitlines()
    assert (
        lines[0] == "FAIL node: the node ended with exit status 1; its last output: IndexError: 3"
    )
    assert lines[1].startswith("FAIL commands: no command after row 1")
    assert lines[len(failed) - 1].startswith("--   rate: not judged: the commands of rows 2 to 3 (")
    assert all(line.startswith("ok   ") for line in lines[len(failed) : len(CHECK_NAMES)])
    assert lines[-3:] == ["the last output of the node:", "Traceback", "IndexError: 3"]


def test_without_a_command_nothing_passes():
    _, *others = CHECK_NAMES
    failed, _ = judged(replay(sent=()))
    assert failed == dict.fromkeys(others, "not judged: the node sent no command")
    outcome = (
        "the node ended with exit status 1; its last output:\nTraceback\nIndexError: not judged"
    )
    report = recorded.reported(replay(outcome=outcome, sent=()))
    assert [check.name for check in report.checks if check.is_judged] == ["node"]
    assert report.verdict.splitlines()[:3] == [
        "FAIL node: the node ended with exit status 1; its last output: IndexError: not judged",
        f"--   {', '.join(others)}: not judged: the node sent no command",
        f"1 check failed, {len(others)} not judged",
    ]


def test_a_crash_before_the_first_command_to_drive():
    """The stops that a node sends when it shuts down are no commands of the plan."""
    outcome = "the node ended with exit status 1; its last output:\nNameError: x"
    report = recorded.reported(replay(outcome=outcome, sent=COMMANDS[-1:]))
    assert [check.name for check in report.checks if check.is_judged] == ["node"]
    assert "not judged: the node sent only stops" in report.verdict


@pytest.mark.parametrize("angle", [0.0, 0.1])
def test_a_node_that_does_not_drive(angle):
    """Whatever moves the car; only the check of the commands says what is wrong."""
    sent = [each._replace(speed=0.0, steering_angle=angle) for each in COMMANDS]
    report = recorded.reported(replay(sent=sent))
    judged_checks = {check.name: check.passed for check in report.checks if check.is_judged}
    assert judged_checks == {"node": True, "commands": False}
    assert "final_pose, map: not judged: the node sent only stops" in report.verdict
    assert not any(check.passed for check in report.checks[1:])
    standing = replay(recorded.plan_of((0, 0, 0), [(0.0, angle, 1.0)]), commands([(0, angle, 1.0)]))
    assert judged(standing)[0] == {}


def test_a_car_that_is_placed_at_the_end():
    """With a command that hardly drives it."""
    sent = [each._replace(speed=1e-6 if each.speed else 0.0) for each in COMMANDS]
    right = replay()
    poses = np.tile(right.poses[-1], (len(right.poses), 1))
    failed, _ = judged(right._replace(sent=tuple(sent), start=Pose(*poses[-1]), poses=poses))
    assert set(failed) == {"start_pose", "commands", "rate", "path", "final_pose"}
    assert failed["final_pose"].startswith("the car ended at the expected pose, but started at (")


def changed(index, **values):
    """Return the commands with one of them changed."""
    return [*COMMANDS[:index], COMMANDS[index]._replace(**values), *COMMANDS[index + 1 :]]


def scaled(speed, angle):
    """Return the commands with all speeds and all steering angles multiplied."""
    return [
        each._replace(speed=speed * each.speed, steering_angle=angle * each.steering_angle)
        for each in COMMANDS
    ]


def moved(sent, shifts):
    """Return commands whose arrival and stamp are shifted [ns]."""
    return [
        each._replace(
            time=each.time + shift, arrived=each.arrived + shift, stamp=each.stamp + shift
        )
        for each, shift in zip(sent, shifts)
    ]


def stamped(stamps):
    """Return the commands with other stamps, which are 0 or not valid; they count on arrival."""
    return [
        each._replace(time=each.arrived, has_stamp=False, stamp=stamp)
        for each, stamp in zip(COMMANDS, stamps)
    ]


def later(index, shift):
    """Return the commands with one of them later."""
    return moved(COMMANDS, [shift if k == index else 0 for k in range(len(COMMANDS))])


@pytest.mark.parametrize("seconds", [0.5, 0.8, 1.0, 1.2])
def test_two_commands_at_the_begin(seconds):
    """A rospy.Rate that was made long before the drive does not wait the first time."""
    rows = [(2.0, 0.1, seconds), (1.0, -0.1, 1.0)]
    sent = commands(rows)
    sent = moved(sent, [-TENTH * (k > 0) for k in range(len(sent))])
    plan = recorded.plan_of((1, 2, 0.5), rows)
    assert "rate" not in judged(replay(plan, sent))[0]


MS = 1_000_000
HURRIED = moved(COMMANDS[:10], [-k * TENTH * 2 // 10 for k in range(10)])
SAME = [each._replace(time=BEGIN, stamp=BEGIN) for each in COMMANDS[:10]]
BURST = [
    each._replace(arrived=BEGIN - TENTH + k // 8 * 8 * TENTH) for k, each in enumerate(COMMANDS)
]
WALL_CLOCK = stamped([each.stamp + 25 * 365 * 86400 * SECOND for each in COMMANDS])
EARLIER = stamped([each.stamp - 5 * SECOND for each in COMMANDS])
UNSTAMPED = stamped(len(COMMANDS) * [0])
SWAPPED = [each._replace(speed=each.steering_angle, steering_angle=each.speed) for each in COMMANDS]

REORDERED = commands([ROWS[1], ROWS[2], ROWS[0], STOP])


def test_a_rate_within_the_tolerance_is_shown():
    slow = [each._replace(time=BEGIN + (each.time - BEGIN) * 20 // 19) for each in COMMANDS]
    assert "ok   rate: 9.5 commands per second; each row is" in judged(replay(sent=slow))[1]
    assert "ok   rate: 10 commands per second; each row is" in judged(replay())[1]


@pytest.mark.parametrize(
    ("milliseconds", "failed"), [(100, None), (102, None), (104, 6), (110, 3), (96, 6), (90, 3)]
)
def test_a_rate_whose_error_adds_up(milliseconds, failed):
    """Each row of 1 s is right within 0.2 s, but the plan is driven slower or faster."""
    rows = [(1.0, 0.1 * (-1) ** number, 1.0) for number in range(8)]
    sent = [
        each._replace(**dict.fromkeys(("time", "stamp", "arrived"), BEGIN + k * milliseconds * MS))
        for k, each in enumerate(commands([*rows, STOP]))
    ]
    faults, _ = judged(replay(recorded.plan_of((0, 0, 0), rows), sent))
    assert ("rate" in faults) == (failed is not None)
    if failed:
        assert faults["rate"].startswith(f"row {failed} (1 s): its last command comes 0.2")
        assert f"the commands come every {milliseconds / 1000:g} s" in faults["rate"]


RATE = "rate: row 1 (1 s): "
ROW = "commands: row 1 (1 s): received "


@pytest.mark.parametrize(
    ("sent", "said"),
    [
        (COMMANDS[:4] + COMMANDS[5:], RATE + "0.2 s between messages 4 and 5; expected 0.1 s"),
        (COMMANDS[:1] + COMMANDS[10:], RATE + "1 command received; expected 10 in 1 s"),
        (HURRIED + COMMANDS[10:], RATE + "its 10 commands span 0.72 s; expected 1 s, tolerance"),
        (later(5, TENTH * 6 // 10), RATE + "0.16 s between messages 5 and 6; expected 0.1 s"),
        (later(5, TENTH * 4 // 10), ""),
        (later(5, -TENTH * 3 // 2), RATE + "message 6 is stamped 0.05 s before"),
        (SAME + COMMANDS[10:], RATE + "its 10 commands have the same stamp; expected the time of"),
        (BURST, "rate: message 8 arrives 0.8 s before its stamp, another one 0.1 s; expected ten"),
        (UNSTAMPED, ""),
        (UNSTAMPED[:8] + UNSTAMPED[10:], RATE + "8 commands received in 0.8 s; expected 10 in 1 s"),
        (WALL_CLOCK, RATE + "the stamp of message 1 is wall-clock time, such as time.time(); expe"),
        (EARLIER, RATE + "the stamp of message 1 differs by -5 s from the time of its arrival; ex"),
        (REORDERED, ROW + "1 m/s, -0.1 rad; expected 2 m/s, 0.1 rad. The rows are in the wrong o"),
        (scaled(1, -1), ROW + "2 m/s, -0.1 rad; expected 2 m/s, 0.1 rad. All steering angles have"),
        (SWAPPED, ROW + "0.1 m/s, 2 rad; expected 2 m/s, 0.1 rad. Speed and steering angle are sw"),
        (scaled(1, math.degrees(1)), "expected 2 m/s, 0.1 rad. All steering angles are in degrees"),
        (scaled(1, math.radians(1)), "All steering angles are converted from degrees; those of"),
        (scaled(1, 0.25), "expected 2 m/s, 0.1 rad. All steering angles are 0.25 times those of"),
        (scaled(0.5, 1), "expected 2 m/s, 0.1 rad. All speeds are 0.5 times those of the plan\n"),
        (scaled(2, -1), "All speeds are 2 times those of the plan. All steering angles have the"),
        ([COMMANDS[-1]], ROW + "0 m/s, 0 rad; expected 2 m/s, 0.1 rad. All speeds are 0"),
        (COMMANDS[:10], "commands: no command after row 1; expected rows 2 to 3 (0.75 s)"),
        (changed(len(COMMANDS) - 1, speed=3.0), "after the plan the node sent 3 m/s, 0 rad;"),
        (
            [*COMMANDS, *COMMANDS],
            "after the plan the node sent 0 m/s, 0 rad and 2 m/s, 0.1 rad; expected only a stop (d",
        ),
        (changed(3, speed=math.inf), "commands: rows 2 to 3 (0.75 s): received inf m/s, 0.1 rad;"),
        (changed(3, steering_angle=math.nan), "rows 2 to 3 (0.75 s): received 2 m/s, nan rad;"),
    ],
)
def test_commands(sent, said):
    failed, verdict = judged(replay(sent=sent))
    assert said in verdict and bool(failed) == bool(said)


def test_a_node_that_repeats_the_plan_is_ended_before_its_stop():
    _, verdict = judged(replay(sent=commands([*ROWS, *ROWS])))
    assert "(does the node repeat the plan?)" in verdict and "note:" not in verdict


def test_an_exception_in_a_callback():
    """The node keeps running; its own line is the last one of the traceback."""
    output = (
        "[ERROR] bad callback: <function callback>\nTraceback (most recent call last):\n"
        '  File "/opt/ros/topics.py", line 750, in _invoke_callback\n    cb(msg)\n'
        '  File "/tmp/my_node.py", line 31, in callback\n    x = 1 / 0\n        ~~^~~\n'
        "ZeroDivisionError: division by zero\ngoes on\n"
    )
    error = printed_error(output)
    assert error == "ZeroDivisionError: division by zero (my_node.py, line 31)"
    cut = printed_error(output.replace("division by zero", 1000 * "x"))
    assert cut == f"ZeroDivisionError: {181 * 'x'} (my_node.py, line 31)"
    assert not printed_error(output.partition("ZeroDivisionError")[0])
    assert f"ok   node: the node printed {error}\n" in judged(replay(error=error))[1]
    hangs = "the node runs, but sent no command"
    _, verdict = judged(replay(error=error, outcome=hangs, sent=()))
    assert f"FAIL node: the node printed {error}; {hangs}\n" in verdict
    quoted = f"the node ended with exit status 1; its last output:\n{output}"
    assert "node printed" not in judged(replay(error=error, outcome=quoted))[1]


def test_a_slow_node_is_ended_before_its_stop():
    outcome = f"{STILL_SENDS} 8 s after the end of the plan"
    failed, verdict = judged(replay(outcome=outcome, sent=COMMANDS[:10]))
    assert failed["commands"] == "the drive was ended before rows 2 to 3 (0.75 s)"
    assert "note:" not in verdict


def test_a_wrong_sign_in_one_of_the_last_rows_is_no_repetition():
    plan = recorded.plan_of((1.0, 2.0, 0.5), [(2.0, 0.1, 1.0), (2.0, -0.1, 1.0)])
    failed, _ = judged(
        replay(plan, commands([(2.0, 0.1, 1.0), (2.0, -0.1, 0.5), (2.0, 0.1, 0.5), STOP]))
    )
    assert failed["commands"] == (
        "row 2 (1 s): received 2 m/s, 0.1 rad after 5 commands; expected 10 commands of "
        "2 m/s, -0.1 rad"
    )


def test_a_symmetric_plan_does_not_tell_two_mistakes_apart():
    plan = recorded.plan_of((1.0, 2.0, 0.5), [(2.0, 0.1, 1.0), (2.0, -0.1, 1.0)])
    sent = commands([(2.0, -0.1, 1.0), (2.0, 0.1, 1.0), STOP])
    failed, _ = judged(replay(plan, sent))
    assert failed["commands"].endswith("turns left, or the rows are in reverse order")


def mirrored(rows):
    return [(speed, -angle, seconds) for speed, angle, seconds in rows]


def without_reverse(rows):
    return [(abs(speed), angle, seconds) for speed, angle, seconds in rows]


@pytest.mark.parametrize(
    ("mistake", "end"),
    [
        (
            lambda rows: [(1, -2, 1), *rows],
            ". The first command is the start pose, which is the first line of the plan",
        ),
        (
            lambda rows: [(2, 0, 1), *rows],
            "row 1 (1 s): received 2 m/s, 0 rad; expected 1 m/s, 0 rad",
        ),
        (lambda rows: rows[2:], ". The first rows are missing"),
        (lambda rows: rows[:-1], ". The last rows are missing"),
        (
            lambda rows: [*rows[:2], *mirrored(rows[2:])],
            ". From this row on, all steering angles have the wrong sign",
        ),
        (without_reverse, "row 4 (1 s): received 1 m/s, 0.3 rad; expected -1 m/s, 0.3 rad"),
    ],
)
def test_the_plan_of_the_documentation_tells_mistakes_apart(mistake, end):
    plan = cars.plan_named("test_drive")
    rows = [(row.speed, row.steering_angle, 1.0) for row in plan.rows]
    failed, _ = judged(replay(plan, commands([*mistake(rows), STOP])))
    assert failed["commands"].endswith(end)


def test_swapped_columns_of_a_plan_without_turns():
    """All speeds are 0 then, but this is not the mistake."""
    plan = recorded.plan_of((0, 0, 0), [(2.0, 0.0, 1.0)])
    failed, _ = judged(replay(plan, commands([(0.0, 2.0, 1.0)])))
    assert failed["commands"].endswith(". Speed and steering angle are swapped in all commands")


def test_the_start_pose_is_right_although_the_first_command_is_wrong():
    """A large steering angle turns the car by 1 rad before it reports its first pose."""
    seen = replay()
    stamps = seen.stamps - TENTH // 10
    turned = seen.poses + np.outer(stamps > BEGIN, (0.0, 0.0, 1.0))
    failed, verdict = judged(seen._replace(stamps=stamps, poses=turned))
    assert set(failed) == {"final_pose"}, verdict


BORDER = [(2.0, 0.1, 1.1), (1.0, -0.1, 0.65), STOP]


def test_one_command_more_or_less_is_a_note():
    """Two threads of a node may wake up at the same time, at the border of two rows."""
    failed, verdict = judged(replay(sent=commands(BORDER)))
    assert failed == {}
    assert "note: row 1 (1 s): 11 commands received; expected 10\n" in verdict
    *_, row, end = verdict.splitlines()
    assert row == "note: rows 2 to 3 (0.75 s): 7 commands received; expected 8"
    assert end.startswith("note: path and final_pose are judged with the rows as long as the node")


@pytest.mark.parametrize(("shift", "names"), [(0.1, set()), (0.2, {"rate", "path", "final_pose"})])
@pytest.mark.parametrize("stop", [[STOP], []])
def test_the_path_is_judged_with_the_rows_as_long_as_the_node_drove_them(shift, names, stop):
    """The final heading differs by 0.44 rad and 0.88 rad from that of the plan."""
    left, right = (2.0, 0.18), (2.0, -0.18)
    rows = [(*left, 1.0), (*right, 0.1), (*right, 0.9), (*left, 1.0), (*right, 1.0)]
    plan = recorded.plan_of((0, 0, 0), rows)
    pair = [(*left, 1.0 + shift), (*right, 1.0 - shift)]
    poses = replay(recorded.plan_of((0, 0, 0), 2 * pair)).poses
    failed, verdict = judged(replay(plan, commands([*pair, *pair, *stop]), poses=poses))
    assert set(failed) == names, verdict


def test_two_commands_at_one_time_do_not_make_a_row_longer():
    left, right = (2.0, 0.18), (2.0, -0.18)
    seen = replay(recorded.plan_of((0, 0, 0), [(*left, 1.0), (*right, 1.0)]))
    sent = commands([(*left, 1.0), (*right, 1.0), STOP])
    plan = recording.driven_plan(seen._replace(sent=(sent[0], *sent)))
    assert plan == seen.plan


def test_a_row_that_does_not_last_whole_tenths():
    """A node that sends every 0.1 s drives 0.75 s as 0.8 s."""
    rows, driven = (
        [(2.0, 0.2, part), (2.0, 0.0, 1.0), (2.0, 0.2, part), (2.0, -0.2, 1.0)]
        for part in (0.75, 0.8)
    )
    seen = replay(recorded.plan_of((0, 0, 0), rows), commands([*driven, STOP]))
    durations = [row.duration / SECOND for row in recording.driven_plan(seen).rows]
    assert durations == [0.8, 1.0, 0.8, 1.0]
    _, verdict = judged(seen)
    end = Pose(*closed_form((0, 0, 0), rows))
    assert verdict.endswith(f"as long as the node drove them; the plan itself ends at {end}")
    late = moved(seen.sent, [SECOND // 1000 * (k % 2) for k in range(len(seen.sent))])
    assert recording.driven_plan(seen._replace(sent=tuple(late))) == recording.driven_plan(seen)


@pytest.mark.parametrize(
    ("seconds", "driven"), [((1.0, 1.0), (1.0, 1.0)), ((1.0, 1.5, 1.0, 2.0), (1.0, 1.6, 1.0, 2.0))]
)
def test_another_rate_does_not_move_the_end_of_a_row(seconds, driven):
    """A node that sends every 0.2 s drives 1.5 s as 1.6 s, and other rows as long as they are."""
    wanted, rows = (
        [(2.0, 0.18 * (-1) ** index, each) for index, each in enumerate(durations)]
        for durations in (seconds, driven)
    )
    seen = replay(recorded.plan_of((0, 0, 0), rows), commands([*rows, STOP])[::2])
    seen = seen._replace(plan=recorded.plan_of((0, 0, 0), wanted))
    durations = [row.duration / SECOND for row in recording.driven_plan(seen).rows]
    assert durations == [*driven]
    failed, verdict = judged(seen)
    assert set(failed) == {"rate"}, verdict


def test_a_missing_command_does_not_move_the_end_of_a_row():
    """The one before drives the car on."""
    seen = replay(sent=[*COMMANDS[:9], *COMMANDS[10:]])
    assert recording.driven_plan(seen).rows[0] == seen.plan.rows[0]


def test_a_late_stop_does_not_make_a_row_longer():
    seen = replay(sent=[*COMMANDS[:-1], *moved(COMMANDS[-1:], [TENTH])])
    assert sum(row.duration for row in recording.driven_plan(seen).rows) == 18 * TENTH


def test_stops_before_the_plan_are_a_note():
    stops = [each._replace(speed=0.0, steering_angle=0.0) for each in COMMANDS[:3]]
    sent = moved(stops, 3 * [-3 * TENTH]) + COMMANDS
    failed, verdict = judged(replay(sent=sent))
    assert failed == {} and verdict.endswith("note: the node sends 3 stops before the plan")


@pytest.mark.parametrize(
    ("rows", "sent", "names"),
    [
        (STANDING, STANDING, set()),
        (STANDING, [*STANDING, STOP], set()),
        (STEERED, [*STEERED, STOP], set()),
        (STANDING, [(1.0, 0.0, 1.1), STANDING[1]], set()),
        (STANDING, [(1.0, 0.0, 1.1), STANDING[1], STOP], set()),
        (STANDING, [*STANDING, STOP, STOP, STOP], {"rate"}),
        (STANDING[:1], [(1.0, 0.0, 1.2), STOP], {"rate"}),
        ([*STANDING, (1.0, 0.0, 0.5)], [*STANDING, *[STOP] * 2, (1.0, 0.0, 0.5), STOP], {"rate"}),
    ],
)
def test_one_stop_is_allowed_after_the_plan(rows, sent, names):
    """If the plan ends with a stop, it is either like the commands before or a group of its own."""
    seen = replay(recorded.plan_of((0, 0, 0), rows), commands(sent))
    assert set(judged(seen)[0]) == names


def pose_msg(x, ahead=0):
    """Return an initial pose, whose stamp is ahead of BEGIN [ns]; unusable if x is None."""
    msg = PoseWithCovarianceStamped()
    msg.header.frame_id = "map" if x is not None else "odom"
    msg.header.stamp = rospy.Time(nsecs=BEGIN + ahead)
    msg.pose.pose.position.x, msg.pose.pose.orientation.w = x or 0, 1.0
    return msg


def places_again(*messages):
    """Return which initial poses place the car again, among floats, which are speeds of commands.

    An initial pose is its x, an int, or None if it is unusable.
    """
    received, again = Received(), []
    for each in messages:
        if isinstance(each, float):
            drive = AckermannDrive(speed=each)
            received.add_command(AckermannDriveStamped(drive=drive), BEGIN)
        else:
            again.append(bool(received.add_initial_pose(pose_msg(each), BEGIN)))
    return again


@pytest.mark.parametrize(
    ("messages", "again"),
    [
        ((1, 2, 0.0, 2, 2, 1.0), [False, False, False, False]),
        ((0.0, 0.0, 2, 2, 0.0, 2, 1.0), [False, False, False]),
        ((1, 0.0, 2, 0.0, 3), [False, True, True]),
        ((0.0, 1, 2, 3), [False, True, True]),
        ((1, 1e-6, 2), [False, True]),
        ((1, 1.0, 1), [False, True]),
        ((1.0, 1, 2), [False, False]),
        ((None, 0.0, None, 0.0), [False, False]),
    ],
)
def test_a_node_that_places_the_car_again(messages, again):
    """Also between stops. It may repeat the same start pose until it drives."""
    assert places_again(*messages) == again


def test_the_last_start_pose_counts_and_an_unusable_one_is_named():
    received = Received()
    for x in (1, 2):
        received.add_initial_pose(pose_msg(x), BEGIN)
    assert received.start.x == 2 and not received.ignored
    received.add_initial_pose(pose_msg(None), BEGIN)
    assert received.ignored.startswith("a message on /initialpose: pose is in the frame 'odom'")


@pytest.mark.parametrize(
    ("poses", "again"),
    [
        ([(1, 0), (2, TENTH)], [False, True]),
        ([(2, TENTH), (1, 0)], [False, True]),
        ([(1, TENTH), (1, 2 * TENTH)], [False, False]),
        ([(1, -TENTH), (2, 0), (3, 10 * SECOND)], [False, False, False]),
    ],
)
def test_an_initial_pose_with_a_stamp_ahead(poses, again):
    """It may apply during the drive. A stamp that is too far ahead is not used."""
    received = Received()
    assert [bool(received.add_initial_pose(pose_msg(*each), BEGIN)) for each in poses] == again


def test_a_limit_in_a_command_is_noted():
    received = Received()
    for values in ({}, {"acceleration": 2.0}, {"steering_angle_velocity": 0.5}):
        drive = AckermannDrive(speed=1.0, **values)
        received.add_command(AckermannDriveStamped(drive=drive), BEGIN)
    assert judged(replay(limit=received.limit))[1].endswith(
        "\nnote: drive.acceleration of a command is 2 m/s^2, a limit of the car's motion; 0 means "
        "as fast as possible"
    )


@pytest.mark.parametrize(
    ("part", "shift", "messages"),
    [
        (
            slice(None),
            (0.5, 0.0, 0.0),
            {
                "start_pose": "(1.5000 m, 2.0000 m, 0.5000 rad), 0.5 m and 0 rad from the expected "
                "(1.0000 m, 2.0000 m, 0.5000 rad); tolerances 0.401 m",
                "path": "by up to 0.5 m from the predicted path; tolerance 0.401 m",
                "final_pose": "tolerances 0.401 m and 0.123 rad",
            },
        ),
        (slice(None), (0.3, 0.0, 0.0), {}),
        (slice(None), (0.0, 0.0, 0.3), {"start_pose": "0 m and 0.3 rad", "final_pose": "0.3 rad"}),
        (slice(60, None), (5.0, 0.0, 0.0), {"path": "5 m", "final_pose": "5 m and 0 rad"}),
    ],
)
def test_a_car_that_deviates(part, shift, messages):
    poses = replay().poses.copy()
    poses[part] += shift
    failed, _ = judged(replay(poses=poses, sent=commands()))
    assert set(failed) == set(messages)
    assert all(messages[name] in failed[name] for name in failed), failed


@pytest.mark.parametrize(
    ("pose", "angle", "is_right", "said"),
    [
        ((1.0, 2.1, -math.pi), 0.1, True, "2.1000 m, -3.1416 rad), 0.1 m and 0 rad from"),
        ((1.0, 2.1, 0.0), math.pi, True, "; tolerances 0.2 m and 3.14 rad"),
        ((1.0, 2.0, 0.0), 0.1, False, "0 m and 3.14 rad from the expected (1.0000 m, 2.0000 m"),
        ((1.3, 2.0, math.pi), 0.1, False, "0.3 m and 0 rad from the expected (1.0000 m, 2.0000 m"),
        ((1.3, 2.0, math.pi), 0.1, False, "; tolerances 0.2 m and 0.1 rad"),
        ((1.3, 2.0, math.pi), math.pi, False, "; tolerances 0.2 m"),
    ],
)
def test_pose(pose, angle, is_right, said):
    passed, difference = compare(Pose(*pose), Pose(1.0, 2.0, math.pi), 0.2, angle)
    assert passed == is_right and said in difference


LATE_ROW = [(2.0, 0.18, 1.0), (2.0, -0.18, 1.0), (2.0, 0.0, 5.0), (0.0, 0.0, 1.0)]


@pytest.mark.parametrize("stop", [[STOP], []])
def test_a_row_that_is_longer_in_a_plan_that_ends_with_a_stop(stop):
    rows = [(*LATE_ROW[0][:2], 1.1), *LATE_ROW[1:]]
    plan = recorded.plan_of((0, 0, 0), LATE_ROW)
    poses = replay(recorded.plan_of((0, 0, 0), rows)).poses[: len(replay(plan).poses)]
    assert judged(replay(plan, commands([*rows, *stop]), poses=poses))[0] == {}


@pytest.mark.parametrize("rows", [STANDING[:1], STANDING])
def test_a_final_stop_may_come_late(rows):
    *sent, stop = commands([*rows, STOP])
    stop = moved([stop], [10 * TENTH])[0]
    assert judged(replay(recorded.plan_of((0, 0, 0), rows), [*sent, stop]))[0] == {}


def test_a_final_stop_with_an_old_stamp():
    """A node that sends its last message again."""
    *sent, stop = COMMANDS
    stop = stop._replace(
        time=sent[-1].time, stamp=sent[-1].stamp, arrived=sent[-1].arrived + 4 * TENTH
    )
    assert judged(replay(sent=[*sent, stop]))[0] == {}


def test_pauses_between_rows():
    """The mean period contains them."""
    rows = 3 * [(2.0, 0.1, 1.0), (1.0, -0.1, 1.0)]
    sent = commands(rows)
    sent = moved(sent, [number // 10 * TENTH for number in range(len(sent))])
    failed, _ = judged(replay(recorded.plan_of((0, 0, 0), rows), sent))
    assert "row 4 (1 s): its last command comes 0.3 s late" in failed["rate"]
    assert f"come every {4.2 / 39:.4g} s; expected every 0.1 s" in failed["rate"]


def test_a_map_without_the_origin():
    """Before its start pose, the car waits at the origin."""
    seen = replay(grid=map_of(20, 20, Pose(0.5, 0.5, 0.0)))
    poses = seen.poses.copy()
    poses[:3] = 0.0
    assert judged(seen._replace(poses=poses))[0] == {}


def test_the_start_pose_as_a_row_of_a_plan_that_ends_with_a_stop():
    rows = [(2.0, 0.1, 1.0), (1.0, -0.1, 1.0), (0.0, 0.0, 1.0)]
    sent = commands([(1.0, 2.0, 1.0), *rows, STOP])
    failed, _ = judged(replay(recorded.plan_of((1.0, 2.0, 0.5), rows), sent))
    assert "The first command is the start pose" in failed["commands"]


def test_a_start_pose_with_the_first_command():
    """They can arrive at the same instant, because the clock stands while a node computes."""
    received, command = Received(), AckermannDriveStamped()
    command.drive.speed = 1.0
    received.add_command(command, BEGIN)
    received.add_initial_pose(pose_msg(1.0), BEGIN)
    assert received.start_delay and not received.start
