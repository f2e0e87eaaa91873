"""Derive findings from facts: what keeps the car from moving, and what to type."""

import math
from typing import Iterable, List, Set

from mushr_ros_intro.doctor.facts import (
    Clock,
    Facts,
    Finding,
    Master,
    Publisher,
    Topic,
)
from mushr_ros_intro.plan.plan import MAX_STEERING_ANGLE
from mushr_ros_intro.ros.xmlrpc_client import DEFAULT_MASTER, CallFault
from mushr_ros_intro.stamps import NANOSECONDS, STAMP_TOLERANCE

_JOYSTICK = (
    "MuSHR's joystick node sends stops until a button is held: RB for commands of other nodes, LB "
    "to drive with the joystick"
)

_MANUAL = ("safety", "teleop")
"""The inputs of the mux for people. The nodes that publish there are silent most of the time."""

_MAX_GAP = NANOSECONDS // 4
"""Commands that are further apart stop the car in between [ns]. The timeout of the mux is 0.2 s."""

_CONTINUE = "If it was stopped with Ctrl-Z, type in its terminal: fg"


def diagnose(facts: Facts, package: str = "") -> List[Finding]:
    """Return what keeps the car from moving, causes before effects.

    Effects of a fault that is already reported are left out.

    Args:
        facts: the observed state of the system.
        package: the package of the user's node, if it is known.
    """
    if facts.master.fault:
        return [_no_master(facts.master, facts.master.fault)]
    first = _rivals(facts) + _doubles(facts) + [_abandoned(node) for node in facts.abandoned]
    found = [_dead_node(node, fault) for node, fault in facts.dead.items()]
    if facts.clock:
        found += _time(facts.clock, set(facts.dead))
    if not facts.output.subscribers or not (_has_mux(facts) or facts.senders):
        found.append(_not_running(facts))
    found += _wrong_types(facts)
    if facts.senders:
        found += _commands(facts)
        for sender in facts.senders:
            found += _stamps(sender, facts) + _values(sender) + _rate(sender, facts)
    else:
        found += _strays(facts) or ([] if found else [_no_commands(facts, package)])
    found += _stray_poses(facts)
    if facts.lacks_map:
        problem = (
            f"the car '{facts.car}' was started with a map, but no node publishes /map now, so "
        )
        problem += "path_publisher.py and check_plan.py cannot check a plan against its walls"
        remedy = "Type: rosrun mushr_ros_intro map_server.py _map_file:=sandbox (or the name of "
        found.append(Finding(problem, f"{remedy}another map)"))
    if facts.contact:
        found.append(_contact(facts))
    if not first + found and facts.moves is False:
        problem = f"{_names(facts.senders)} sends commands, but the car does not move"
        remedy = "Read the terminals of the car and of the mux. To see the commands that the car "
        remedy += f"receives, type: rostopic echo {facts.output.name}"
        found.append(Finding(problem, remedy))
    return first + found


def health(facts: Facts) -> str:
    """Return the line about a system without findings."""
    drives = f"no fault found: {_names(facts.senders)} sends commands"
    if facts.moves:
        return f"{drives}, and the car moves"
    return f"{drives}; whether the car moves is unknown, because its pose is not published"


def hints(facts: Facts) -> List[str]:
    """Return what could be better in a system without findings."""
    manual = {
        each for name in _MANUAL if name in facts.inputs for each in facts.inputs[name].senders
    }
    return [
        f"hint: the commands of {each.node} have no stamp, so each one takes effect when it "
        "arrives, and the final pose differs from drive to drive. In send_command of the "
        "tutorial's listing, replace AckermannDriveStamped(drive=drive) by AckermannDriveStamped("
        "header=Header(stamp=rospy.Time.now()), drive=drive); Header is in std_msgs.msg"
        for each in facts.senders
        if 0 in each.stamps and each not in manual
    ]


