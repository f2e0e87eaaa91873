"""Say in plain words why the car does not move, and what to type: from facts to findings."""

import shlex
from typing import Callable, Iterable, List, Optional, Set

from mushr_ros_intro.doctor.facts import (
    MALFORMED,
    REFUSED,
    SILENT_MASTER,
    STOPPED,
    UNKNOWN_HOST,
    USUAL_MASTER,
    Clock,
    Facts,
    Finding,
    Master,
    Source,
)
from mushr_ros_intro.sim.stamps import NANOSECONDS, STAMP_TOLERANCE

_DEAD_REMEDIES = {
    REFUSED: "Start it again; so that the old one is forgotten, type: rosnode cleanup",
    STOPPED: "If Ctrl-Z stopped it, in its terminal type: fg",
    UNKNOWN_HOST: "Set ROS_IP there to that machine's address, and start it again",
}


def diagnose(facts: Facts) -> List[Finding]:
    """Return what keeps the car from moving, the cause before what follows from it."""
    found = list(facts.faults)
    if facts.master.trouble:
        return found + [_no_master(facts.master)]
    dead = {node for node, _ in facts.dead}
    found += _dead_nodes(facts)
    stands_still = [] if facts.clock is None else _clock(facts.clock, dead)
    found += stands_still
    is_there = bool(facts.output.subscribers) and (_has_mux(facts) or bool(_senders(facts)))
    found += [] if is_there else [_nobody_listens(facts)]
    strays = [] if _senders(facts) else _strays(facts)
    found += strays
    mistyped = _wrong_types(facts)
    found += mistyped
    # Where time stands still or a node on the way is dead, there are no commands for that reason.
    explained = bool(stands_still) or not dead.isdisjoint(_on_the_way(facts))
    if is_there and not mistyped and not strays and (_senders(facts) or not explained):
        found += _commands(facts)
    found += _stamps(facts)
    if facts.contact:
        found.append(
            Finding(
                f"the car stands against a wall at {facts.contact}",
                "Drive it backwards, place it elsewhere with rviz's 2D Pose Estimate, or type: "
                f"rosservice call /{facts.car}/car_sim/reset",
            )
        )
    if not found and facts.moves is False:
        found.append(
            Finding(
                f"commands come from {_names(_senders(facts))} and the car stands all the same",
                "See what the terminals of the car and the mux say, and what arrives: "
                f"rostopic echo {facts.output.name}",
            )
        )
    return found


def health(facts: Facts) -> str:
    """Return the one line about a system in which nothing is wrong."""
    line = f"nothing is wrong: the car is driven by {_names(_senders(facts))}"
    return f"{line}, and it moves" if facts.moves else line


def program_fault(
    path: str, is_executable: bool, first_line: bytes, exists: Callable[[str], bool]
) -> Optional[Finding]:
    """Return why a program cannot be started, None if it can.

    Args:
        path: of the file.
        is_executable: whether it may be executed.
        first_line: of the file, with its end.
        exists: says of an interpreter, a path or a name to be looked for, whether it is there.
    """
    quoted = shlex.quote(path)
    if not first_line.startswith(b"#!"):
        return Finding(
            f"{path} does not say what runs it", "Make its first line: #!/usr/bin/python3"
        )
    if first_line.endswith(b"\r\n"):
        return Finding(
            f"{path} has the line ends of Windows, with which its first line names no program",
            rf"Type: sed -i 's/\r$//' {quoted}",
        )
    words = first_line[2:].decode(errors="replace").split()
    if words and words[0].endswith("/env") and exists(words[0]):
        words = [each for each in words[1:] if not each.startswith("-")]
    if not words or not exists(words[0]):
        name = words[0] if words else "nothing"
        return Finding(
            f"{path} is to be run by {name}, which is not there",
            "Make its first line: #!/usr/bin/python3",
        )
    if not is_executable:
        return Finding(f"{path} is not executable", f"Type: chmod +x {quoted}")
    return None


