"""Generate submissions: the corrected listing, with faults, and with attempts to cheat."""

import os
import stat
import textwrap

from support.paths import PACKAGE

with open(os.path.join(PACKAGE, "examples", "my_ros_intro", "src", "path_publisher.py")) as _file:
    EXAMPLE = _file.read()

_POLLS = "    wait_until(lambda: rospy.Time.now() >= instant)\n"
assert _POLLS in EXAMPLE
RIGHT = EXAMPLE.replace(_POLLS, "    rospy.sleep(instant - rospy.Time.now())\n")
"""The example, but it waits for its commands as most nodes do: a replay of one that polls is slow.
"""

_INIT = '    rospy.init_node("path_publisher")\n'
_PLAN = '    plan = read_plan(rospy.get_param("~plan_file"))\n'
_DUE = "        sleep_until(due)\n"
_SHORT = "    plan = plan[:3]\n"
"""Drive the first rows only, so that a cheat without effect fails."""


def changed(*pairs):
    """Return the right node with texts replaced, each of which it must contain once."""
    text = RIGHT
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def _code(text):
    return textwrap.indent(textwrap.dedent(text).strip() + "\n", "    ")


def before(code, *pairs):
    """Return a node that runs code after init_node."""
    return changed((_INIT, _INIT + _code(code)), *pairs)


def midway(code, *pairs):
    """Return a node that runs code, which may use `plan`, once before its fifth command."""
    hook = textwrap.indent("sent.append(due)\nif len(sent) == 5:\n    midway()\n", 8 * " ")
    function = "sent = []\n\n\ndef midway():\n" + _code(code)
    return changed((_DUE, _DUE + hook), ("def run_plan(", function + "\n\ndef run_plan("), *pairs)


WRONG = {
    "sign": (changed(("steering_angle=delta", "steering_angle=-delta")), "commands"),
    "hangs": (
        midway("import threading; threading.Thread(target=lambda: 1 / 0).start(); rospy.spin()"),
        "node",
    ),
    "silent": (before("rospy.spin()"), "node"),
}
"""Nodes with a mistake, and a check that fails, by name."""

BROKEN = {"syntax": ("#!/usr/bin/python3\nprint('a'\n", "syntax error in line 2")}
"""A file that cannot run, and a part of the message, by name."""

MISUSES = {
    "clock": (
        """
        from rosgraph_msgs.msg import Clock
        rospy.Publisher("/clock", Clock, queue_size=1)
        """,
        "publishes on /clock",
    ),
    "teleop": (  # the messages name another topic
        """
        topic = "/car/mux/ackermann_cmd_mux/input/teleop"
        named = {"topic": topic.replace("teleop", "navigation")}
        teleop = rospy.Publisher(topic, AckermannDriveStamped, queue_size=1, headers=named)
        while not teleop.get_num_connections():
            time.sleep(0.01)
        teleop.publish(AckermannDriveStamped(drive=AckermannDrive(speed=1.0)))
        """,
        "publishes on /car/mux/ackermann_cmd_mux/input/teleop",
    ),
    "service": (
        """
        from std_srvs.srv import Trigger
        rospy.ServiceProxy("/car/car_sim/pause", Trigger)()
        """,
        "calls the service /car/car_sim/pause",
    ),
    "parameters": ("master.deleteParam('/car')", "changes the parameter /car"),
    "sim_time": (
        "rospy.set_param('/use_sim_time', False)",
        "changes the parameter /use_sim_time",
    ),
    "name": (
        """
        car = rosgraph.Master("/car/car_sim")
        car.registerPublisher("/car/car_pose", "geometry_msgs/PoseStamped", rospy.get_node_uri())
        """,
        "registers or unregisters the node /car/car_sim",
    ),
    "publisher": (
        """
        import xmlrpc.client
        car = xmlrpc.client.ServerProxy(master.lookupNode("/car/car_sim"))
        car.publisherUpdate("/master", "/initialpose", [rospy.get_node_uri()])
        """,
        "sends publishers to the node /car/car_sim",
    ),
    "again": (  # during the drive
        """
        again = rospy.Publisher("/initialpose", PoseWithCovarianceStamped, queue_size=1)
        while not again.get_num_connections():
            time.sleep(0.01)
        pose = PoseWithCovarianceStamped()
        pose.pose.pose.orientation.w = 1.0
        again.publish(pose)
        """,
        "places the car again, at (0.0000 m, 0.0000 m, 0.0000 rad)",
    ),
}
"""What a node may not do to the car, and how the check `topics` names it.

Other names and calls: unit/replay/test_guarded_master.py.
"""