def _rivals(facts: Facts) -> List[Finding]:
    """Find nodes that drive the car at the same time through the same input."""
    return [
        Finding(
            f"{_names(topic.senders)} drive the car at the same time: all send commands on "
            f"{topic.name}, and the car gets all of them",
            f"Stop one of them; type: rosnode kill {_names(topic.senders, ' or rosnode kill ')}",
        )
        for topic in facts.inputs.values()
        if len(topic.senders) > 1
    ]


def _doubles(facts: Facts) -> List[Finding]:
    """Find two simulators of one car, or two muxes."""
    receivers = {node for topic in facts.inputs.values() for node in topic.subscribers}
    receivers -= set(facts.dead)
    muxes = [each.node for each in facts.output.publishers if each.node in receivers]
    return [
        Finding(f"{_list(nodes)} run at the same time: {what}", "Stop one of them with Ctrl-C")
        for nodes, what in (
            (facts.pose_publishers, f"each reports a pose of the car '{facts.car}'"),
            (muxes, f"each is a mux of the car '{facts.car}'"),
        )
        if len(nodes) > 1
    ]


def _abandoned(node: str) -> Finding:
    """Return the finding about a node that has outlived its master."""
    return Finding(
        f"{node} is not registered: it belongs to a master that has ended, so it receives and "
        "sends nothing, and rviz shows an old state",
        "Stop it with Ctrl-C in its terminal, and start it again",
    )


def _no_master(master: Master, fault: CallFault) -> Finding:
    """Return why ROS_MASTER_URI cannot be used."""
    problem = f"ROS_MASTER_URI is {master.uri}, but {fault.value}"
    if master.other:
        return Finding(
            f"{problem}; a master runs on this machine at {master.other}",
            f"Type: export ROS_MASTER_URI={master.other}",
        )
    if fault is CallFault.MALFORMED:
        return Finding(problem, f"Type: export ROS_MASTER_URI={DEFAULT_MASTER}")
    if master.is_local:
        start = "Type: roslaunch mushr_ros_intro sim.launch"
        return Finding(problem, _CONTINUE if fault is CallFault.NO_RESPONSE else start)
    return Finding(
        problem,
        "Check the network connection to that machine, and start the master there. To use a master "
        f"on this machine instead, type: export ROS_MASTER_URI={DEFAULT_MASTER}",
    )


def _dead_node(node: str, fault: CallFault) -> Finding:
    if fault is CallFault.NO_RESPONSE:
        return Finding(
            f"{node} does not respond: it is stopped, or its machine cannot be reached", _CONTINUE
        )
    if fault is CallFault.UNKNOWN_HOST:
        return Finding(
            f"{node} cannot be reached: this machine cannot resolve the host name of its machine",
            "On that machine, set ROS_IP to its IP address and start the node again",
        )
    return Finding(
        f"{node} has died: it is registered, but it no longer listens at its address",
        "Start it again. To remove the old registration, type: rosnode cleanup",
    )


def _time(clock: Clock, dead: Set[str]) -> List[Finding]:
    """Find why simulated time stands still, unless a dead publisher of /clock explains it."""
    if not clock.publishers:
        problem = "use_sim_time is true, but no node publishes /clock, so time stands still"
        remedy = (
            "Stop all nodes. Then, for wall-clock time, type: rosparam set use_sim_time false; "
        )
        remedy += "or, for simulated time: roslaunch mushr_ros_intro sim.launch use_sim_time:=true"
        return [Finding(problem, remedy)]
    if clock.advances or not dead.isdisjoint(clock.publishers):
        return []
    problem = f"time stands still: /clock comes from {_list(clock.publishers)} and does not advance"
    remedy = "Resume that node; in the terminal of rosbag, press the space bar"
    if clock.resume_service:
        remedy = f"Type: rosservice call {clock.resume_service}"
    return [Finding(problem, remedy)]