def _no_master(master: Master) -> Finding:
    """Say that there is no master."""
    what = f"ROS_MASTER_URI is {master.uri}, and {master.trouble}"
    if master.other:
        return Finding(
            f"{what}, but a master runs on this machine",
            f"Type: export ROS_MASTER_URI={master.other}",
        )
    if master.trouble == MALFORMED:
        return Finding(what, f"Type: export ROS_MASTER_URI={USUAL_MASTER}")
    if master.trouble == SILENT_MASTER:
        return Finding(what, _DEAD_REMEDIES[STOPPED])
    if master.is_here:
        return Finding(what, "Type: roslaunch mushr_ros_intro sim.launch")
    return Finding(
        what,
        "Start the master there; or, to have it on this machine, type: "
        f"export ROS_MASTER_URI={USUAL_MASTER}",
    )


def _dead_nodes(facts: Facts) -> List[Finding]:
    """Find the nodes that the master knows and nobody reaches."""
    return [
        Finding(f"the master knows {node}, but {trouble}", _DEAD_REMEDIES[trouble])
        for node, trouble in facts.dead
    ]


def _clock(clock: Clock, dead: Set[str]) -> List[Finding]:
    """Find what is wrong with simulated time, unless it is that who keeps it is dead."""
    if not clock.sources:
        return [
            Finding(
                "use_sim_time is true, but nobody publishes /clock, so time stands still",
                "End every node; then, for wall-clock time, type: rosparam set use_sim_time false; "
                "or, for simulated time: roslaunch mushr_ros_intro sim.launch use_sim_time:=true",
            )
        ]
    if not clock.moves and dead.isdisjoint(clock.sources):
        return [
            Finding(
                f"the clock is held: /clock comes from {_list(clock.sources)} and does not move",
                f"Type: rosservice call {clock.resume}"
                if clock.resume
                else "Let it go where that runs, such as with the space bar in rosbag's terminal",
            )
        ]
    return []


def _nobody_listens(facts: Facts) -> Finding:
    """Say that the car or the mux is not there."""
    named = "" if facts.car == "car" else f" car_name:={facts.car}"
    what = f"nobody subscribes to {facts.output.name}: the car '{facts.car}' is not running"
    if not _has_mux(facts):
        topic = _control_topic(facts)
        missing = "the mux is not" if facts.output.subscribers else "neither mux nor car is"
        what = f"nobody subscribes to {topic}: {missing} running for the car '{facts.car}'"
    remedies = [f"Type: roslaunch mushr_ros_intro sim.launch{named}"]
    if facts.other_cars:
        what += f"; what runs is {_list(facts.other_cars)}"
        remedies.append(f"doctor.py --car {facts.other_cars[0]}")
    if facts.master.other:
        what += f"; another master runs at {facts.master.other}"
        remedies.append(f"export ROS_MASTER_URI={facts.master.other}")
    return Finding(what, ", or ".join(remedies))


def _strays(facts: Facts) -> List[Finding]:
    """Find who sends commands where nobody listens."""
    return [
        Finding(
            f"the commands of {_list(nodes)} go nowhere: nobody subscribes to {topic}",
            f"Send them where the car '{facts.car}' gets them, by starting the node again with: "
            f"{topic}:={_control_topic(facts)}",
        )
        for topic, nodes in facts.strays
    ]


def _wrong_types(facts: Facts) -> List[Finding]:
    """Find who publishes other messages than the subscribers of the topic take."""
    found = []
    for topic in [*(each.topic for each in facts.inputs), facts.output, facts.placement]:
        for source in topic.sources:
            if not source.kind or source.md5sum == topic.md5sum:
                continue
            if source.kind != topic.kind:
                found.append(
                    Finding(
                        f"{source.node} publishes {source.kind} on {topic.name}, where "
                        f"{_list(topic.subscribers) or 'the car'} expects {topic.kind}",
                        f"Publish {topic.kind}, or on another topic",
                    )
                )
            else:
                found.append(
                    Finding(
                        f"{source.node} was built with another definition of {topic.kind} (MD5 sum "
                        f"{source.md5sum}; here it is {topic.md5sum}), so nobody hears it",
                        "Build it with this one, and start it again; in its workspace, type: "
                        "catkin_make clean && catkin_make",
                    )
                )
    return found


