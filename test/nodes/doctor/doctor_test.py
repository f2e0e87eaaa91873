#!/usr/bin/python3
"""The findings of the doctor in a running system, one fault after the other."""

import contextlib
import os
import signal
import socket
import sys
import threading
import time
import unittest
from http.server import BaseHTTPRequestHandler, HTTPServer

import rosgraph
import rosgraph.network
import roslib.packages
import rospy
import rostest
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger, TriggerResponse

from mushr_ros_intro.doctor.rules import diagnose
from mushr_ros_intro.ros.observation import Observer
from support.ghost import Ghost
from support.helpers import Process, Recording, free_port, node, publisher, wait_for
from support.messages import command, placement

DOCTOR = os.path.join(roslib.packages.get_pkg_dir("mushr_ros_intro"), "src", "doctor.py")
MUX = "/car/mux/ackermann_cmd_mux"
NAVIGATION = f"{MUX}/input/navigation"
NOWHERE = "http://localhost:1/"
"""An address at which nothing listens."""


class OtherCommand(AckermannDriveStamped):
    """A message of the same name with another definition."""

    _md5sum = "0123456789abcdef0123456789abcdef"


class Driver:
    """Sends a command every 50 ms from a thread of its own.

    Its publisher stays until it is released: rospy's subscribers may take a publisher that is
    registered again for the former one, and not connect.
    """

    _publishers = {}

    def __init__(self, topic, speed=1.0, stamp=rospy.Time.now):
        if topic not in self._publishers:
            made = rospy.Publisher(topic, AckermannDriveStamped, queue_size=10)
            self._publishers[topic] = made
        self._publisher = self._publishers[topic]
        self._speed, self._stamp = speed, stamp
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._drive, daemon=True)

    def _drive(self):
        while not self._ends.wait(0.05):
            self._publisher.publish(command(self._stamp(), self._speed, 0.0))

    def __enter__(self):
        self._thread.start()

    def __exit__(self, *_):
        self._ends.set()
        self._thread.join()

    @classmethod
    def release(cls, *topics):
        for topic in topics:
            cls._publishers.pop(topic).unregister()


class Connections(rospy.SubscribeListener):
    """Counts the subscribers that connect to a publisher."""

    def __init__(self):
        super().__init__()
        self.count = 0

    def peer_subscribe(self, topic_name, topic_publish, peer_publish):
        self.count += 1


