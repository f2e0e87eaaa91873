#!/usr/bin/python3
"""Break the running system in every way that the doctor knows, and see what it says."""

import os
import signal
import socket
import sys
import threading
import time
import unittest
from http.server import BaseHTTPRequestHandler, HTTPServer
from unittest import mock

import rosgraph
import roslib.packages
import rospy
import rostest
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from std_srvs.srv import Trigger, TriggerResponse

from support.helpers import Process, Recording, node, publisher, wait_for

sys.path.append(os.path.join(roslib.packages.get_pkg_dir("mushr_ros_intro"), "src"))
import doctor  # noqa: E402
from mushr_ros_intro.doctor import facts, rules
from mushr_ros_intro.ros import observation

MUX = "/car/mux/ackermann_cmd_mux"
NAVIGATION = f"{MUX}/input/navigation"
CAR = "/car/car_sim"
LISTENING = 0.2
"""[s] Enough for three commands; where a busy machine delays them, the doctor looks again."""
SHORT_PATIENCE = mock.patch.object(observation, "CALL_PATIENCE", 0.3)
"""With what does not answer; where a busy machine does not, the doctor looks again."""
NOWHERE = "http://localhost:1/"
"""Where nothing listens."""


class OtherCommand(AckermannDriveStamped):
    """A message of the same name that has another definition."""

    _md5sum = "0123456789abcdef0123456789abcdef"