def _not_running(facts: Facts) -> Finding:
    missing, topic = "the car", facts.output.name
    if facts.output.subscribers:
        missing, topic = "the mux of the car", _control_topic(facts)
    problem = f"{missing} '{facts.car}' is not running: no node subscribes to {topic}"
    if len(facts.pose_publishers) > 1:
        remedy = "Two simulations of this car were started, and their muxes have ended each other. "
        return Finding(problem, f"{remedy}Stop all nodes of both, and start one of them again")
    remedies = [f"Type: roslaunch mushr_ros_intro sim.launch{_car_argument(facts)}"]
    if facts.other_cars:
        problem += f"; running: {_list(facts.other_cars)}"
        remedies.append(f"doctor.py --car {facts.other_cars[0]}")
    if facts.master.other:
        problem += f"; another master runs at {facts.master.other}"
        remedies.append(f"export ROS_MASTER_URI={facts.master.other}")
    return Finding(problem, ", or ".join(remedies))


def _strays(facts: Facts) -> List[Finding]:
    return [
        Finding(
            f"the commands of {_list(nodes)} have no effect: no node subscribes to {topic}",
            f"Send them to the car '{facts.car}': correct the name of the topic in the node. To "
            "connect it without a change, add to its <node> in the launch file: "
            f'<remap from="{topic}" to="{_control_topic(facts)}" />; with rosrun, add the argument '
            f"{topic}:={_control_topic(facts)}",
        )
        for topic, nodes in facts.strays.items()
    ]


def _stray_poses(facts: Facts) -> List[Finding]:
    expected = facts.initial_pose.name
    return [
        Finding(
            f"the start poses of {_list(nodes)} have no effect: no node subscribes to {topic}",
            f"Publish them on {expected}; with rosrun, add the argument {topic}:={expected}",
        )
        for topic, nodes in facts.stray_poses.items()
    ]


def _wrong_types(facts: Facts) -> List[Finding]:
    """Find publishers whose messages the subscribers of their topic reject."""
    return [
        _wrong_type(topic, publisher)
        for topic in [*facts.inputs.values(), facts.output, facts.initial_pose]
        for publisher in topic.publishers
        if publisher.msg_type and publisher.md5sum != topic.md5sum
    ]


def _wrong_type(topic: Topic, publisher: Publisher) -> Finding:
    if publisher.msg_type != topic.msg_type:
        return Finding(
            f"{publisher.node} publishes {publisher.msg_type} on {topic.name}, but "
            f"{_list(topic.subscribers) or 'the car'} expects {topic.msg_type}",
            f"Publish {topic.msg_type}, or use another topic",
        )
    return Finding(
        f"{publisher.node} was built with another definition of {topic.msg_type} (MD5 sum "
        f"{publisher.md5sum}, expected {topic.md5sum}), so its messages are rejected",
        "Build it with the definition of this machine and start it again; in its workspace, type: "
        "catkin_make clean && catkin_make",
    )


def _commands(facts: Facts) -> List[Finding]:
    """Find why the commands that are sent do not drive the car."""
    active = facts.inputs.get(facts.active)
    if active:
        lower = list(facts.inputs.values())[list(facts.inputs).index(facts.active) + 1 :]
        blocked = [each for topic in lower for each in topic.senders if each in facts.senders]
        holders = active.senders or active.publishers
        if blocked:
            problem = (
                f"the input '{facts.active}' of the mux has a higher priority and is in use by "
                f"{_names(holders)}, so the commands of {_names(blocked)} do not reach the car"
            )
            remedy = f"Stop driving there, or type: rosnode kill {_names(holders, ' ')}"
            if active.senders and not any(speed for each in holders for speed in each.speeds):
                remedy = f"{_JOYSTICK}. {remedy}"
            return [Finding(problem, remedy)]
    if not any(speed for each in facts.senders for speed in each.speeds):
        problem = f"all commands of {_names(facts.senders)} have speed 0"
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
    people = [each for name in _MANUAL for each in silent.pop(name, ())]
    nodes = _names(each for publishers in silent.values() for each in publishers)
    if nodes:
        return Finding(
            f"no commands arrived from {nodes}",
            "Read the node's terminal, and check that its loop calls publish",
        )
    own = f"roslaunch mushr_ros_intro path_publisher.launch{_car_argument(facts)} "
    own += "plan_file:=figure_8"
    if f"/{facts.car}/car_sim" not in facts.output.subscribers:  # maybe an actual car
        own = "roslaunch mushr_ros_intro real_car.launch plan_file:=my_plan.txt (see real_car.md)"
    remedy = "Start your node, and read its terminal. To find out why it does not start, type: "
    remedy += "rosrun mushr_ros_intro doctor.py --package THE_PACKAGE_OF_YOUR_NODE"
    if package:
        remedy = f"Start the node of {package}, and read its terminal"
    if people:
        remedy += f". To drive with {_names(people)}, hold a key down in its window or page, or on "
        remedy += "MuSHR's joystick hold LB"
    return Finding(
        f"no node publishes commands: {_control_topic(facts)} has no publisher",
        f"{remedy}. To drive with this package's node, type: {own}",
    )


