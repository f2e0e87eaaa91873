"""Derive findings from facts about commands and start poses, and about the nodes that send them."""

import math
from difflib import get_close_matches
from typing import List

from mushr_ros_intro.doctor.facts import MANUAL_INPUTS, Facts, Finding, Publisher, listed, names
from mushr_ros_intro.plan.plan import MAX_STEERING_ANGLE
from mushr_ros_intro.ros.commands import drive_command
from mushr_ros_intro.stamps import NANOSECONDS, STAMP_TOLERANCE

_JOYSTICK = (
    "MuSHR's joystick node sends stops until a button is held: RB for commands of other nodes, LB "
    "to drive with the joystick"
)

_MAX_GAP = 22 * NANOSECONDS // 100
"""Commands that are further apart stop the car in between [ns]. The timeout of the mux is 0.2 s."""


def command_findings(facts: Facts, package: str, has_cause: bool) -> List[Finding]:
    """Return what is wrong with the commands and the start poses that nodes send.

    Args:
        facts: the observed state of the system.
        package: the package of the user's node, if it is known.
        has_cause: whether a finding explains why no node sends commands.
    """
    found = _ineffective(facts) if facts.senders else _strays(facts)
    if not (facts.senders or found or has_cause):
        found = _unpublished(facts) or [_no_commands(facts, package)]
    for sender in facts.senders:
        found += _wrong_stamps(sender, facts) + _wrong_values(sender) + _wrong_rate(sender, facts)
    return found + _stray_poses(facts)


def rivals(facts: Facts) -> List[Finding]:
    """Find nodes that drive the car at the same time through the same input."""
    return [
        Finding(
            f"{names(topic.senders)} drive the car at the same time: all send commands on "
            f"{topic.name}, and the car gets all of them",
            f"Stop one of them; type: rosnode kill {names(topic.senders, ' or rosnode kill ')}",
        )
        for topic in facts.inputs.values()
        if len(topic.senders) > 1
    ]


def _strays(facts: Facts) -> List[Finding]:
    return [
        Finding(
            f"the commands of {listed(nodes) or 'a node that has ended'} have no effect: no node "
            f"subscribes to {topic}",
            f"Send them to the car '{facts.car}': in the node or its launch file, correct the "
            f"topic to {_closest(topic, facts)}. To connect it without a change, add to its <node> "
            f'in the launch file: <remap from="{topic}" to="{_closest(topic, facts)}" />; with '
            f"rosrun, add the argument {topic}:={_closest(topic, facts)}",
        )
        for topic, nodes in facts.strays.items()
    ]


def _closest(topic: str, facts: Facts) -> str:
    """Return the topic of commands with the name that is most like `topic`."""
    topics = [each.name for each in facts.inputs.values() if each.name != facts.output.name]
    return next(iter(get_close_matches(topic, topics, 1)), facts.control_topic)


def _unpublished(facts: Facts) -> List[Finding]:
    return [
        Finding(
            f"{listed(nodes)} subscribes to {topic}, which no node publishes, and may wait for it",
            "Start the node that publishes it, or correct the name; to see the topics that are "
            "published, type: rostopic list -p",
        )
        for topic, nodes in facts.unpublished.items()
    ]


def _stray_poses(facts: Facts) -> List[Finding]:
    expected = facts.initial_pose.name
    return [
        Finding(
            f"the start poses of {listed(nodes)} have no effect: no node subscribes to {topic}",
            f"Publish them on {expected}; with rosrun, add the argument {topic}:={expected}",
        )
        for topic, nodes in facts.stray_poses.items()
    ]


def _ineffective(facts: Facts) -> List[Finding]:
    """Find why the commands that are sent do not drive the car."""
    active = facts.inputs.get(facts.active)
    if active:
        lower = list(facts.inputs.values())[list(facts.inputs).index(facts.active) + 1 :]
        blocked = [each for topic in lower for each in topic.senders if each in facts.senders]
        holders = active.senders or active.publishers
        if blocked:
            problem = (
                f"the input '{facts.active}' of the mux has a higher priority and is in use by "
                f"{names(holders)}, so the commands of {names(blocked)} do not reach the car"
            )
            remedy = f"Stop driving there, or type: rosnode kill {names(holders, ' ')}"
            if active.senders and not any(speed for each in holders for speed in each.speeds):
                remedy = f"{_JOYSTICK}. {remedy}"
            return [Finding(problem, remedy)]
    if not any(speed for each in facts.senders for speed in each.speeds):
        problem = f"all commands of {names(facts.senders)} have speed 0"
        remedy = "Set msg.drive.speed [m/s] before you publish"
        if active and active.senders and facts.active.startswith("teleop"):
            remedy = _JOYSTICK
        return [Finding(problem, remedy)]
    return []


