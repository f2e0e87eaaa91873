"""Derive findings from facts: what keeps the car from moving, and what to type."""

from typing import List, Set

from mushr_ros_intro.doctor.command_rules import command_findings, rivals
from mushr_ros_intro.doctor.facts import (
    Clock,
    Facts,
    Finding,
    Master,
    listed,
    names,
)
from mushr_ros_intro.ros.xmlrpc_client import DEFAULT_MASTER, CallFault

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
    first = rivals(facts) + _doubles(facts)
    found = [] if facts.moves else _dead_nodes(facts)
    if facts.clock:
        found += _time(facts.clock, set(facts.dead))
    if not facts.output.subscribers or not (_has_mux(facts) or facts.senders):
        found.append(_not_running(facts))
    found += _wrong_types(facts)
    found += command_findings(facts, package, has_cause=bool(found))
    if facts.contact:
        found.append(_contact(facts))
    if not first + found and facts.moves is False:
        problem = f"{names(facts.senders)} sends commands, but the car does not move"
        remedy = "Read the terminals of the car and of the mux. To see the commands that the car "
        remedy += f"receives, type: rostopic echo {facts.output.name}"
        found.append(Finding(problem, remedy))
    return first + found


def health(facts: Facts) -> str:
    """Return the line about a system without findings."""
    drives = f"no fault found: {names(facts.senders)} sends commands"
    if facts.moves:
        return f"{drives}, and the car moves"
    return f"{drives}; whether the car moves is unknown, because its pose is not published"


def hints(facts: Facts) -> List[str]:
    """Return what could be better in a system without findings."""
    past = [each.node for each in facts.inputs["output"].senders] if _has_mux(facts) else []
    found = [f"hint: {each}" for each in _dead_nodes(facts)]  # the car moves without them
    if facts.clock:
        found.append(
            "hint: use_sim_time is true on this master, so the time is simulated. If it was left "
            "from an earlier run, stop all nodes, and type: rosparam set use_sim_time false"
        )
    found += [
        f"hint: {node} sends commands past the mux, so nobody can take over with the keyboard or "
        f"the joystick. Publish on {facts.control_topic}"
        for node in past
    ]
    return found + [
        f"hint: the commands of {each.node} have no stamp, so each one takes effect when it "
        "arrives, and the final pose differs from drive to drive. In send_command of the "
        "tutorial's listing, replace AckermannDriveStamped(drive=drive) by AckermannDriveStamped("
        "header=Header(stamp=rospy.Time.now()), drive=drive); Header is in std_msgs.msg"
        for each in facts.senders
        if 0 in each.stamps and each not in facts.manual_senders
    ]


def last_drive(facts: Facts) -> List[str]:
    """Return how the last drive of a plan ended, if one has been watched."""
    return [f"the last drive of a plan: {facts.verdict}"] if facts.verdict else []


def left_parameters(facts: Facts) -> List[str]:
    """Return a hint for each node that may use parameters of an earlier run."""
    hints = []
    for node, left in facts.left_parameters.items():
        values = ", ".join(f"{name} = {value}" for name, value in left.items())
        text = f"hint: {node} also has parameters that are not in its command line, from an "
        text += f"earlier run or from rosparam: {values}. To delete them, stop the node, type: "
        text += f"rosparam delete {node}, and start it again"
        for name, value in facts.mistyped.get(node, {}).items():
            text = f"hint: {node} uses {name} = {left[name]}, which was set before. Its argument "
            text += f"{name}:={value} sets no parameter: stop the node, and start it with "
            text += f"_{name}:={value}"
        hints.append(text)
    return hints


def _doubles(facts: Facts) -> List[Finding]:
    """Find two simulators of one car, or two muxes."""
    receivers = {node for topic in facts.inputs.values() for node in topic.subscribers}
    receivers -= set(facts.dead)
    muxes = [each.node for each in facts.output.publishers if each.node in receivers]
    return [
        Finding(f"{listed(nodes)} run at the same time: {what}", "Stop one of them with Ctrl-C")
        for nodes, what in (
            (facts.pose_publishers, f"each reports a pose of the car '{facts.car}'"),
            (muxes, f"each is a mux of the car '{facts.car}'"),
        )
        if len(nodes) > 1
    ]


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


def _dead_nodes(facts: Facts) -> List[Finding]:
    return [_dead_node(node, fault) for node, fault in facts.dead.items()]


def _dead_node(node: str, fault: CallFault) -> Finding:
    if fault is CallFault.NO_RESPONSE:
        return Finding(
            f"{node} does not respond: it is stopped, or its machine cannot be reached",
            f"{_CONTINUE}. On another machine, set ROS_IP to its IP address in the terminal of the "
            "node, and start the node again",
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
        remedy += "or, for simulated time, start sim.launch again, with use_sim_time:=true"
        return [Finding(problem, remedy)]
    if clock.advances or not dead.isdisjoint(clock.publishers):
        return []
    problem = (
        f"time stands still: /clock comes from {listed(clock.publishers)} and does not advance"
    )
    remedy = "Resume that node; in the terminal of rosbag, press the space bar"
    if clock.resume_service:
        remedy = f"Type: rosservice call {clock.resume_service}"
    return [Finding(problem, remedy)]


def _not_running(facts: Facts) -> Finding:
    missing, topic = "the car", facts.output.name
    if facts.output.subscribers:
        missing, topic = "the mux of the car", facts.control_topic
    problem = f"{missing} '{facts.car}' is not running: no node subscribes to {topic}"
    remedies = [
        f"For the simulated car, type: roslaunch mushr_ros_intro sim.launch{facts.car_argument}",
        "for an actual car, start MuSHR's teleop.launch of mushr_base, and never sim.launch",
    ]
    if facts.output.subscribers:
        remedies = ["End the launch file of the car (Ctrl-C in its terminal), and start it again"]
    if facts.other_cars:
        problem += f"; running: {listed(facts.other_cars)}"
        remedies.append(
            f"for that car, type: rosrun mushr_ros_intro doctor.py --car {facts.other_cars[0]}"
        )
    if facts.master.other:
        problem += f"; another master runs at {facts.master.other}"
        remedies.append(f"for that master, type: export ROS_MASTER_URI={facts.master.other}")
    return Finding(problem, "; ".join(remedies))


def _wrong_types(facts: Facts) -> List[Finding]:
    """Find publishers whose messages the subscribers of their topic reject."""
    return [
        Finding(
            f"{publisher.node} publishes {publisher.msg_type} on {topic.name}, but "
            f"{listed(topic.subscribers) or 'the car'} expects {topic.msg_type}",
            f"Publish {topic.msg_type}, or use another topic",
        )
        for topic in [*facts.inputs.values(), facts.output, facts.initial_pose]
        for publisher in topic.publishers
        if publisher.msg_type not in ("", topic.msg_type)
    ]


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