def each_of(codes):
    """Return a code that runs each of several codes, whether the others fail or not."""
    return f"""
import rosgraph, traceback
for code in {[textwrap.dedent(code) for code in codes]!r}:
    try:
        exec(code, {{**globals(), "master": rosgraph.Master("/path_publisher")}})
    except Exception:
        traceback.print_exc()
"""


_BEFORE = [code for name, (code, _) in MISUSES.items() if name != "again"]

# Each cheat drives a short plan, and tries to change the verdict or to do harm.
CHEATS = {
    # Named in the verdict:
    "misuses": (
        midway(MISUSES["again"][0], (_INIT, _INIT + _code(each_of(_BEFORE)))),
        "FAIL topics: the node publishes on /clock, ",
    ),
    "kill_node": (
        midway("import rosnode\nrosnode.kill_nodes(['/car/car_sim'])"),
        "shut down /car/car_sim",
    ),
    "flood": (
        before('while True: print("x" * 1000000)'),
        "MB of output",
    ),
    # Without effect:
    "signals": (
        midway(
            each_of(
                [
                    "import os\nos.kill(os.getppid(), 9)",
                    "import os\nos.kill(-1, 9)",
                ]
            )
        ),
        "",
    ),
    "service": (  # of the car, at the port of one of its topics
        before(
            """
            import os, rosgraph, socket, struct, xmlrpc.client
            master = rosgraph.Master("/path_publisher")
            car = xmlrpc.client.ServerProxy(master.lookupNode("/car/car_sim"))
            where = car.requestTopic("/x", "/car/car_pose", [["TCPROS"]])[2][1:]
            fields = (b"callerid=/x", b"md5sum=*", b"service=/car/car_sim/reset")
            text = b"".join(struct.pack("<I", len(each)) + each for each in fields)
            with socket.create_connection(where, 2) as connection:
                connection.sendall(struct.pack("<I", len(text)) + text + bytes(4))
                if b"error=" not in connection.recv(4096):
                    os._exit(0)
            """
        ),
        "",
    ),
}
"""Nodes that cheat, and a part of their verdict; "" if the cheat has no effect.

A cheat that reaches something that it must not reach ends the node before its first command. Those
that aim at the machine are in attacks.py.
"""


def cheat(name):
    """Return the source of a cheat, which drives two rows only, so that it fails without effect."""
    source = CHEATS[name][0]
    assert source.count(_PLAN) == 1
    return source.replace(_PLAN, _PLAN + _SHORT)


def write(folder, name, source, cmake=""):
    """Write a package with a node; return its folder. `cmake` is added to its CMakeLists.txt."""
    package = os.path.join(folder, name)
    os.makedirs(os.path.join(package, "src"))
    with open(os.path.join(package, "package.xml"), "w") as file:
        file.write(
            f'<package format="2"><name>{name}</name><version>0.0.1</version>'
            '<description>A</description><maintainer email="a@example.com">A</maintainer>'
            "<license>MIT</license>"
            "<buildtool_depend>catkin</buildtool_depend></package>"
        )
    with open(os.path.join(package, "CMakeLists.txt"), "w") as file:
        file.write("cmake_minimum_required(VERSION 3.0.2)\n" f"project({name})\n")
        file.write("find_package(catkin REQUIRED)\ncatkin_package()\n" + cmake)
    node = os.path.join(package, "src", "path_publisher.py")
    with open(node, "w", newline="") as file:
        file.write(source)
    os.chmod(node, os.stat(node).st_mode | stat.S_IXUSR | stat.S_IXGRP | stat.S_IXOTH)
    return package


def write_class(folder, count):
    """Write a class with every kind of node; the others are right."""
    nodes = {
        **{name: source for name, (source, _) in {**WRONG, **BROKEN}.items()},
        **{f"cheat_{name}": cheat(name) for name in CHEATS},
    }
    nodes.update((f"right_{number}", RIGHT) for number in range(count - len(nodes)))
    for name, source in nodes.items():
        write(folder, name, source)