class Driver:
    """Sends a command every 50 ms, from a thread of its own.

    Its publisher stays until it is released, and does not come again: rospy's subscribers may take
    a publisher that goes and comes again for the one that they knew, and not connect.
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
            msg = AckermannDriveStamped()
            msg.header.stamp, msg.drive.speed = self._stamp(), self._speed
            self._publisher.publish(msg)

    def __enter__(self):
        self._thread.start()

    def __exit__(self, *_):
        self._ends.set()
        self._thread.join()

    @classmethod
    def release(cls, *topics):
        for topic in topics:
            cls._publishers.pop(topic).unregister()


class Peers(rospy.SubscribeListener):
    """Notes who connects with a publisher."""

    def __init__(self):
        super().__init__()
        self.names = []

    def peer_subscribe(self, topic_name, topic_publish, peer_publish):
        self.names.append(topic_name)


class TestDoctor(unittest.TestCase):
    def setUp(self):
        self.master = rosgraph.Master("/doctor_test")
        self.uri = rosgraph.get_master_uri()
        self.me = rospy.get_name()

    def expect(self, *words, car="car"):
        """Look until each finding has one of `words`, and each of them is found."""
        said = []

        def is_said():
            seen = observation.Doctor(car, self.uri, LISTENING).look()
            said[:] = map(str, rules.diagnose(seen))
            fits = all(any(each in line for line in said) for each in words)
            return fits and len(said) == len(words)

        try:
            wait_for(is_said, f"{words}")
        except AssertionError as error:
            raise AssertionError(f"{error}; got {said}") from None

    def expect_healthy(self):
        self.expect()

    def unregister(self, name):
        """Let the master forget a node, as rosnode cleanup does."""
        uri = self.master.lookupNode(name)
        publishers, subscribers, services = self.master.getSystemState()
        caller = rosgraph.Master(name)
        for topic, names in publishers:
            if name in names:
                caller.unregisterPublisher(topic, uri)
        for topic, names in subscribers:
            if name in names:
                caller.unregisterSubscriber(topic, uri)
        for service, names in services:
            if name in names:
                caller.unregisterService(service, self.master.lookupService(service))

    def forget_hosts(self):
        """Know no host in .invalid, without asking servers for it, which may take its time."""
        find = socket.getaddrinfo

        def find_some(host, *arguments, **options):
            if str(host).endswith(".invalid"):
                raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")
            return find(host, *arguments, **options)

        patch = mock.patch.object(socket, "getaddrinfo", find_some)
        patch.start()
        self.addCleanup(patch.stop)

    def test_0_nobody_publishes(self):
        self.expect(f"nobody publishes commands: {NAVIGATION} has no publisher")

    def test_plan(self):
        # Started, healthy, held by another input, stopped, killed, forgotten.
        Driver.release(NAVIGATION)
        arguments = ("path_publisher.py", "_plan_file:=circle", "_loop:=true")
        with node(*arguments) as process:
            self.expect_healthy()
            with Process(sys.executable, doctor.__file__) as run:
                self.assertEqual(run.wait(), 0, run.output)
            self.assertEqual(
                run.output,
                "nothing is wrong: the car is driven by /path_publisher, and it moves\n",
            )
            with Driver(f"{MUX}/input/teleop", 0.0):
                self.expect(f"the mux's input teleop is held by {self.me}, so the commands of /p")
            Driver.release(f"{MUX}/input/teleop")
            process.send_signal(signal.SIGSTOP)
            with SHORT_PATIENCE:
                self.expect("the master knows /path_publisher, but it does not answer")
            process.send_signal(signal.SIGKILL)
            process.wait()
            self.expect("the master knows /path_publisher, but nothing answers")
            self.unregister("/path_publisher")  # and its parameter plan_file is left over
        self.expect(f"nobody publishes commands: {NAVIGATION} has no publisher")

    def test_unknown_host(self):
        self.forget_hosts()
        master = rosgraph.Master("/ghost")
        uri = "http://nosuch.invalid:1/"
        master.registerPublisher("/ghostly", "std_msgs/String", uri)
        with Driver(NAVIGATION):
            self.expect("the master knows /ghost, but this machine does not know the name")
        master.unregisterPublisher("/ghostly", uri)

    def test_commands(self):
        with Driver(NAVIGATION, 0.0):
            self.expect(f"every command of {self.me} has the speed 0")
        with Driver(NAVIGATION, 1.0, lambda: rospy.Time(0)):
            self.expect(f"{self.me} sends commands with stamp 0")
        with Driver(NAVIGATION, 1.0, lambda: rospy.Time.now() - rospy.Duration(9)):
            self.expect(f"{self.me} stamps its commands -")
        with Driver(f"{MUX}/output"):
            self.expect_healthy()
        Driver.release(f"{MUX}/output")
        with Driver("/cmd"):
            self.expect(f"the commands of {self.me} go nowhere: nobody subscribes to /cmd")
        Driver.release("/cmd")
        self.expect(f"though there is {self.me} to send some")

    def test_commands_of_one_that_is_slow_to_connect(self):
        def slow_call(uri, method, *arguments):
            if method == "requestTopic":
                time.sleep(2.0 * LISTENING)
            return call(uri, method, *arguments)

        call = observation.call
        with Driver(NAVIGATION), mock.patch.object(observation, "call", slow_call):
            self.expect_healthy()

    def test_types(self):
        topic = f"{MUX}/input/default"
        listener = Peers()
        wrong = rospy.Publisher(topic, String, listener, queue_size=1)
        self.expect(f"{self.me} publishes std_msgs/String on {topic}, where {MUX} expects acker")
        wrong.unregister()
        wrong = rospy.Publisher(f"{MUX}/input/safety", OtherCommand, queue_size=1)
        self.expect(f"{self.me} was built with another definition of ackermann_msgs")
        wrong.unregister()
        self.assertEqual(listener.names, [])  # nobody is taken for the mux, which does not come

    def test_time(self):
        rospy.set_param("/use_sim_time", True)
        self.addCleanup(rospy.set_param, "/use_sim_time", False)
        with Driver(NAVIGATION):
            self.expect("use_sim_time is true, but nobody publishes /clock")
            clock = rospy.Publisher("/clock", Clock, queue_size=1)
            resume = rospy.Service("/car/car_sim/resume", Trigger, lambda _: TriggerResponse())
            with mock.patch.object(observation, "CLOCK_PATIENCE", LISTENING):
                self.expect(
                    f"the clock is held: /clock comes from {self.me} and does not move. "
                    "Type: rosservice call /car/car_sim/resume"
                )
            ticks = rospy.Timer(
                rospy.Duration(0.02), lambda _: clock.publish(rospy.Time.now() - rospy.Duration(99))
            )
            self.expect(f"{self.me} stamps its commands +9")
            ticks.shutdown()
            resume.shutdown()
            clock.unregister()

    def test_wall(self):
        collisions = Recording("/car/car_sim/collision", PoseArray).connected()
        placements = publisher("/initialpose", PoseWithCovarianceStamped)
        msg = PoseWithCovarianceStamped()
        msg.pose.pose.position.x, msg.pose.pose.orientation.w = 48.9, 1.0
        placements.publish(msg)
        with Driver(NAVIGATION):
            wait_for(lambda: collisions.last and collisions.last.poses, "the wall")
            self.expect("the car stands against a wall at (49.0200 m, 0.0000 m, 0.0000 rad)")
        msg.pose.pose.position.x = 0.0
        placements.publish(msg)
        wait_for(lambda: not collisions.last.poses, "no wall")
        with Driver(NAVIGATION):
            self.expect_healthy()

    def test_another_car(self):
        self.expect(
            "neither mux nor car is running for the car 'car2'; what runs is car", car="car2"
        )

    def test_masters(self):
        self.forget_hosts()
        with mock.patch.object(facts, "USUAL_MASTER", self.uri):
            self.uri = "http://nosuch.invalid:11311"
            self.expect("nobody knows a machine called nosuch.invalid, but a master runs on this")
        with mock.patch.object(facts, "USUAL_MASTER", NOWHERE):
            self.expect("nobody knows a machine called nosuch.invalid. Start the master there")
            self.uri = "localhost:11311"
            self.expect("that is no address")
            with HTTPServer(("localhost", 0), BaseHTTPRequestHandler) as server:
                thread = threading.Thread(target=server.serve_forever, daemon=True)
                thread.start()
                self.uri = f"http://localhost:{server.server_port}"
                self.expect("what answers there does not speak ROS")
                server.shutdown()
            with socket.create_server(("localhost", 0)) as stopped, SHORT_PATIENCE:
                self.uri = f"http://localhost:{stopped.getsockname()[1]}"
                self.expect("the master there does not answer: it is stopped")

    def test_no_master(self):
        with Process(sys.executable, doctor.__file__, ROS_MASTER_URI=NOWHERE) as process:
            self.assertEqual(process.wait(), 1, process.output)
        self.assertEqual(process.output.count("\n"), 1, process.output)
        self.assertIn(f"ROS_MASTER_URI is {NOWHERE}, and no master answers there", process.output)


if __name__ == "__main__":
    rospy.init_node("doctor_test")
    rostest.rosrun("mushr_ros_intro", "doctor", TestDoctor)
