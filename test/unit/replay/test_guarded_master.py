"""Check which calls of the master a node under test may make."""

import http.client
from urllib.parse import urlsplit

import pytest

from mushr_ros_intro.replay.guarded_master import (
    MAX_NAMES,
    MAX_REQUEST,
    MAX_TEXT,
    REFUSED,
    GuardedMaster,
)

CAR = "/car/car_sim"
API = "http://localhost:1"
STEP = "/car/car_sim/step"
REGISTERS = f"registers or unregisters the node {CAR}"
POSES = "geometry_msgs/PoseStamped"
SERVICE = "rosrpc://localhost:1"

POSE = "/car/car_pose"

ACTIONS = [
    # A call, how it is recorded, and whether it is refused.
    (("registerPublisher", "/student", POSE, POSES, API), f"publishes on {POSE}", 0),
    (("registerPublisher", "/car/student", "car_pose", POSES, API), f"publishes on {POSE}", 0),
    (("registerPublisher", CAR, "/other", POSES, API), REGISTERS, 1),
    (("registerPublisher", "car/car_sim", "/other", POSES, API), REGISTERS, 1),
    (("unregisterSubscriber", CAR, "/commands", API), REGISTERS, 1),
    (("unregisterService", CAR, STEP, SERVICE), REGISTERS, 1),
    (("lookupService", "/student", STEP), f"calls the service {STEP}", 1),
    (("lookupService", CAR, "~step"), f"calls the service {STEP}", 1),
    (("registerService", "/student", STEP, SERVICE, API), f"offers the service {STEP}", 1),
    (("setParam", "/student", "/car/car_sim/a", 1), "changes the parameter /car/car_sim/a", 1),
    (("setParam", "/student", "/car/car_sim", {}), "changes the parameter /car/car_sim", 1),
    (("setParam", "/car/student", "car_sim/a", 1), "changes the parameter /car/car_sim/a", 1),
    (("setParam", "/student", "/car", {}), "changes the parameter /car", 1),
    (("setParam", "/student", "/", {}), "changes the parameter /", 1),
    (("deleteParam", "/student", "/car/"), "changes the parameter /car", 1),
    (("deleteParam", "/student", "/use_sim_time"), "changes the parameter /use_sim_time", 1),
    (("shutdown", "/student", "bye"), "shuts down the master", 1),
]

ALLOWED = [
    ("registerPublisher", "/student", "/commands", POSES, API),
    ("registerPublisher", "/student", "/car/car_pose2", POSES, API),
    ("registerSubscriber", "/student", "/car/car_pose", POSES, API),
    ("unregisterPublisher", "/student", "/car/car_pose", API),
    ("lookupNode", "/student", CAR),
    ("getParam", "/student", "/car/car_sim/a"),
    ("setParam", "/student", "/car/car_simulator", 1),
    ("setParam", "/student", "/ca", 1),
    ("setParam", "/student", "/student/a", 1),
    ("deleteParam", "/student", "/other"),
    ("registerService", "/student", "/student/step", SERVICE, API),
    ("lookupService", "/student", "/student/step"),
    ("getSystemState", "/student"),
]


@pytest.fixture
def master():
    """Return a master with a car, which is guarded."""
    made = GuardedMaster()
    made._dispatch("setParam", (CAR, "/car/car_sim/a", 5))
    for topic in ("/car/car_pose", "/commands"):
        made._dispatch("registerPublisher", (CAR, topic, POSES, API))
    made._dispatch("registerSubscriber", (CAR, "/initialpose", POSES, API))
    made._dispatch("registerService", (CAR, STEP, SERVICE, API))
    assert made.actions == []
    made.guard(CAR, ["/use_sim_time", CAR], ["/commands"])
    return made


def test_names_are_few_and_short(master):
    """A node cannot make a verdict long, or slow."""
    for number in range(2 * MAX_NAMES):
        name = f"/car/car_sim/{number}{'a' * 2000}"
        master._dispatch("setParam", ("/student", name, 1))
        master._dispatch("registerPublisher", ("/student", f"/{name}", name, API))
    for texts in (master.actions, master.published, master.published.values()):
        assert len(texts) == MAX_NAMES
        assert max(map(len, texts)) == MAX_TEXT


@pytest.mark.parametrize("name", ["/student/plan_file", "/student", "/student/"])
@pytest.mark.parametrize("method", ["getParam", "subscribeParam"])
def test_the_plan_is_read(master, method, name):
    master._dispatch("setParam", ("/student", "/student/plan_file", "plan.txt"))
    for other in ("/use_sim_time", "/plan_file"):
        master._dispatch("getParam", ("/student", other))
    assert not master.plan_is_read
    master._dispatch(method, ("/student", *[API] * (method == "subscribeParam"), name))
    assert master.plan_is_read


@pytest.mark.parametrize(("call", "action", "is_refused"), ACTIONS)
def test_actions(master, call, action, is_refused):
    method, *arguments = call
    before = master.getSystemState("/"), master.getParam("/", "/")
    answer = master._dispatch(method, tuple(arguments))
    assert len(master.actions) == 1 and master.actions[0] == action
    assert (answer == REFUSED) == bool(is_refused)
    if is_refused:
        assert (master.getSystemState("/"), master.getParam("/", "/")) == before
    master._dispatch(method, tuple(arguments))
    assert len(master.actions) == 1  # each action once


@pytest.mark.parametrize("call", ALLOWED)
def test_allowed(master, call):
    answer = master._dispatch(call[0], tuple(call[1:]))
    assert answer != REFUSED and master.actions == []


@pytest.mark.parametrize("method", ["_shutdown", "guard", "record", "serve", "_dispatch"])
def test_only_the_methods_of_a_master(master, method):
    with pytest.raises(AttributeError):
        master._dispatch(method, ())


def test_topics_without_a_publisher(master):
    """Those of the node under test count, not those of the simulated car."""
    assert master.unpublished() == []
    for topic in ("/car/car_pose", "/car/particle_filter/inferred_pose", "/commands"):
        master._dispatch("registerSubscriber", ("/student", topic, POSES, API))
    assert master.unpublished() == ["/car/particle_filter/inferred_pose"]


@pytest.mark.parametrize("length", ["6000000000", str(MAX_REQUEST + 1), "x"])
def test_a_call_that_is_too_long(length):
    """It is refused before it is read; the memory of the replay would be full."""
    master = GuardedMaster()
    connection = http.client.HTTPConnection(urlsplit(master.serve()).netloc, timeout=20.0)
    connection.putrequest("POST", "/")
    connection.putheader("Content-Length", length)
    connection.endheaders()
    assert connection.getresponse().status == 413
    connection.close()
    assert master.actions == [f"sends a call of {length} bytes; the limit is 10000000 bytes"]
