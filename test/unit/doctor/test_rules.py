"""Findings from facts: each case changes the facts about a healthy system."""

from dataclasses import replace

import pytest

from mushr_ros_intro.doctor.facts import Clock, Facts, Master, Publisher, Topic
from mushr_ros_intro.doctor.rules import diagnose, health, hints, last_drive, left_parameters
from mushr_ros_intro.ros.xmlrpc_client import CallFault

S = 1_000_000_000
"""[ns]"""
NOW = 1_700_000_000 * S

TYPE = "ackermann_msgs/AckermannDriveStamped"
POSE_TYPE = "geometry_msgs/PoseWithCovarianceStamped"
MUX, CAR = "/car/mux/ackermann_cmd_mux", "/car/car_sim"
NAVIGATION = f"{MUX}/input/navigation"
LOCAL = "http://localhost:11311"
PLAN = Publisher("/path_publisher", TYPE, (NOW, NOW + S // 10), (2.0, 2.0))
KEYS = Publisher("/car/teleop", TYPE)
RARE = PLAN._replace(stamps=(0, 0), arrivals=(NOW, NOW + S // 4))
SECOND = PLAN._replace(node="/second")
SILENT = PLAN._replace(stamps=(), speeds=())


def stamped(*offsets):
    """Return a node whose stamps differ by offsets [s] from their arrival."""
    stamps = tuple(NOW + round(offset * S) for offset in offsets)
    return PLAN._replace(stamps=stamps, arrivals=(NOW,) * len(stamps))


def inputs(plan=PLAN, keys=KEYS, bypass=None):
    """Return the inputs with these publishers, None for no publisher."""

    def topic(name, node, *publishers):
        return Topic(name, TYPE, tuple(filter(None, publishers)), (node,))

    return {
        "output": topic(f"{MUX}/output", CAR, bypass),
        "teleop": topic(f"{MUX}/input/teleop", MUX, keys),
        "navigation": topic(NAVIGATION, MUX, plan),
    }


def without_mux(bypass=None):
    return {"output": inputs(bypass=bypass)["output"], "navigation": Topic("/nav", TYPE)}


RUNNING = Clock((CAR,), (NOW, NOW + S))
OUTPUT = Topic(f"{MUX}/output", TYPE, (Publisher(MUX, TYPE),), (CAR,))
HEALTHY = Facts(
    "car",
    Master(LOCAL),
    inputs=inputs(),
    output=OUTPUT,
    initial_pose=Topic("/initialpose", POSE_TYPE, (), (CAR,)),
    active="navigation",
    moves=True,
)
TWO_KEYBOARDS = Topic("/t", TYPE, (Publisher("/quiet", TYPE), KEYS._replace(stamps=(NOW,))), (MUX,))
DEAD = {"moves": None, "dead": {"/rviz": CallFault.REFUSED}}
STOPS = PLAN._replace(speeds=(0.0, 0.0))
NO_PUBLISHER = {"inputs": inputs(None, None), "moves": False}


def findings(**changes):
    return [str(each) for each in diagnose(replace(HEALTHY, **changes))]


def test_health():
    assert findings() == []
    assert health(HEALTHY) == "no fault found: /path_publisher sends commands, and the car moves"
    assert health(replace(HEALTHY, moves=None)).endswith("because its pose is not published")


@pytest.mark.parametrize(
    "master, problem, remedy",
    [
        (Master(LOCAL, CallFault.REFUSED), "no master runs there", "roslaunch mushr_ros_intro sim"),
        (Master(LOCAL, CallFault.NO_RESPONSE), "the master there does not respond", "Ctrl-Z"),
        (Master(LOCAL, CallFault.NOT_ROS), "the program there is not a ROS master", "roslaunch"),
        (Master("far", CallFault.MALFORMED), "expected is an address such as", f"URI={LOCAL}"),
        (Master("http://far:1", CallFault.REFUSED, False), "no master runs", "Check the network"),
        (
            Master("http://far:1", CallFault.NO_RESPONSE, False),
            "the master there does",
            f"URI={LOCAL}",
        ),
        (
            Master("http://far:1", CallFault.UNKNOWN_HOST, False, "http://localhost:2"),
            "its host name cannot be resolved; a master runs on this machine at http://localhost:2",
            "Type: export ROS_MASTER_URI=http://localhost:2",
        ),
    ],
)
def test_master(master, problem, remedy):
    (finding,) = findings(master=master)
    assert finding.startswith(f"ROS_MASTER_URI is {master.uri}, but {problem}")
    assert remedy in finding


@pytest.mark.parametrize(
    "changes, problem, remedy",
    [
        (DEAD, "/rviz has died", "rosnode cleanup"),
        ({"moves": None, "dead": {"/rviz": CallFault.NO_RESPONSE}}, "/rviz does not respond", "fg"),
        ({"moves": None, "dead": {"/rviz": CallFault.UNKNOWN_HOST}}, "cannot be reached", "ROS_IP"),
        ({"clock": Clock()}, "no node publishes /clock", "rosparam set use_sim_time false"),
        (
            {"clock": Clock((CAR,), (NOW, NOW), "/car/car_sim/resume")},
            "time stands still: /clock comes from /car/car_sim and does not advance",
            "Type: rosservice call /car/car_sim/resume",
        ),
        ({"clock": Clock(("/bag",))}, "/clock comes from /bag and does not", "the space bar"),
        (
            {"output": OUTPUT._replace(subscribers=())},
            f"the car 'car' is not running: no node subscribes to {MUX}/output",
            "sim.launch; for an actual car, start MuSHR's teleop.launch of mushr_base, and never ",
        ),
        (
            {"inputs": without_mux()},
            "the mux of the car 'car' is not running: no node subscribes to /nav",
            "End the launch file of the car (Ctrl-C in its terminal), and start it again",
        ),
        (
            {
                "car": "car2",
                "inputs": without_mux(),
                "output": OUTPUT._replace(subscribers=()),
                "other_cars": ("car", "car3"),
                "master": Master("http://localhost:2", other=LOCAL),
            },
            f"subscribes to {MUX}/output; running: car and car3; another master runs at {LOCAL}",
            f"doctor.py --car car; for that master, type: export ROS_MASTER_URI={LOCAL}",
        ),
        (
            {**NO_PUBLISHER, "strays": {"/cmd": ("/student",)}},
            "the commands of /student have no effect: no node subscribes to /cmd",
            f'<remap from="/cmd" to="{NAVIGATION}" />; with rosrun, add the argument /cmd:=',
        ),
        (
            {"inputs": inputs(PLAN._replace(msg_type="std_msgs/String"))},
            f"/path_publisher publishes std_msgs/String on {NAVIGATION}, but {MUX} expects {TYPE}",
            f"Publish {TYPE}",
        ),
        (
            {"output": OUTPUT._replace(publishers=(Publisher("/direct", "a/B"),))},
            f"/direct publishes a/B on {MUX}/output, but {CAR} expects {TYPE}",
            f"Publish {TYPE}",
        ),
        (
            {"initial_pose": Topic("/p", POSE_TYPE, (Publisher("/place", "a/B"),))},
            f"/place publishes a/B on /p, but the car expects {POSE_TYPE}",
            f"Publish {POSE_TYPE}",
        ),
        (
            {"inputs": inputs(PLAN._replace(stamps=(NOW, NOW + S)))},
            "/path_publisher sends a command every 1 s, but the mux stops the car 0.2 s after",
            "rospy.Rate(10)",
        ),
        (
            {"inputs": inputs(RARE)},
            "/path_publisher sends a command every 0.25 s",
            "rospy.Rate(10)",
        ),
        (
            {"inputs": inputs(PLAN._replace(steering_angles=(0.0, -20.0))), "moves": False},
            "/path_publisher sends steering angles up to 20 rad; the car steers at most 1.57 rad",
            "If they are degrees, use math.radians; or are drive.speed and drive.steering_angle",
        ),
        (
            {"stray_poses": {"/initial_pose": ("/place",)}},
            "the start poses of /place have no effect: no node subscribes to /initial_pose",
            "Publish them on /initialpose; with rosrun, add the argument /initial_pose:=/initialp",
        ),
        (
            NO_PUBLISHER,
            f"no node publishes commands: {NAVIGATION} has no publisher. Start your node, and",
            "roslaunch mushr_ros_intro path_publisher.launch plan_file:=figure_8",
        ),
        (
            {"inputs": {"navigation": Topic("/n", TYPE, (PLAN, SECOND), (MUX,))}},
            "/path_publisher and /second drive the car at the same time: all send commands on /n",
            "rosnode kill /path_publisher or rosnode kill /second",
        ),
        (
            {"inputs": inputs(SILENT), "moves": False},
            "no commands arrived from /path_publisher",
            "Read the node's terminal",
        ),
        (
            {"active": "teleop"},
            "the input 'teleop' of the mux has a higher priority and is in use by /car/teleop",
            "/path_publisher do not reach the car. Stop driving there, or type: rosnode kill",
        ),
        (
            {"inputs": {**inputs(), "teleop": TWO_KEYBOARDS}, "active": "teleop"},
            "is in use by /car/teleop, so the commands of /path_publisher do not reach the car",
            "rosnode kill /car/teleop",
        ),
        ({"inputs": inputs(STOPS)}, "all commands of /path_publisher have speed 0", "drive.speed"),
        ({"inputs": inputs(stamped(2.5, 2.4))}, "/path_publisher are 2.4 s ahead of", "chrony"),
        ({"inputs": inputs(stamped(-1.5, -1.4))}, "/path_publisher are 1.4 s behind", "chrony"),
        (
            {"inputs": inputs(stamped(-2.5, -1.5)), "clock": RUNNING},
            "the commands of /path_publisher are at least 1.5 s behind /clock",
            "after use_sim_time is set",
        ),
        ({"contact": "(9, 8, 7)"}, "touches a wall at (9, 8, 7)", "call /car/car_sim/reset"),
        ({"moves": False}, "the car does not move", f"rostopic echo {MUX}/output"),
    ],
)
def test_finding(changes, problem, remedy):
    (finding,) = findings(**changes)
    before, _, after = finding.partition(problem)
    assert after and remedy in after
    assert "\n" not in finding


@pytest.mark.parametrize(
    "changes",
    [
        {"active": "idle"},  # between two commands
        {"inputs": inputs(PLAN._replace(stamps=(NOW, NOW + S // 5)))},  # 5 Hz
        {"inputs": inputs(PLAN._replace(stamps=(NOW,)))},
        {"inputs": inputs(PLAN._replace(stamps=(0, NOW)))},  # a hint
        {"moves": None},  # the pose is not published
        {"clock": RUNNING},
        {"clock": RUNNING, "inputs": inputs(RARE)},  # the clock may be slow
        {"inputs": inputs(stamped(-1.0))},  # the tolerance
        {"inputs": inputs(stamped(1.0, 1.1))},
        {"inputs": inputs(stamped(-5.0, 0.0, 0.0))},  # one was late
        {"inputs": inputs(stamped(2.0)), "clock": RUNNING},
        {"inputs": inputs(PLAN._replace(speeds=(0.0, -0.1)))},
        {"inputs": inputs(keys=Publisher("/keys"))},  # not connected
        {"other_cars": ("car2",)},
        {"strays": {"/cmd": ("/student",)}},  # another node drives the car
        {"master": Master("http://localhost:2", other=LOCAL)},
        {"inputs": inputs(None, bypass=PLAN), "active": "idle"},
        {"inputs": without_mux(bypass=PLAN), "active": "idle"},
    ],
)
def test_no_finding(changes):
    assert findings(**changes) == []


def test_hints():
    assert hints(HEALTHY) == []
    dead = {"dead": {"/tf_echo": CallFault.REFUSED}}
    assert findings(**dead) == []  # the car moves
    (hint,) = hints(replace(HEALTHY, **dead))
    assert hint.startswith("hint: /tf_echo has died")
    (hint,) = hints(replace(HEALTHY, inputs=inputs(PLAN._replace(stamps=(NOW, 0)))))
    assert hint.startswith("hint: the commands of /path_publisher have no stamp")


def test_a_node_that_sends_past_the_mux():
    (hint,) = hints(replace(HEALTHY, inputs=inputs(None, bypass=PLAN)))
    assert hint.startswith("hint: /path_publisher sends commands past the mux, so nobody can take")
    assert hint.endswith(f"Publish on {NAVIGATION}")
    assert not hints(replace(HEALTHY, inputs=without_mux(PLAN)))


def test_the_last_drive():
    """As drive_monitor has judged it; during a drive its verdict is empty."""
    assert last_drive(HEALTHY) == []
    text = "the car stopped at a wall in line 7 of 23"
    assert last_drive(replace(HEALTHY, verdict=text)) == [f"the last drive of a plan: {text}"]


def test_parameters_of_earlier_runs():
    assert left_parameters(HEALTHY) == []
    left = {"/path_publisher": {"control_topic": "/nav", "loop": True}}
    (hint,) = left_parameters(replace(HEALTHY, left_parameters=left))
    assert "an earlier run or from rosparam: control_topic = /nav, loop = True. To delete" in hint
    assert "type: rosparam delete /path_publisher, and start it again" in hint


def test_an_argument_that_sets_no_parameter():
    left = {"/own": {"plan_file": "old.txt"}}
    facts = replace(HEALTHY, left_parameters=left, mistyped={"/own": {"plan_file": "new.txt"}})
    (hint,) = left_parameters(facts)
    assert "/own uses plan_file = old.txt" in hint and hint.endswith("_plan_file:=new.txt")


def test_simulated_time_that_was_left():
    (hint,) = hints(replace(HEALTHY, clock=RUNNING))
    assert "use_sim_time is true" in hint and hint.endswith("rosparam set use_sim_time false")


def test_a_topic_that_no_node_publishes():
    waits = {"unpublished": {"/car/vesc/odom": ("/own",)}}
    (finding,) = findings(**NO_PUBLISHER, **waits)
    assert finding.startswith("/own subscribes to /car/vesc/odom, which no node publishes")
    assert findings(**waits) == []


def test_a_misspelt_topic_of_a_node_that_has_ended():
    topic = f"{MUX}/input/navigaton"
    (finding,) = findings(**NO_PUBLISHER, strays={topic: ()})
    assert finding.startswith("the commands of a node that has ended have no effect")
    assert topic in finding and f"correct the topic to {NAVIGATION}" in finding


def test_the_first_finding_is_a_second_node_that_drives_the_car():
    two = {"navigation": Topic("/n", TYPE, (PLAN, SECOND), (MUX,))}
    found = findings(
        inputs=two, dead={"/rviz": CallFault.REFUSED}, contact="(9, 8, 7)", moves=False
    )
    assert len(found) == 3 and found[0].startswith("/path_publisher and /second")


@pytest.mark.parametrize("node", ["/path_publisher", MUX, CAR])
def test_effects_of_a_dead_node_are_left_out(node):
    (finding,) = findings(
        inputs=inputs(SILENT), dead={node: CallFault.REFUSED}, clock=Clock((node,)), moves=None
    )
    assert finding.startswith(f"{node} has died")


def test_effects_of_a_paused_clock_are_left_out_but_commands_are_judged():
    (finding,) = findings(inputs=inputs(SILENT), clock=Clock((CAR,)), moves=False)
    assert finding.startswith("time stands still")
    slow = inputs(PLAN._replace(speeds=(0.0,)))
    clock, speed = findings(inputs=slow, clock=Clock((CAR,)), moves=False)
    assert clock.startswith("time stands still")
    assert "have speed 0" in speed


ZEROS = Publisher("/car/mux/zero_ackermann_cmd", TYPE, 9 * (NOW - 13 * S,), 9 * (0.0,))
MANAGER = "/car/mux/nodelet_manager"
SYSTEMS = {
    "car, master": ("/car/teleop/joy_teleop", "/car/racecar_state"),
    "car, noetic": ("/car/teleop/joy_teleop", None),
    "simulator, master": ("/car/keyboard_teleop", "/car/racecar_state"),
    "simulator, noetic": ("/car/foxglove_teleop", "/mushr_sim"),
}
"""The systems of MuSHR, as recorded: the nodes that publish on teleop, and the car's pose."""


def in_mushr(system, plan=None, stamps=(), speeds=(), muxes=(MANAGER,), poses=(), **others):
    """Return the facts of a system of MuSHR; `stamps` and `speeds` are those on teleop."""
    teleop, reporter = SYSTEMS[system]

    def topic(name, *publishers):
        full = f"{MUX}/input/{name}"
        return Topic(full, TYPE, tuple(filter(None, publishers)), muxes)

    output = Topic(
        f"{MUX}/output",
        TYPE,
        tuple(Publisher(each, TYPE) for each in muxes),
        ("/car/vesc/ackermann_to_vesc",),
    )
    return replace(
        HEALTHY,
        inputs={
            "output": output._replace(publishers=()),
            "safety": topic("safety"),
            "teleop": topic("teleop", Publisher(teleop, TYPE, stamps, speeds)),
            "navigation": topic("navigation", plan),
            "default": topic("default", ZEROS),
        },
        output=output,
        pose_publishers=tuple(filter(None, (reporter, *poses))),
        moves=None,
        **others,
    )


ZERO = {"stamps": (NOW, NOW + S // 20), "speeds": (0.0, 0.0), "active": "teleop"}


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize(
    "changes, problem",
    [
        ({"plan": PLAN, "active": "navigation"}, None),
        ({**ZERO, "speeds": (1.0, 1.0)}, None),
        (
            {"active": "idle"},
            "no node publishes commands: {mux}/input/navigation has no publisher. Start your node",
        ),
        (
            {"active": "default"},
            "To drive with {teleop}, hold a key down in its window or page, or on MuSHR's joystick "
            "hold LB. To drive with this package's node, type: roslaunch mushr_ros_intro real_car",
        ),
        ({"plan": SILENT, "active": "default"}, "no commands arrived from /path_publisher. Read"),
        (
            {"plan": PLAN, **ZERO},
            "is in use by {teleop}, so the commands of /path_publisher do not reach the car. "
            "MuSHR's joystick node sends stops until a button is held: RB",
        ),
        (ZERO, "all commands of {teleop} have speed 0. MuSHR's joystick node sends"),
        (
            {"plan": PLAN, "active": "navigation", "poses": ("/a", "/b")},
            "/a and /b run at the same time: each reports a pose of the car 'car'. Stop",
        ),
        (
            {"plan": PLAN, "active": "navigation", "muxes": (MANAGER, "/other")},
            "{manager} and /other run at the same time: each is a mux of the car 'car'. Stop one",
        ),
        (
            {
                "plan": PLAN,
                "active": "navigation",
                "muxes": (MANAGER, MUX),
                "dead": {MANAGER: CallFault.REFUSED},
            },
            "{manager} has died",
        ),
    ],
)
def test_mushrs_systems(system, changes, problem):
    found = [str(each) for each in diagnose(in_mushr(system, **changes))]
    assert len(found) == (problem is not None), found
    for finding in found:
        assert problem.format(teleop=SYSTEMS[system][0], manager=MANAGER, mux=MUX) in finding


def test_no_hint_about_the_tutorials_listing_for_a_joystick():
    driving = {"stamps": (0, 0), "speeds": (1.0, 1.0), "active": "teleop"}
    assert not hints(in_mushr("car, master", **driving))