class TestDoctor(unittest.TestCase):
    def setUp(self):
        self.uri = rosgraph.get_master_uri()
        self.me = rospy.get_name()

    def expect(self, *problems, car="car", **options):
        """Observe until there is one finding for each of `problems`, and no other."""
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

    def unregister(self, name):
        """Remove a node's registrations, as rosnode cleanup does."""
        master, caller = rosgraph.Master("/doctor_test"), rosgraph.Master(name)
        uri = master.lookupNode(name)
        publishers, subscribers, services = master.getSystemState()
        for topic, names in publishers:
            if name in names:
                caller.unregisterPublisher(topic, uri)
        for topic, names in subscribers:
            if name in names:
                caller.unregisterSubscriber(topic, uri)
        for service, names in services:
            if name in names:
                caller.unregisterService(service, master.lookupService(service))

    def test_0_no_publisher(self):
        self.expect(f"no node publishes commands: {NAVIGATION} has no publisher")

    def test_path_publisher(self):
        # Healthy, blocked by another input, stopped, killed, unregistered.
        Driver.release(NAVIGATION)
        with node("path_publisher.py", "_plan_file:=circle", "_loop:=true") as process:
            self.expect()
            with Process(sys.executable, DOCTOR) as doctor:
                self.assertEqual(doctor.wait(), 0, doctor.output)
            expected = "no fault found: /path_publisher sends commands, and the car moves\n"
            self.assertEqual(doctor.output, expected)
            self.assertNotIn("doctor", process.output)  # no trace in other terminals
            with Driver(f"{MUX}/input/teleop", 0.0):
                self.expect(f"'teleop' of the mux has a higher priority and is in use by {self.me}")
            Driver.release(f"{MUX}/input/teleop")
            process.send_signal(signal.SIGSTOP)
            self.expect("/path_publisher does not respond", call_timeout=0.3)
            process.send_signal(signal.SIGKILL)
            process.wait()
            self.expect("/path_publisher has died")
            self.unregister("/path_publisher")  # its parameters remain
        self.expect(f"no node publishes commands: {NAVIGATION} has no publisher")

    def test_unknown_host(self):
        master, uri = rosgraph.Master("/ghost"), "http://nosuch.invalid:1/"
        master.registerPublisher("/ghostly", "std_msgs/String", uri)
        self.addCleanup(master.unregisterPublisher, "/ghostly", uri)
        with Driver(NAVIGATION):
            self.expect("/ghost cannot be reached: this machine cannot resolve the host name")

    def test_commands(self):
        with Driver(NAVIGATION, 0.0):
            self.expect(f"all commands of {self.me} have speed 0")
        with Driver(NAVIGATION, 1.0, lambda: rospy.Time(0)):
            self.expect()
        with Driver(NAVIGATION, 1.0, lambda: rospy.Time.now() - rospy.Duration(9)):
            self.expect("s behind the clock of this machine")
        with Driver(f"{MUX}/output"):
            self.expect()
        Driver.release(f"{MUX}/output")
        with Driver("/cmd"):
            self.expect(f"the commands of {self.me} have no effect: no node subscribes to /cmd")
        Driver.release("/cmd")
        self.expect(f"no commands arrived from {self.me}")

    def test_another_definition_of_the_type(self):
        wrong = rospy.Publisher(f"{MUX}/input/safety", OtherCommand, queue_size=1)
        self.addCleanup(wrong.unregister)
        self.expect(f"{self.me} was built with another definition of ackermann_msgs")

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
            ghost = Ghost(publishes=[topic], port=server.getsockname()[1])
            self.addCleanup(ghost.end)
            self.expect(f"/ghost publishes std_msgs/String on {topic}", listening_time=0.0)

    def test_a_waiting_publisher_goes_on_waiting(self):
        topic = "/car2/mux/ackermann_cmd_mux/input/navigation"
        master = rosgraph.Master("/ghost")  # a dead subscriber
        master.registerSubscriber(topic, AckermannDriveStamped._type, NOWHERE)
        self.addCleanup(master.unregisterSubscriber, topic, NOWHERE)
        connections = Connections()
        waiting = rospy.Publisher(topic, AckermannDriveStamped, connections, queue_size=1)
        self.addCleanup(waiting.unregister)
        self.expect("/ghost has died", "the car 'car2' is not running", car="car2")
        self.assertEqual(connections.count, 0)

    def test_time(self):
        rospy.set_param("/use_sim_time", True)
        self.addCleanup(rospy.set_param, "/use_sim_time", False)
        with Driver(NAVIGATION):
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
            self.expect(f"the stamps of the commands of {self.me} are 9")

    def test_wall(self):
        collisions = Recording("/car/car_sim/collision", PoseArray).connected()
        placements = publisher("/initialpose", PoseWithCovarianceStamped)
        placements.publish(placement(rospy.Time(), 48.9, 0.0, 0.0))
        with Driver(NAVIGATION):
            wait_for(lambda: collisions.last and collisions.last.poses, "the wall")
            collisions.subscriber.unregister()  # in one process, a topic has one type
            self.expect("the car touches a wall at (49.0200 m, 0.0000 m, 0.0000 rad)")
        placements.publish(placement(rospy.Time(), 0.0, 0.0, 0.0))
        with Driver(NAVIGATION):
            self.expect()

    def test_another_car(self):
        problem = "the car 'car2' is not running: no node subscribes to /car2/mux/"
        self.expect(problem, car="car2")
        self.expect("; running: car. Type", car="car2")

    def test_masters(self):
        running, self.uri = self.uri, "http://nosuch.invalid:11311"
        problem = "its host name cannot be resolved"
        self.expect(f"{problem}; a master runs on this machine", default_master=running)
        self.expect(f"{problem}. Check the network", default_master=NOWHERE)
        self.uri = "localhost:11311"
        self.expect("expected is an address such as http://localhost:11311")
        with HTTPServer(("localhost", 0), BaseHTTPRequestHandler) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            self.uri = f"http://localhost:{server.server_port}"
            self.expect("the program there is not a ROS master", default_master=NOWHERE)
            server.shutdown()
        with socket.create_server(("localhost", 0)) as stopped:
            self.uri = f"http://localhost:{stopped.getsockname()[1]}"
            problem = "the master there does not respond"
            self.expect(problem, default_master=NOWHERE, call_timeout=0.3)

    def test_a_node_of_an_earlier_master(self):
        port = free_port()
        self.uri = f"http://localhost:{port}"
        node = (sys.executable, "-c", "import time; time.sleep(60)", "__name:=rviz")
        with Process(
            *node, ROS_MASTER_URI=self.uri, ROS_NAMESPACE="/car"
        ), contextlib.ExitStack() as stack:
            time.sleep(0.05)  # Linux measures the start of a process in steps of 0.01 s
            stack.enter_context(Process("rosmaster", "-p", str(port)))
            wait_for(rosgraph.Master("/doctor_test", self.uri).is_online, "the master")
            with Process(*node, ROS_MASTER_URI=self.uri):  # it may still be about to register
                problem = "/car/rviz (process "
                self.expect(problem, "the car 'car' is not running", default_master=NOWHERE)

    def test_no_master(self):
        with Process(sys.executable, DOCTOR, ROS_MASTER_URI=NOWHERE) as doctor:
            self.assertEqual(doctor.wait(), 1, doctor.output)
        self.assertEqual(doctor.output.count("\n"), 1, doctor.output)
        self.assertIn(f"ROS_MASTER_URI is {NOWHERE}, but no master runs there", doctor.output)

    def test_interrupts(self):
        # Ctrl-C leaves no registration; a master that stops meanwhile is reported.
        port = free_port()
        uri = f"http://localhost:{port}"
        master = rosgraph.Master("/doctor_test", uri)

        def nodes():
            return [name for part in master.getSystemState() for _, names in part for name in names]

        with Process("rosmaster", "-p", str(port)) as roscore:
            wait_for(master.is_online, "the master")
            with Process(sys.executable, DOCTOR, ROS_MASTER_URI=uri) as doctor:
                wait_for(nodes, "the doctor to join")

                def is_interrupted():
                    doctor.send_signal(signal.SIGINT)
                    return not doctor.running

                wait_for(is_interrupted, "the end of the doctor")
                self.assertEqual(doctor.wait(), 130, doctor.output)
            self.assertEqual((nodes(), doctor.output), ([], ""))
            with Process(sys.executable, DOCTOR, ROS_MASTER_URI=uri) as doctor:
                wait_for(nodes, "the doctor to join")
                roscore.send_signal(signal.SIGSTOP)
                self.assertEqual(doctor.wait(), 1, doctor.output)
                roscore.send_signal(signal.SIGCONT)
        self.assertIn("the master there does not respond", doctor.output)


if __name__ == "__main__":
    rospy.init_node("doctor_test")
    rostest.rosrun("mushr_ros_intro", "doctor", TestDoctor)
