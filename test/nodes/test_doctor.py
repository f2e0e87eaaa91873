"""The findings of the doctor in a running system, one fault after the other."""

import contextlib
import signal
import socket
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from unittest import mock

import rosgraph
import rosgraph.network
import rosnode
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse

from mushr_ros_intro.doctor.observation import Observer
from mushr_ros_intro.doctor.rules import diagnose, last_drive
from mushr_ros_intro.ros.xmlrpc_client import CallError, CallFault
from support.ghost import Ghost
from support.helpers import (
    Recording,
    RosTestCase,
    driver,
    master,
    node,
    publisher,
    wait_for,
)
from support.messages import MUX, NAVIGATION, OUTPUT, TELEOP, command, placement
from support.world import launch

NOWHERE = "http://localhost:1/"
"""An address without a server."""


def start_world():
    return launch("sim.launch", laser=False, model=False, watched=False)


publishers = {}
"""Publishers of commands by topic. Each stays registered until `release`.

If a publisher is registered again, rospy's subscribers may not connect to it.
"""


def release(topic):
    if topic in publishers:
        publishers.pop(topic).unregister()


@contextlib.contextmanager
def driving(topic, speed=1.0, stamp=rospy.Time.now, steering_angle=0.3, period=0.05):
    """Send a command in each period [s]; by default, the car drives in a circle without a wall."""
    if topic not in publishers:
        publishers[topic] = rospy.Publisher(topic, AckermannDriveStamped, queue_size=10)

    def send(_):
        publishers[topic].publish(command(stamp(), speed, steering_angle))

    timer = rospy.Timer(rospy.Duration(period), send)
    try:
        yield
    finally:
        timer.shutdown()
        timer.join()


