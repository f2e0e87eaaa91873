"""Let a node drive a plan on the simulated car, and judge it."""

import time
from typing import Dict, List, Set, Tuple

import rospy

from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.grading import files, judge
from mushr_ros_intro.grading.replay import Replay, runs_of
from mushr_ros_intro.parameters import Parameters, find_file, user_path
from mushr_ros_intro.plan.model import Plan
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.ros import node
from mushr_ros_intro.ros.candidate import Candidate
from mushr_ros_intro.ros.replay_observer import (
    CONTROL,
    POSES,
    ObservationError,
    ReplayObserver,
    wait_for,
)
from mushr_ros_intro.ros.ros_time import POLL_PERIOD
from mushr_ros_intro.sim.stamps import NANOSECONDS

START_TIMEOUT = 60.0
"""Timeout for the car and the mux, which start together with this node [s of wall-clock time]."""

DONE_AFTER = 2.5
"""After all commands, a node is done if it sends none for this time [s of wall-clock time]."""

QUIET_AFTER = 0.5
"""Without a command for this time, the clock is stepped in real time [s of wall-clock time]."""


def replay() -> Tuple[Replay, List[judge.Check]]:
    """Run the replay that the node's parameters describe.

    Raises:
        UserError: a parameter or the plan is invalid, or the replay has failed for another reason
            than the node.
    """
    parameters = node.parameters()
    plan = read_plan(find_file(parameters.text("plan_file"), node.package_folder("plans"), ".txt"))
    publisher = parameters.text("publisher")
    patience = parameters.number("patience", 30.0, "s", 0.1, 1e4)
    folder = parameters.optional_text("report")
    car = car_from(node.simulated_car_parameters("car"))
    tolerances = _tolerances(parameters, judge.default_tolerances(plan, car))

    observer = ReplayObserver(
        max(patience, START_TIMEOUT), parameters.text("map", "none") != "none"
    )
    ours = set(_publishers())
    candidate = Candidate(publisher, [f"_plan_file:={plan.path}", *observer.remappings])
    began = (time.monotonic(), rospy.get_time())
    try:
        outcome = _watch(candidate, observer, plan, patience, ours)
    finally:
        candidate.end()
    observer.take_clock()
    if observer.count_commands():
        wait_for(lambda: observer.stands(car.command_timeout), "the car to stand", START_TIMEOUT)
    elapsed, simulated = time.monotonic() - began[0], rospy.get_time() - began[1]

    seen = observer.replay(plan, car, outcome)
    checks = judge.judge(seen, tolerances)
    if folder:
        facts = {
            "plan_file": plan.path,
            "publisher": publisher,
            "car": rospy.get_param("~car", "ideal"),
            "seed": rospy.get_param("~seed", ""),
            "simulated_seconds": simulated,
            "wall_clock_seconds": elapsed,
        }
        files.write(user_path(folder), seen, checks, tolerances, facts)
    return seen, checks


def _tolerances(parameters: Parameters, default: judge.Tolerances) -> judge.Tolerances:
    """Return the tolerances; the value auto means the default."""

    def tolerance(name: str, unit: str, value: float) -> float:
        is_auto = rospy.get_param(f"~{name}", "auto") == "auto"
        return value if is_auto else parameters.number(name, value, unit, 0.0, 1e6)

    return judge.Tolerances(
        tolerance("position_tolerance", "m", default.position),
        tolerance("angle_tolerance", "rad", default.angle),
        tolerance("path_tolerance", "m", default.path),
    )


def _watch(
    candidate: Candidate, observer: ReplayObserver, plan: Plan, patience: float, ours: Set[str]
) -> str:
    """Wait until the node has driven the plan, or has failed.

    Args:
        candidate: the node.
        observer: receives the messages of the node and of the car.
        plan: the plan that the node has to drive.
        patience: the longest time without a command or a pose [s of wall-clock time].
        ours: the names of all publishing nodes except those of the candidate.

    Returns:
        A description of the node's failure; empty if there is none.

    Raises:
        ObservationError: the car failed.
    """
    expected = sum(run.expected for run in runs_of(plan))
    limit = plan.duration * 3 // 2 + 5 * NANOSECONDS
    poses, last_pose = observer.count_poses(), time.monotonic()
    observer.last_message = time.monotonic()
    while not candidate.has_ended:
        now = time.monotonic()
        count, silence = observer.count_commands(), now - observer.last_message
        if observer.count_poses() > poses:
            poses, last_pose = observer.count_poses(), now
        if now - last_pose > patience:
            raise ObservationError(f"the car reported no pose on {POSES} for {patience:g} s")
        if observer.span() > limit:
            return (
                f"the node still sends commands {(limit - plan.duration) / NANOSECONDS:g} s after "
                f"the end of the plan, which takes {plan.duration / NANOSECONDS:g} s"
            )
        if count >= expected:
            if silence > DONE_AFTER:
                return ""  # a node that has driven the plan need not end
            if silence > QUIET_AFTER:
                observer.take_clock()
        elif silence > patience:
            return _describe_silence(count, expected, patience, ours)
        if rospy.is_shutdown():
            raise ObservationError("shut down while the node drove")
        time.sleep(POLL_PERIOD)
    fault = candidate.describe_failure()
    if not fault and not observer.count_commands():
        fault = f"the node ended without publishing a command on {CONTROL}"
    return fault


def _describe_silence(count: int, expected: int, patience: float, ours: Set[str]) -> str:
    """Return a description of the failure of a node that runs, but sends nothing."""
    if count:
        return (
            f"the node hangs: {count} of {expected} commands arrived, and then none for "
            f"{patience:g} s, although the node is still running"
        )
    others = {name: topics for name, topics in _publishers().items() if name not in ours}
    topics = sorted(set().union(*others.values()) - {"/rosout"})
    return (
        f"the node runs, but published no command on {CONTROL} for {patience:g} s; "
        f"it publishes {', '.join(topics) or 'no topic at all'}"
    )


def _publishers() -> Dict[str, Set[str]]:
    """Return the topics that each node publishes, by the node's name."""
    topics: Dict[str, Set[str]] = {}
    _, _, (publishers, _, _) = rospy.get_master().getSystemState()
    for topic, names in publishers:
        for name in names:
            topics.setdefault(name, set()).add(topic)
    return topics
