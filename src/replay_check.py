#!/usr/bin/python3
"""Let a node drive a plan or follow a path, and judge it: the test node of replay.test.

The parameters are private, and are documented in replay.test. The results are written as a JUnit
file with one test case for each check. The verdict is also published on ~verdict
(std_msgs/String, latched). rostest hides the output of test nodes, so another node,
replay_check.py --show, prints it on the terminal.

Example: rostest mushr_ros_intro replay.test plan_file:=test_drive
    publisher:="my_ros_intro path_publisher.py"
"""

import argparse
import shlex
import sys
from contextlib import suppress
from typing import List, Optional

import rospy
from std_msgs.msg import String

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.isolation.workspace import inherited
from mushr_ros_intro.parameters import REQUIRED, Parameters, number, text
from mushr_ros_intro.paths import package_folder, user_path
from mushr_ros_intro.plan.parse import read_named_plan
from mushr_ros_intro.replay.job import run_job
from mushr_ros_intro.replay.judge import Check, Judgement
from mushr_ros_intro.replay.reference import Exercise, Reference, read_references, refuse_walls
from mushr_ros_intro.replay.report_files import write_report
from mushr_ros_intro.replay.setting import job_for, read_setting
from mushr_ros_intro.ros import node
from mushr_ros_intro.ros.junit import write_junit
from mushr_ros_intro.ros.ros_time import wait_for

SHOW_TIMEOUT = 5.0
"""Longest wait until the verdict has been printed [s of wall-clock time]."""

PARAMETERS = (
    text("plan_file", None),
    text("follow", None),
    text("publisher", REQUIRED),
    number("position_tolerance", None, "m", 0.0, 1e6),
    text("car", REQUIRED),
    text("map", None),
    text("remap", None),
    text("report", None),
)


def show() -> int:
    """Print the verdict; return 0."""
    node.init_node("verdict")
    print(rospy.wait_for_message("/replay/verdict", String).data, flush=True)
    return 0


def judge() -> Judgement:
    """Judge the node that the parameters describe, and write the judgement.

    Raises:
        UserError: a parameter or the plan is invalid, or the replay has failed for another reason
            than the node.
        OSError: the report cannot be written.
    """
    arguments = rospy.get_param("~", {})
    given = {name: each for name, each in arguments.items() if each not in ("", "auto")}
    parameters = Parameters(given)
    values = parameters.read(PARAMETERS)
    exercise = _exercise(values["plan_file"], values["follow"])
    words: List[str] = []
    with suppress(ValueError):  # a quotation mark is missing
        words = shlex.split(values["publisher"])
    if len(words) < 2:
        raise parameters.error("publisher", "'PACKAGE NODE [ARGUMENT...]'")
    position = values["position_tolerance"]
    setting = read_setting(
        package_folder("."),
        values["car"],
        values["map"] or ("none" if isinstance(exercise, Reference) else "sandbox"),
        remap=tuple(_remappings(values["remap"] or "")),
        tolerances={} if position is None else {"position": position},
        sandbox=Sandbox(),
        ros=inherited(),
    )
    refuse_walls([exercise], setting.parameters, setting.grid)
    judgement = run_job(job_for(words, exercise, setting))
    if values["report"]:
        write_report(user_path(values["report"]), judgement)
    return judgement


def _exercise(plan: Optional[str], path: Optional[str]) -> Exercise:
    """Return the plan that the node drives, or the path that it follows; raise UserError."""
    if plan and not path:
        return read_named_plan(plan)
    if path and not plan:
        return next(iter(read_references([path], package_folder("plans")).values()))
    raise UserError("expected either plan_file:=PLAN or follow:=PATH")


def _remappings(text: str) -> List[str]:
    """Return remappings and parameters, given text such as "control=/cmd _rate=10".

    Raises:
        UserError: a word has another form.
    """
    remappings = []
    for word in text.split():
        name, _, value = word.partition("=")
        if not (name and value) or ":" in word:
            raise UserError(f"remap contains '{word}'; expected FROM=TO, such as control=/cmd")
        remappings.append(f"{name}:={value}")
    return remappings


def publish(text: str) -> None:
    """Publish the verdict, and wait until it has been printed."""
    publisher = rospy.Publisher("~verdict", String, queue_size=1, latch=True)
    publisher.publish(text)
    if wait_for(publisher.get_num_connections, SHOW_TIMEOUT):
        wait_for(lambda: not publisher.get_num_connections(), SHOW_TIMEOUT)


def main() -> int:
    """Judge a node; return 0 if it passes all checks, else 1."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser("replay_check.py", description=__doc__, formatter_class=form)
    parser.add_argument("--gtest_output", metavar="xml:FILE", help="write the results to this file")
    parser.add_argument("--show", action="store_true", help="print the verdict of another node")
    arguments = parser.parse_args(rospy.myargv()[1:])
    if arguments.show:
        return show()
    node.init_node("replay")
    try:
        judgement = judge()
        checks, text = judgement.checks, judgement.verdict
    except (UserError, OSError) as error:
        checks = [Check("replay", False, str(error))]
        text = checks[0].message
    print(text, flush=True)
    publish(text)
    if arguments.gtest_output:
        failures = {check.name: None if check.passed else check.message for check in checks}
        write_junit(arguments.gtest_output.partition(":")[2], "replay", failures, text)
    return int(not all(check.passed for check in checks))


if __name__ == "__main__":
    sys.exit(main())