def _commands(facts: Facts) -> List[Finding]:
    """Find why no command to drive reaches the car, when it is there."""
    senders = [each for each in facts.inputs if each.senders]
    if not senders:
        return _nobody_sends(facts)
    names = [each.name for each in facts.inputs]
    held = [each for each in senders if facts.active in names[: names.index(each.name)]]
    if held:
        holder = facts.inputs[names.index(facts.active)]
        nodes = holder.senders or list(holder.topic.sources)
        ignored = [source.node for each in held for source in each.senders]
        return [
            Finding(
                f"the mux's input {holder.name} is held by {_names(nodes)}, so the commands of "
                f"{_list(ignored)} do not reach the car",
                f"Let go of it there, or type: rosnode kill {_spaced(nodes)}",
            )
        ]
    driving = [source for each in senders for source in each.senders]
    if not any(speed for source in driving for speed in source.speeds):
        return [
            Finding(
                f"every command of {_names(driving)} has the speed 0",
                "Set msg.drive.speed in what you publish [m/s]",
            )
        ]
    return []


def _nobody_sends(facts: Facts) -> List[Finding]:
    """Say that no commands come."""
    silent = [source.node for each in facts.inputs for source in each.topic.sources]
    named = "" if facts.car == "car" else f" car_name:={facts.car}"
    launch = f"roslaunch mushr_ros_intro path_publisher.launch{named} plan_file:="
    at = f" at {facts.pose}" if facts.pose and not facts.moves else ""
    if silent:
        return [
            Finding(
                f"no command came in {facts.listened:.1f} s, though there is {_list(silent)} to "
                "send some",
                "To drive with keys, hold one down in the window; otherwise see what its terminal "
                "says, and whether its loop gets to publish",
            )
        ]
    return [
        Finding(
            f"nobody publishes commands: {_control_topic(facts)} has no publisher, and the car is "
            f"at rest{at}",
            f"Type: {launch}figure_8",
        )
    ]


def _stamps(facts: Facts) -> List[Finding]:
    """Find commands without a stamp, or with one from another clock."""
    found = []
    for source in _senders(facts):
        if 0 in source.stamps:
            found.append(
                Finding(
                    f"{source.node} sends commands with stamp 0, so each counts from when it "
                    "arrives, which is never twice the same",
                    "Set msg.header.stamp = rospy.Time.now() before you publish",
                )
            )
        elif facts.now is not None:
            begin, end = facts.now
            early, late = min(source.stamps) - end, max(source.stamps) - begin
            if early > STAMP_TOLERANCE or late < -STAMP_TOLERANCE:
                off = (early if early > 0 else late) / NANOSECONDS
                found.append(
                    Finding(
                        f"{source.node} stamps its commands {off:+.1f} s from "
                        f"{'/clock' if facts.clock else 'the clock of this machine'}",
                        "Stamp with rospy.Time.now(), in a node that is started after use_sim_time "
                        "is set"
                        if facts.clock
                        else "Stamp with rospy.Time.now(); if it does and runs on another machine, "
                        "synchronise the clocks, on each with: sudo ntpdate pool.ntp.org",
                    )
                )
    return found


def _has_mux(facts: Facts) -> bool:
    """Say whether anybody subscribes to an input of the mux."""
    topics = [each.topic for each in facts.inputs if each.topic.name != facts.output.name]
    return any(each.subscribers for each in topics)


def _on_the_way(facts: Facts) -> Set[str]:
    """Return the nodes that commands come from and pass through, and the car."""
    topics = [*(each.topic for each in facts.inputs), facts.output]
    sources = {source.node for topic in topics for source in topic.sources}
    return sources.union(*(topic.subscribers for topic in topics))


def _senders(facts: Facts) -> List[Source]:
    """Return every node from which commands were heard."""
    return [source for each in facts.inputs for source in each.senders]


def _control_topic(facts: Facts) -> str:
    """Return the topic that a plan's commands go to: the input navigation, if there is one."""
    topics = {each.name: each.topic.name for each in facts.inputs}
    return topics.get("navigation", next(iter(topics.values()), facts.output.name))


def _names(sources: Iterable[Source]) -> str:
    """Return the names of nodes as text."""
    return _list(each.node for each in sources)


def _list(names: Iterable[str]) -> str:
    """Return names as text, each once."""
    return " and ".join(dict.fromkeys(names))


def _spaced(sources: Iterable[Source]) -> str:
    """Return the names of nodes as a command takes them."""
    return " ".join(dict.fromkeys(each.node for each in sources))