def _no_commands(facts: Facts, package: str) -> Finding:
    silent = {
        name: [each for each in topic.publishers if not each.stamps]
        for name, topic in facts.inputs.items()
    }
    people = [each for name in MANUAL_INPUTS for each in silent.pop(name, ())]
    nodes = names(each for publishers in silent.values() for each in publishers)
    if nodes:
        return Finding(
            f"no commands arrived from {nodes}",
            "Read the node's terminal, and check that its loop calls publish",
        )
    own = drive_command(facts.car)
    if f"/{facts.car}/car_sim" not in facts.output.subscribers:  # maybe an actual car
        own = "roslaunch mushr_ros_intro real_car.launch plan_file:=my_plan.txt in scripts/shell, "
        own += "without --tutorial (see car.md)"
    remedy = f"Start the node of {package}, and read its terminal"
    if not package:
        remedy = "Start your node, and read its terminal. To find out why it does not start, type: "
        remedy += "rosrun mushr_ros_intro doctor.py --package THE_PACKAGE_OF_YOUR_NODE"
    if people:
        remedy += f". To drive with {names(people)}, hold a key down in its window or page, or on "
        remedy += "MuSHR's joystick hold LB"
    return Finding(
        f"no node publishes commands: {facts.control_topic} has no publisher",
        f"{remedy}. To drive with this package's node, type: {own}",
    )


def _wrong_stamps(sender: Publisher, facts: Facts) -> List[Finding]:
    if 0 in sender.stamps:
        return []
    arrivals = [(each, each) for each in sender.arrivals]
    if facts.clock:  # the time of each arrival is not known
        window = facts.clock.window
        arrivals = [window] * len(sender.stamps) if window else []
    pairs = list(zip(sender.stamps, arrivals))
    ahead = min((stamp - end for stamp, (_, end) in pairs), default=0)
    behind = min((begin - stamp for stamp, (begin, _) in pairs), default=0)
    if max(ahead, behind) <= STAMP_TOLERANCE:
        return []
    offset = f"{max(ahead, behind) / NANOSECONDS:.1f} s "
    offset += "ahead of" if ahead > behind else "behind"
    offset = f"at least {offset}" if facts.clock else offset
    clock = "/clock" if facts.clock else "the clock of this machine"
    remedy = "Stamp with rospy.Time.now(), and start the node after use_sim_time is set"
    if not facts.clock:
        remedy = (
            "Stamp with rospy.Time.now(). If the node does so and runs on another machine, "
            "synchronise the clocks of both; on each, type: sudo apt-get install chrony"
        )
    return [Finding(f"the stamps of the commands of {sender.node} are {offset} {clock}", remedy)]


def _wrong_values(sender: Publisher) -> List[Finding]:
    """Find steering angles that cannot be radians."""
    largest = max(map(abs, sender.steering_angles), default=0.0)
    if largest < math.pi / 2:
        return []
    return [
        Finding(
            f"{sender.node} sends steering angles up to {largest:g} rad; the car steers at "
            f"most {MAX_STEERING_ANGLE:g} rad",
            "If they are degrees, use math.radians; or are drive.speed and drive.steering_angle "
            "swapped?",
        )
    ]


def _wrong_rate(sender: Publisher, facts: Facts) -> List[Finding]:
    """Find commands that are so rare that the car stops after each one, except those of people."""
    if sender.shortest_gap <= _MAX_GAP or sender in facts.manual_senders:
        return []
    if facts.clock and (0 in sender.stamps or _wrong_stamps(sender, facts)):
        return []  # only right stamps show the rate in simulated time
    seconds = sender.shortest_gap / NANOSECONDS
    problem = (
        f"{sender.node} sends a command every {seconds:.2g} s, but the mux stops the car 0.2 s "
    )
    remedy = "Repeat each command at 10 Hz: call publish in a loop with rospy.Rate(10)"
    return [Finding(f"{problem}after each one", remedy)]