def _stamps(sender: Publisher, facts: Facts) -> List[Finding]:
    if not facts.window or 0 in sender.stamps:
        return []
    begin, end = facts.window
    ahead, behind = min(sender.stamps) - end, begin - max(sender.stamps)
    if max(ahead, behind) <= STAMP_TOLERANCE:
        return []
    offset = (
        f"{max(ahead, behind) / NANOSECONDS:.1f} s {'ahead of' if ahead > behind else 'behind'}"
    )
    clock = "/clock" if facts.clock else "the clock of this machine"
    remedy = "Stamp with rospy.Time.now(), and start the node after use_sim_time is set"
    if not facts.clock:
        remedy = (
            "Stamp with rospy.Time.now(). If the node does so and runs on another machine, "
            "synchronise the clocks of both; on each, type: sudo ntpdate pool.ntp.org"
        )
    return [Finding(f"the stamps of the commands of {sender.node} are {offset} {clock}", remedy)]


def _values(sender: Publisher) -> List[Finding]:
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


def _rate(sender: Publisher, facts: Facts) -> List[Finding]:
    """Find commands that are so rare that the car stops after each one. People may send such."""
    manual = {
        each.node for name in _MANUAL if name in facts.inputs for each in facts.inputs[name].senders
    }
    if sender.shortest_gap <= _MAX_GAP or sender.node in manual:
        return []
    seconds = sender.shortest_gap / NANOSECONDS
    problem = (
        f"{sender.node} sends a command every {seconds:.1f} s, but the mux stops the car 0.2 s "
    )
    remedy = "Repeat each command at 10 Hz: call publish in a loop with rospy.Rate(10)"
    return [Finding(f"{problem}after each one", remedy)]


def _contact(facts: Facts) -> Finding:
    return Finding(
        f"the car touches a wall at {facts.contact}",
        "Drive away from the wall, place the car elsewhere with 2D Pose Estimate in rviz, or type: "
        f"rosservice call /{facts.car}/car_sim/reset",
    )


def _has_mux(facts: Facts) -> bool:
    """Return whether an input of the mux has a subscriber."""
    inputs = [each for each in facts.inputs.values() if each.name != facts.output.name]
    return any(each.subscribers for each in inputs)


def _control_topic(facts: Facts) -> str:
    """Return the topic for a plan's commands: the input navigation, or else the first input."""
    topics = {name: each.name for name, each in facts.inputs.items()}
    return topics.get("navigation", next(iter(topics.values()), facts.output.name))


def _car_argument(facts: Facts) -> str:
    """Return the argument of the launch files that names the car."""
    return "" if facts.car == "car" else f" car_name:={facts.car}"


def _names(publishers: Iterable[Publisher], separator: str = " and ") -> str:
    """Return the names of nodes as text, each once."""
    return _list((each.node for each in publishers), separator)


def _list(names: Iterable[str], separator: str = " and ") -> str:
    """Return names as text, each once."""
    return separator.join(dict.fromkeys(names))
