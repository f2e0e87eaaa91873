"""From facts to findings: one test for each, which changes one fact of a healthy system."""

from dataclasses import replace

import pytest

from mushr_ros_intro.doctor import facts as diagnosis
from mushr_ros_intro.doctor.facts import (
    Clock,
    Facts,
    Finding,
    Input,
    Master,
    Source,
    Topic,
)
from mushr_ros_intro.doctor.rules import diagnose, health, program_fault

S = 1_000_000_000
"""[ns]"""
NOW = 1_700_000_000 * S

KIND, MD5 = "ackermann_msgs/AckermannDriveStamped", "1fd5d7f58889cefd44d29f6653240d0c"
MUX, CAR = "/car/mux/ackermann_cmd_mux", "/car/car_sim"
PLAN = Source("/path_publisher", KIND, MD5, (NOW, NOW + S // 10), (2.0, 2.0))
KEYS = Source("/car/teleop", KIND, MD5)
HERE = Master("http://localhost:11311")


def an_input(name, *sources):
    return Input(name, Topic(f"{MUX}/input/{name}", KIND, MD5, sources, (MUX,)))


OUTPUT = Topic(f"{MUX}/output", KIND, MD5, (Source(MUX, KIND, MD5),), (CAR,))
PAST = Input("output", OUTPUT._replace(sources=()))
TELEOP = an_input("teleop", KEYS)
HEALTHY = Facts(
    "car",
    HERE,
    inputs=(PAST, TELEOP, an_input("navigation", PLAN)),
    output=OUTPUT,
    placement=Topic("/initialpose", "geometry_msgs/PoseWithCovarianceStamped", "x", (), (CAR,)),
    active="navigation",
    now=(NOW, NOW + S),
    listened=1.5,
    pose="(1, 2, 3)",
    moves=True,
)


def with_plan(**changes):
    """Return the inputs, with another path_publisher; None: without one."""
    return (PAST, TELEOP, an_input("navigation", PLAN._replace(**changes)))


STILL = {"inputs": (PAST, an_input("teleop"), an_input("navigation")), "moves": False}
"""Nobody publishes."""


def the_finding(**changes):
    (finding,) = diagnose(replace(HEALTHY, **changes))
    return str(finding)


def test_nothing_is_wrong():
    assert diagnose(HEALTHY) == []
    assert health(HEALTHY) == "nothing is wrong: the car is driven by /path_publisher, and it moves"
    assert health(replace(HEALTHY, moves=None)) == (
        "nothing is wrong: the car is driven by /path_publisher"
    )


@pytest.mark.parametrize(
    "changes, words, remedy",
    [
        (
            {"master": HERE._replace(trouble=diagnosis.NO_MASTER)},
            "ROS_MASTER_URI is http://localhost:11311, and no master answers there",
            "roslaunch mushr_ros_intro sim.launch",
        ),
        (
            {"master": HERE._replace(trouble=diagnosis.SILENT_MASTER)},
            "the master there does not answer",
            "fg",
        ),
        (
            {"master": Master("http://far:11311", diagnosis.NO_MASTER, False)},
            "ROS_MASTER_URI is http://far:11311, and no master answers there",
            "export ROS_MASTER_URI=http://localhost:11311",
        ),
        (
            {"master": Master("http://far:1", "nobody knows far", False, "http://localhost:11311")},
            "but a master runs on this machine",
            "export ROS_MASTER_URI=http://localhost:11311",
        ),
        (
            {"master": Master("localhost", diagnosis.MALFORMED)},
            "that is no address",
            "export ROS_MASTER_URI=http://localhost:11311",
        ),
        (
            {"dead": (("/rviz", diagnosis.REFUSED),)},
            "the master knows /rviz, but nothing answers",
            "rosnode cleanup",
        ),
        ({"dead": (("/rviz", diagnosis.STOPPED),)}, "it does not answer", "fg"),
        ({"dead": (("/rviz", diagnosis.UNKNOWN_HOST),)}, "does not know the name", "ROS_IP"),
        ({"clock": Clock()}, "nobody publishes /clock", "rosparam set use_sim_time false"),
        (
            {"clock": Clock((CAR,), False, "/car/car_sim/resume")},
            "the clock is held: /clock comes from /car/car_sim and does not move",
            "rosservice call /car/car_sim/resume",
        ),
        (
            {"clock": Clock(("/bag",), False)},
            "the clock is held: /clock comes from /bag",
            "space bar",
        ),
        (
            {"output": OUTPUT._replace(subscribers=())},
            f"nobody subscribes to {MUX}/output: the car 'car' is not running",
            "roslaunch mushr_ros_intro sim.launch",
        ),
        (
            {"inputs": (PAST, Input("navigation", Topic("/nav", KIND, MD5)))},
            "nobody subscribes to /nav: the mux is not running for the car 'car'",
            "roslaunch mushr_ros_intro sim.launch",
        ),
        (
            {
                "car": "car2",
                "inputs": (PAST, Input("navigation", Topic("/nav", KIND, MD5))),
                "output": OUTPUT._replace(subscribers=()),
                "other_cars": ("car",),
                "master": HERE._replace(other="http://localhost:11311"),
            },
            "neither mux nor car is running for the car 'car2'; what runs is car; another",
            "sim.launch car_name:=car2, or doctor.py --car car, or export ROS_MASTER_URI=http",
        ),
        (
            {**STILL, "strays": (("/cmd", ("/student",)),)},
            "the commands of /student go nowhere: nobody subscribes to /cmd",
            f"/cmd:={MUX}/input/navigation",
        ),
        (
            {"inputs": with_plan(kind="std_msgs/String", md5sum="s"), "moves": False},
            f"/path_publisher publishes std_msgs/String on {MUX}/input/navigation, where {MUX} "
            f"expects {KIND}",
            f"Publish {KIND}",
        ),
        (
            {
                "inputs": with_plan(kind="std_msgs/String", md5sum="s", stamps=(), speeds=()),
                "moves": False,
            },
            "/path_publisher publishes std_msgs/String",
            f"Publish {KIND}",
        ),
        (
            {"output": OUTPUT._replace(sources=(Source("/direct", "a/B", "y"),))},
            f"/direct publishes a/B on {MUX}/output, where {CAR} expects {KIND}",
            f"Publish {KIND}",
        ),
        (
            {"placement": HEALTHY.placement._replace(sources=(Source("/place", "a/B", "y"),))},
            "/place publishes a/B on /initialpose, where /car/car_sim expects geometry_msgs/Pose",
            "Publish geometry_msgs/PoseWithCovarianceStamped",
        ),
        (
            {"inputs": with_plan(md5sum="other"), "moves": False},
            f"/path_publisher was built with another definition of {KIND} (MD5 sum other; here it "
            f"is {MD5})",
            "catkin_make",
        ),
        (
            STILL,
            f"nobody publishes commands: {MUX}/input/navigation has no publisher",
            "roslaunch mushr_ros_intro path_publisher.launch plan_file:=figure_8",
        ),
        (
            {"inputs": with_plan(stamps=(), speeds=()), "moves": False},
            "no command came in 1.5 s, though there is /car/teleop and /path_publisher to send",
            "hold one down",
        ),
        (
            {"active": "teleop"},
            "the mux's input teleop is held by /car/teleop, so the commands of /path_publisher do "
            "not reach the car",
            "rosnode kill /car/teleop",
        ),
        (
            {
                "inputs": (
                    PAST,
                    an_input(
                        "teleop",
                        Source("/quiet", KIND, MD5),
                        KEYS._replace(stamps=(NOW,), speeds=(1.0,)),
                    ),
                    an_input("navigation", PLAN),
                ),
                "active": "teleop",
            },
            "input teleop is held by /car/teleop, so the commands of /path_publisher do not reach",
            "rosnode kill /car/teleop",
        ),
        (
            {"inputs": with_plan(speeds=(0.0, 0.0))},
            "every command of /path_publisher has the speed 0",
            "msg.drive.speed",
        ),
        (
            {"inputs": with_plan(stamps=(NOW, 0))},
            "/path_publisher sends commands with stamp 0",
            "msg.header.stamp = rospy.Time.now()",
        ),
        (
            {"inputs": with_plan(stamps=(NOW + 5 * S // 2,))},
            "/path_publisher stamps its commands +1.5 s from the clock of this machine",
            "ntpdate",
        ),
        (
            {"inputs": with_plan(stamps=(NOW - 3 * S // 2,)), "clock": Clock((CAR,), True)},
            "/path_publisher stamps its commands -1.5 s from /clock",
            "started after use_sim_time",
        ),
        (
            {"contact": "(9, 8, 7)"},
            "the car stands against a wall at (9, 8, 7)",
            "rosservice call /car/car_sim/reset",
        ),
        ({"faults": (Finding("a file", "Mend it"),)}, "a file. Mend it", "Mend it"),
        (
            {"moves": False},
            "commands come from /path_publisher and the car stands all the same",
            f"rostopic echo {MUX}/output",
        ),
    ],
)
def test_each_finding(changes, words, remedy):
    said = the_finding(**changes)
    assert words in said
    assert remedy in said[said.index(words) :]
    assert "\n" not in said


@pytest.mark.parametrize(
    "changes",
    [
        {"active": "idle"},  # between two commands
        {"moves": None},  # a car that reports no pose
        {"clock": Clock((CAR,), True)},
        {"inputs": with_plan(stamps=(NOW - S, NOW + 2 * S))},  # within the tolerance of the window
        {"inputs": with_plan(stamps=(NOW - 5 * S, NOW))},  # one was late
        {"inputs": with_plan(speeds=(0.0, -0.1))},
        {"inputs": (PAST, an_input("teleop", Source("/keys")), an_input("navigation", PLAN))},
        {"now": None},  # there is no clock to compare with
        {"other_cars": ("car2",)},
        {"strays": (("/cmd", ("/student",)),)},  # what drives the car is another node
        {"master": HERE._replace(other="http://localhost:11311")},
    ],
)
def test_what_is_no_finding(changes):
    assert diagnose(replace(HEALTHY, **changes)) == []


def test_who_goes_past_the_mux_counts_as_driving():
    output = Input("output", OUTPUT._replace(sources=(PLAN._replace(node="/direct"),)))
    facts = replace(HEALTHY, inputs=(output, TELEOP, an_input("navigation")), active="idle")
    assert diagnose(facts) == []
    assert "by /direct" in health(facts)
    without_mux = (output, Input("navigation", Topic("/nav", KIND, MD5)))
    assert diagnose(replace(facts, inputs=without_mux)) == []


def test_what_is_wrong_with_the_files_is_said_without_a_master_too():
    master = HERE._replace(trouble=diagnosis.NO_MASTER)
    said = diagnose(replace(HEALTHY, master=master, faults=(Finding("a file", "Mend it"),)))
    assert [each.what for each in said][0] == "a file"
    assert len(said) == 2


@pytest.mark.parametrize("node", ["/path_publisher", MUX, CAR])
def test_what_follows_from_a_dead_node_is_not_said(node):
    said = the_finding(
        inputs=with_plan(stamps=(), speeds=()),
        dead=((node, diagnosis.REFUSED),),
        clock=Clock((node,)),
        moves=None,
    )
    assert f"the master knows {node}" in said


def test_what_follows_from_a_held_clock_is_not_said():
    inputs = with_plan(stamps=(), speeds=())
    assert "the clock is held" in the_finding(inputs=inputs, clock=Clock((CAR,)), moves=False)


def test_commands_that_come_all_the_same_are_judged_beside_a_held_clock():
    inputs = with_plan(speeds=(0.0,))
    clock, speed = diagnose(replace(HEALTHY, inputs=inputs, clock=Clock((CAR,)), moves=False))
    assert "the clock is held" in str(clock)
    assert "has the speed 0" in str(speed)


@pytest.mark.parametrize(
    "is_executable, line, words",
    [
        (True, b"import rospy\n", "does not say what runs it"),
        (True, b"#!/usr/bin/env python\n", "is to be run by python, which is not there"),
        (True, b"#!/opt/python\n", "is to be run by /opt/python, which is not there"),
        (True, b"#!/opt/env python3\n", "is to be run by /opt/env, which is not there"),
        (True, b"#!\n", "is to be run by nothing"),
        (True, b"#!/usr/bin/python3\r\n", "line ends of Windows"),
        (False, b"#!/usr/bin/python3\n", "is not executable. Type: chmod +x '/w s/a.py'"),
        (True, b"#!/usr/bin/python3 -u\n", None),
        (True, b"#! /usr/bin/env -S python3 -u\n", None),
    ],
)
def test_programs(is_executable, line, words):
    there = ("/usr/bin/python3", "/usr/bin/env", "python3")
    fault = program_fault("/w s/a.py", is_executable, line, lambda name: name in there)
    assert str(fault).startswith("/w s/a.py ") if words else fault is None
    assert not words or words in str(fault)