class TestDoctor(RosTestCase):
    def setUp(self):
        super().setUp()
        self.uri = rosgraph.get_master_uri()
        self.me = rospy.get_name()

    def expect(self, *problems, car="car", **options):
        """Observe until there is exactly one finding for each of `problems`."""
        options = {"listening_time": 0.2, **options}
        found = []

        def are_found():
            found[:] = map(str, diagnose(Observer(car, self.uri, **options).observe()))
            fits = all(any(each in line for line in found) for each in problems)
            return fits and len(found) == len(problems)

        try:
            wait_for(are_found, f"{problems}")
        except AssertionError as error:
            raise AssertionError(f"{error}; got {found}") from None

    def test_path_publisher(self):
        # It is missing, works, is blocked by another input, stopped, and killed.
        release(NAVIGATION)
        self.expect(f"no node publishes commands: {NAVIGATION} has no publisher")
        with driver("circle", "_loop:=true") as process:
            self.expect()
            with node("doctor.py") as doctor:
                self.assertEqual(doctor.wait(), 0, doctor.output)
            expected = "no fault found: /path_publisher sends commands, and the car moves\n"
            self.assertEqual(doctor.output, expected)
            self.assertNotIn("doctor", process.output)  # no trace in other terminals
            with driving(TELEOP, 0.0):
                self.expect(f"'teleop' of the mux has a higher priority and is in use by {self.me}")
            release(TELEOP)
            process.send_signal(signal.SIGSTOP)
            self.expect("/path_publisher does not respond", call_timeout=0.3)
            process.send_signal(signal.SIGKILL)
            process.wait()
            self.expect("/path_publisher has died")
        rosnode.cleanup_master_blacklist(rosgraph.Master("/doctor_test"), ["/path_publisher"])

    def test_a_misspelt_topic_of_the_start_pose(self):
        misspelt = rospy.Publisher("/start_pose", PoseWithCovarianceStamped, queue_size=1)
        self.addCleanup(misspelt.unregister)
        with driving(NAVIGATION):
            self.expect("have no effect: no node subscribes to /start_pose")

    def test_commands(self):
        with driving(NAVIGATION, 0.0):
            self.expect(f"all commands of {self.me} have speed 0")
        with driving(NAVIGATION, 1.0, lambda: rospy.Time.now() - rospy.Duration(9)):
            self.expect("s behind the clock of this machine")
        with driving(NAVIGATION, period=1.0):
            self.expect(
                f"{self.me} sends a command every 1 s, but the mux stops", listening_time=2.2
            )
        with driving(OUTPUT):
            self.expect()
        release(OUTPUT)
        with driving("/cmd"):
            self.expect(f"the commands of {self.me} have no effect: no node subscribes to /cmd")
        release("/cmd")
        self.expect(f"no commands arrived from {self.me}")

    def test_a_silent_publisher_of_another_type_that_is_slow_to_connect(self):
        topic = f"{MUX}/input/default"
        header = {"callerid": "/ghost", "type": "std_msgs/String", "md5sum": "0" * 32}
        with socket.create_server(("localhost", 0)) as server:

            def connect():
                with contextlib.suppress(OSError):  # the server is closed
                    while True:
                        connection, _ = server.accept()
                        threading.Timer(
                            0.5, rosgraph.network.write_ros_handshake_header, (connection, header)
                        ).start()

            threading.Thread(target=connect, daemon=True).start()
            self.ending(Ghost(publishes=[topic], port=server.getsockname()[1]))
            self.expect(f"/ghost publishes std_msgs/String on {topic}", listening_time=0.0)

    def test_a_waiting_publisher_goes_on_waiting(self):
        topic = "/car2/mux/ackermann_cmd_mux/input/navigation"
        master = rosgraph.Master("/ghost")  # a dead subscriber
        master.registerSubscriber(topic, AckermannDriveStamped._type, NOWHERE)
        self.addCleanup(master.unregisterSubscriber, topic, NOWHERE)
        connections = mock.Mock()
        waiting = rospy.Publisher(topic, AckermannDriveStamped, connections, queue_size=1)
        self.addCleanup(waiting.unregister)
        self.expect("/ghost has died", "the car 'car2' is not running", car="car2")
        connections.peer_subscribe.assert_not_called()

    def test_time(self):
        rospy.set_param("/use_sim_time", True)
        self.addCleanup(rospy.set_param, "/use_sim_time", False)
        with driving(NAVIGATION):
            self.expect("use_sim_time is true, but no node publishes /clock")
            clock = rospy.Publisher("/clock", Clock, queue_size=1)
            self.addCleanup(clock.unregister)
            resume = rospy.Service("/car/car_sim/resume", Trigger, lambda _: TriggerResponse())
            self.addCleanup(resume.shutdown)
            self.expect(
                f"time stands still: /clock comes from {self.me} and does not advance. "
                "Type: rosservice call /car/car_sim/resume"
            )
            ticks = rospy.Timer(
                rospy.Duration(0.02), lambda _: clock.publish(rospy.Time.now() - rospy.Duration(99))
            )
            self.addCleanup(ticks.shutdown)
            self.expect(f"the stamps of the commands of {self.me} are at least 9")

    def test_wall(self):
        collisions = Recording("/car/car_sim/collision", PoseArray).connected()
        placements = publisher("/initialpose", PoseWithCovarianceStamped)
        placements.publish(placement(rospy.Time(), 48.9, 0.0, 0.0))
        with driving(NAVIGATION, steering_angle=0.0):
            wait_for(lambda: collisions.last and collisions.last.poses, "the wall")
            collisions.subscriber.unregister()  # in one process, a topic has one type
            self.expect("the car touches a wall at (49.0200 m, 0.0000 m, 0.0000 rad)")
        placements.publish(placement(rospy.Time(), 0.0, 0.0, 0.0))
        with driving(NAVIGATION):
            self.expect()

    def test_mushrs_mux(self):
        """Its configuration is in a file, its inputs have long names, `default` gets old stops."""
        mux = "/car3/mux/ackermann_cmd_mux"
        names = {"Teleoperation": "teleop", "Navigation": "navigation", "Default": "default"}
        inputs = [
            {"name": name, "topic": f"input/{topic}", "timeout": 0.2, "priority": -number}
            for number, (name, topic) in enumerate(names.items())
        ]
        rospy.set_param(mux, {"subscribers": inputs, "publisher": "output"})
        self.addCleanup(rospy.delete_param, "/car3")
        self.ending(node("ackermann_cmd_mux.py", "__ns:=/car3/mux"))
        self.ending(node("car_sim.py", "__ns:=/car3"))
        # Only the mux of this package publishes which node drives.
        monitor, uri = rosgraph.Master("/car3/drive_monitor"), rospy.get_node_uri()
        monitor.registerSubscriber(f"{mux}/who_drives", "std_msgs/String", uri)
        self.addCleanup(monitor.unregisterSubscriber, f"{mux}/who_drives", uri)
        self.expect(f"no node publishes commands: {mux}/input/navigation", car="car3")
        rospy.set_param(mux, {"yaml_cfg_file": "/mux.yaml"})
        old = rospy.Time.now() - rospy.Duration(13)
        with driving(f"{mux}/input/default", 0.0, lambda: old):
            self.expect(f"no node publishes commands: {mux}/input/navigation", car="car3")
            with driving(f"{mux}/input/navigation"):
                self.expect(car="car3")
        for name in names.values():
            release(f"{mux}/input/{name}")

    def test_the_last_drive(self):
        verdicts = rospy.Publisher("/car/drive_monitor/verdict", String, queue_size=1, latch=True)
        self.addCleanup(verdicts.unregister)
        verdicts.publish("the plan has been driven\nthe car drove 2.00 m")
        expected = ["the last drive of a plan: the plan has been driven; the car drove 2.00 m"]
        self.assertEqual(last_drive(Observer("car", self.uri).observe()), expected)

    def test_another_car(self):
        expected = "the car 'car2' is not running: no node subscribes to /car2/mux/"
        self.expect(expected, car="car2")
        topics = [f"/car2/mux/ackermann_cmd_mux/{each}" for each in ("output", "input/navigation")]
        viewer = Ghost(subscribes=topics, name="/rostopic_123")
        self.addCleanup(viewer.end)
        self.expect(expected, car="car2")

    def test_masters(self):
        running, self.uri = self.uri, "http://nosuch.invalid:11311"
        problem = "its host name cannot be resolved"
        self.expect(f"{problem}; a master runs on this machine", masters=[running])
        self.uri = "localhost:11311"
        self.expect("expected is an address such as http://localhost:11311")
        with HTTPServer(("localhost", 0), BaseHTTPRequestHandler) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            self.uri = f"http://localhost:{server.server_port}"
            self.expect("the program there is not a ROS master", masters=[NOWHERE])
            server.shutdown()
        with socket.create_server(("localhost", 0)) as stopped:
            self.uri = f"http://localhost:{stopped.getsockname()[1]}"
            problem = "the master there does not respond"
            self.expect(problem, masters=[NOWHERE], call_timeout=0.3)
        stops = mock.Mock(side_effect=CallError("", CallFault.NO_RESPONSE))
        with mock.patch.object(Observer, "_observe_system", stops):  # during the observation
            self.uri = running
            self.expect(problem)

    def test_no_master(self):
        with node("doctor.py", ROS_MASTER_URI=NOWHERE) as doctor:
            self.assertEqual(doctor.wait(), 1, doctor.output)
        self.assertEqual(doctor.output.count("\n"), 1, doctor.output)
        self.assertIn(f"ROS_MASTER_URI is {NOWHERE}, but no master runs there", doctor.output)

    def test_interrupts(self):
        # Ctrl-C leaves no registration.
        def nodes():
            return [name for part in proxy.getSystemState() for _, names in part for name in names]

        with master("/doctor_test") as (_, proxy):
            with node("doctor.py", ROS_MASTER_URI=proxy.master_uri) as doctor:
                wait_for(nodes, "the doctor to join")

                def is_interrupted():
                    doctor.send_signal(signal.SIGINT)
                    return not doctor.running

                wait_for(is_interrupted, "the end of the doctor")
                self.assertEqual(doctor.wait(), 130, doctor.output)
            self.assertEqual((nodes(), doctor.output), ([], ""))
