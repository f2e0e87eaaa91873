"""Let a node drive a plan on the simulated car, and judge it."""

import time
from typing import Dict, Set, Tuple

import rospy

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.car.profile import car_from
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.grading.judge import Report, Tolerances, default_tolerances, judge
from mushr_ros_intro.grading.replay import Replay
from mushr_ros_intro.parameters import Parameters, find_file, user_path
from mushr_ros_intro.plan.model import Plan
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.preview.prediction import count_commands
from mushr_ros_intro.ros import node
from mushr_ros_intro.ros.candidate import Candidate
from mushr_ros_intro.ros.connections import responds
from mushr_ros_intro.ros.replay_observer import CAR, CONTROL, ReplayObserver, wait_for
from mushr_ros_intro.ros.ros_time import POLL_PERIOD
from mushr_ros_intro.sim.stamps import NANOSECONDS

DONE_AFTER = 2.5
"""After all commands, a node is done if it sends none for this time [s of wall-clock time]."""

QUIET_AFTER = 0.5
"""Without a command for this time, the clock is stepped in real time [s of wall-clock time]."""


def replay() -> Report:
    """Run the replay that the node's parameters describe, and write the report.

    Raises:
        UserError: a parameter or the plan is invalid, or the replay has failed for another reason
            than the node.
        OSError: the report cannot be written.
    """
    arguments = rospy.get_param("~")
    parameters = Parameters({name: each for name, each in arguments.items() if each != "auto"})
    plan = read_plan(find_file(parameters.text("plan_file"), node.package_folder("plans"), ".txt"))
    publisher = parameters.text("publisher")
    remap = _pairs(parameters.optional_text("remap") or "")
    patience = parameters.number("patience", 30.0, "s", 0.1, 1e4)
    has_map = parameters.text("map", "none") != "none"
    folder = parameters.optional_text("report")
    car = car_from(node.simulated_car_parameters("car"))
    default = default_tolerances(plan, car)
    tolerances = Tolerances(
        parameters.number("position_tolerance", default.position, "m", 0.0, 1e6),
        parameters.number("angle_tolerance", default.angle, "rad", 0.0, 1e6),
        parameters.number("path_tolerance", default.path, "m", 0.0, 1e6),
    )
    title = f"{publisher} drives {plan.path} with the car {parameters.text('car')}:"
    replay = observe(plan, car, publisher, remap, patience, has_map)
    report = judge(replay, tolerances)._replace(title=title)
    if folder:
        from mushr_ros_intro.grading import files  # matplotlib is slow to import

        files.write(user_path(folder), report, arguments)
    return report


def _pairs(text: str) -> Dict[str, str]:
    """Return remappings and parameters by name, given text such as "control=/cmd _rate=10".

    Raises:
        UserError: a word has another form.
    """
    pairs = {}
    for word in text.split():
        name, _, value = word.partition("=")
        if not (name and value) or ":" in word:
            raise UserError(f"remap contains '{word}'; expected FROM=TO, such as control=/cmd")
        pairs[name] = value
    return pairs


def observe(
    plan: Plan, car: Car, publisher: str, remap: Dict[str, str], patience: float, has_map: bool
) -> Replay:
    """Let a node drive a plan, and return what was recorded.

    Args:
        plan: the plan that the node has to drive.
        car: the car.
        publisher: the node, "PACKAGE NODE [ARGUMENT...]".
        remap: remappings and parameters of the node, by name.
        patience: the longest time without a command [s of wall-clock time].
        has_map: whether there is a map.

    Raises:
        UserError: the node cannot be started, or the car or the mux does not respond.
    """
    observer = ReplayObserver(has_map)
    known = _publications()
    ours = observer.remappings
    # ROS remaps a name only once, so the node's own remappings lead to our topics at once.
    pairs = {**{name: ours.get(value, value) for name, value in remap.items()}, **ours}
    arguments = [f"{name}:={value}" for name, value in pairs.items()]
    candidate = Candidate(publisher, [f"_plan_file:={plan.path}", *arguments])
    try:
        outcome = _watch(candidate, observer, plan, patience, known)
    finally:
        candidate.end()
    observer.take_clock()
    if observer.sent:
        wait_for(lambda: observer.stands(car.command_timeout), "the car to stand")
    return observer.replay(plan, car, outcome)


def _watch(
    candidate: Candidate,
    observer: ReplayObserver,
    plan: Plan,
    patience: float,
    known: Set[Tuple[str, str]],
) -> str:
    """Wait until the node has driven the plan, or has failed.

    Args:
        candidate: the node.
        observer: receives the messages of the node and of the car.
        plan: the plan that the node has to drive.
        patience: the longest time without a command [s of wall-clock time].
        known: all publications except those of the candidate.

    Returns:
        A description of the node's failure; empty if there is none.

    Raises:
        UserError: the car has died.
    """
    expected = count_commands(plan)
    limit = plan.duration * 3 // 2 + 5 * NANOSECONDS
    sent, began = observer.sent, time.monotonic()
    while not candidate.has_ended:
        silence = time.monotonic() - max(began, observer.last_message)
        if sent and sent[-1].time - sent[0].time > limit:
            return (
                f"the node still sends commands {(limit - plan.duration) / NANOSECONDS:g} s after "
                f"the end of the plan, which takes {plan.duration / NANOSECONDS:g} s"
            )
        if len(sent) >= expected:
            if silence > DONE_AFTER:
                return ""  # a node that has driven the plan need not end
            if silence > QUIET_AFTER:
                observer.take_clock()
        elif silence > patience:
            if not responds(CAR):
                raise UserError(f"the simulated car {CAR} has died, so the node is not judged")
            return _describe_silence(len(sent), expected, patience, known)
        time.sleep(POLL_PERIOD)
    fault = candidate.describe_failure()
    return fault or ("" if sent else f"the node ended without publishing a command on {CONTROL}")


def _describe_silence(
    count: int, expected: int, patience: float, known: Set[Tuple[str, str]]
) -> str:
    """Return a description of the failure of a node that runs, but sends nothing."""
    if count:
        return (
            f"the node hangs: {count} of {expected} commands arrived, and then none for "
            f"{patience:g} s, although the node is still running"
        )
    topics = {topic for topic, _ in _publications() - known} - {"/rosout"}
    return (
        f"the node runs, but published no command on {CONTROL} for {patience:g} s; "
        f"it publishes {', '.join(sorted(topics)) or 'no topic at all'}"
    )


def _publications() -> Set[Tuple[str, str]]:
    """Return the topic and the node of each publisher."""
    _, _, (publishers, _, _) = rospy.get_master().getSystemState()
    return {(topic, name) for topic, names in publishers for name in names}
