"""Check examples/my_ros_intro, the tutorial's listing corrected, in lock-step and in real time."""

import filecmp
import inspect
import os
import shutil
import signal
import sys
from unittest import mock

import pytest
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped

from mushr_ros_intro.replay.judge import CHECK_NAMES
from support.geometry import ANGLE_TOLERANCE, POSITION_TOLERANCE, angle_between, closed_form
from support.helpers import PATIENCE, ForkedProcess, Recording, node, wait_for
from support.listing_page import states
from support.messages import COMMAND_TIMEOUT, NAVIGATION, OUTPUT
from support.paths import PACKAGE, PLANS
from support.world import launch

EXAMPLE = os.path.join(PACKAGE, "examples", "my_ros_intro")
NODE = os.path.join(EXAMPLE, "src", "path_publisher.py")
PERIOD = 100_000_000
"""[ns] Between two commands."""
START = (1.0, 2.0, 2.5)

ENDS_WITHOUT_ERROR = pytest.mark.skipif(
    sys.version_info >= (3, 9) and "isAlive" in inspect.getsource(rospy.core.signal_shutdown),
    reason="rospy of Debian 11 calls Thread.isAlive when a node ends; Python 3.9 does not have it",
)

SLOW = """
import runpy, sys, time
import rospy.core, rospy.impl.tcpros_base
write = rospy.impl.tcpros_base.TCPROSTransport.write_data

def write_late(self, data):
    if rospy.core._in_shutdown:
        time.sleep(0.1)
    return write(self, data)

time.monotonic = lambda: 0.0  # the time for which the node waits has no limit
rospy.impl.tcpros_base.TCPROSTransport.write_data = write_late
runpy.run_path({!r}, run_name="__main__")
"""
"""Run a node; when it ends, its threads that send are late."""

ELSEWHERE = ("_init_pose_topic:=/elsewhere", f"_control_topic:={NAVIGATION}2")

# Each fault: the plan (None: no file), more arguments of the node, a part of its message.
FAULTS = {
    "word": ("0,0,0\n\n2.0,fast\n", (), "plan.txt:3: '2.0,fast'; expected speed, steering angle"),
    "no file": (None, (), "No such file or directory: "),
    "no car": ("0,0,0\n1,0\n", ("_control_topic:=/nobody",), "for a subscriber of /nobody"),
    "no placement": ("9,8,7\n1,0\n", ELSEWHERE, "to be at the start pose 9.0, 8.0, 7.0"),
}


def start_world():
    """Run the simulated car in real time."""
    return launch("sim.launch", map="none", laser=False, model=False, watched=False)


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """Return the path of the node in a copy of the example, as a student makes it.

    It is executable, and ROS finds the copy.
    """
    copied = shutil.copytree(EXAMPLE, str(tmp_path_factory.mktemp("src") / "my_ros_intro"))
    path = os.path.join(copied, "src", "path_publisher.py")
    os.chmod(path, 0o755)
    packages = os.pathsep.join((copied, os.environ["ROS_PACKAGE_PATH"]))
    with mock.patch.dict(os.environ, ROS_PACKAGE_PATH=packages):
        yield path


class Car:
    """The simulated car: recordings of its commands and poses."""

    def __init__(self):
        # Not the input of the mux: the node waits for one subscriber, which has to be the mux.
        self.output = Recording(OUTPUT, AckermannDriveStamped).connected()
        self.poses = Recording("/car/car_pose", PoseStamped).connected()

    @property
    def commands(self):
        """The commands of the node. When they end, the mux sends a stop without a stamp."""
        return [m for m in self.output.messages if m.header.stamp]

    def assert_is_at(self, expected):
        """Fail unless the car stops at the expected pose."""
        last = self.commands[-1].header.stamp
        x, y, theta = self.poses.pose_at_rest(last + rospy.Duration(COMMAND_TIMEOUT))
        assert abs(complex(x, y) - complex(*expected[:2])) < POSITION_TOLERANCE
        assert angle_between(theta, expected[2]) < ANGLE_TOLERANCE

    def wait_for_stop(self):
        """Wait until the last command is a stop."""
        wait_for(lambda: self.commands and not self.commands[-1].drive.speed, "a stop")


@pytest.fixture(scope="module")
def sim():
    """Return the car."""
    return Car()


@pytest.fixture
def car(sim):
    """Return the car, without the commands of earlier tests."""
    sim.output.clear()
    return sim


def test_replay(example, tmp_path):
    """Every check passes, with errors of at most 1e-9 m and rad.

    The rows do not last whole tenths of a second, so commands arrive late and correct reported
    poses.
    """
    plan = tmp_path / "short_rows.txt"
    plan.write_text("1,2,2.5\n2.0,0.1,0.25\n1.0,-0.3,0.35\n-1,0.2,0.25\n")
    points = tmp_path / "points.yaml"
    points.write_text("tolerances: {position: 1e-9, angle: 1e-9, path: 1e-9}")
    drives = ("--node", "my_ros_intro", "path_publisher.py", "--points", str(points))
    with node("grade.py", str(plan), *drives) as process:
        assert process.wait(2 * PATIENCE) == 0, process.output
    lines = process.output.splitlines()
    assert [line.split(":")[0] for line in lines[1:9]] == [f"ok   {name}" for name in CHECK_NAMES]
    assert lines[-1] == "all checks passed"  # there is no note about a missing stop


def test_real_time(example, car, tmp_path):
    """In real time, the stamps and the final pose are exact, too."""
    rows = [(2.0, 0.09, 1.0), (3.0, -0.15, 0.25), (-1.0, 0.3, 0.3)]
    plan = tmp_path / "plan.txt"
    plan.write_text("# comment\n\n1, 2, 2.5\n2.0, 0.09\n3.0, -0.15, 0.25  # short\n-1,0.3,0.3\n\n")
    launch = ("roslaunch", "my_ros_intro", "my_path_publisher.launch.xml", f"plan_file:={plan}")
    with ForkedProcess(*launch) as publisher:
        assert publisher.wait() == 0, publisher.output
    car.wait_for_stop()
    car.assert_is_at(closed_form(START, rows))
    stamps = [m.header.stamp.to_nsec() for m in car.commands]
    due = [number * PERIOD for number in range(13)]  # 1.25 s
    due += [1_250_000_000 + number * PERIOD for number in range(3)] + [1_550_000_000]
    assert [each - stamps[0] for each in stamps] == due
    assert {m.header.frame_id for m in car.commands} == {"car/base_footprint"}


@ENDS_WITHOUT_ERROR
def test_interrupted(example, car, tmp_path):
    """Ctrl-C: the last message is a stop, and the car stops at its stamp."""
    plan = tmp_path / "plan.txt"
    plan.write_text("1,2,2.5\n1.0,0.2,60\n")
    slow = tmp_path / "slow.py"
    slow.write_text(SLOW.format(example))
    with ForkedProcess(str(slow), f"_plan_file:={plan}") as publisher:
        wait_for(lambda: len(car.commands) >= 5, "five commands")
        publisher.send_signal(signal.SIGINT)
        assert publisher.wait() == 0, publisher.output
    car.wait_for_stop()
    seconds = (car.commands[-1].header.stamp - car.commands[0].header.stamp).to_sec()
    car.assert_is_at(closed_form(START, [(1.0, 0.2, seconds)]))


@ENDS_WITHOUT_ERROR
def test_refused(sim, tmp_path):
    """A fault is one line with the reason, and exit status 1."""
    Recording("/elsewhere", PoseWithCovarianceStamped)
    Recording(f"{NAVIGATION}2", AckermannDriveStamped)
    processes = {}
    for number, (name, (plan, arguments, _)) in enumerate(FAULTS.items()):
        path = tmp_path / str(number) / "plan.txt"
        path.parent.mkdir()
        if plan is not None:
            path.write_text(plan)
        own_name = f"__name:=faulty_{number}"
        processes[name] = ForkedProcess(NODE, f"_plan_file:={path}", own_name, *arguments)
    for name, each in processes.items():
        assert each.wait() == 1, name
        assert FAULTS[name][2] in each.output, name
        assert "Traceback" not in each.output, name


def test_is_a_students():
    """The example does not use the library of this package. Its plans are those of the tutorial."""
    with open(NODE) as file:
        assert "mushr_ros_intro" not in file.read()
    plans = sorted(os.listdir(os.path.join(EXAMPLE, "plans")))
    assert plans == ["figure_8.txt", "straight_line.txt"]
    same = filecmp.cmpfiles(os.path.join(EXAMPLE, "plans"), PLANS, plans, shallow=False)
    assert same == (plans, [], [])


@pytest.mark.full
@pytest.mark.parametrize("heading", states())
def test_each_change_of_the_page(tmp_path, heading):
    """The program of docs/exact.md passes all checks after each of its changes."""
    typed = tmp_path / "path_publisher.py"
    typed.write_text(states()[heading])
    typed.chmod(0o755)
    (tmp_path / "package.xml").write_text("<package><name>typed</name></package>")
    packages = os.pathsep.join((str(tmp_path), os.environ["ROS_PACKAGE_PATH"]))
    drives = ("--node", "typed", typed.name)
    with node("grade.py", "test_drive", *drives, ROS_PACKAGE_PATH=packages) as process:
        assert process.wait() == 0, process.output
    assert "all checks passed" in process.output
