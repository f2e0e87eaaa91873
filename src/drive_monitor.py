#!/usr/bin/python3
"""Watch the drives of any node, and report how each of them ended."""

import sys
import time
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any, Callable, List, Optional, Tuple

import rosgraph
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseArray, PoseStamped
from std_msgs.msg import String, Time

from mushr_ros_intro.car.model import Command
from mushr_ros_intro.car.profile import names_in
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.monitor.car_watch import CarWatch
from mushr_ros_intro.monitor.expectation import Expectations
from mushr_ros_intro.monitor.results import write_result
from mushr_ros_intro.monitor.senders import Senders, fixed_plan
from mushr_ros_intro.monitor.verdict import Verdict
from mushr_ros_intro.monitor.watched_drive import WatchedDrive
from mushr_ros_intro.parameters import Values, choice, loaded
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.ros import conversions, node, ros_time
from mushr_ros_intro.ros.connections import wait_until_connected

TICK = 0.1
"""Period at which a drive is looked at [s of wall-clock time]."""

CHECK_PERIOD = 0.4
"""Period of the calls to the master and to nodes [s of wall-clock time]."""

EVENTS = 1000
"""Number of messages that are taken before the drive is looked at again."""

NOBODY = ("", "idle", "default")
"""The active input, in lower case, if no input drives; MuSHR's input default gets only stops."""

PLAN = (
    "watch one drive of this plan, whose result is the exit status; by default, the plans of nodes"
)
CAR = "car of the prediction, a name in config/cars; by default the simulated car"


class DriveMonitor:
    """The monitor of a car.

    Subscribes to the output of the mux (ackermann_msgs/AckermannDriveStamped), which shows the
    drives of all nodes, and to ``active`` of the mux, car_pose and car_sim/collision of the car.
    The plan of a drive is in the parameter ``~plan_file`` of the node that sends the commands.
    Publishes ``/CAR_NAME/predicted_path`` (nav_msgs/Path), when the first row of the present drive
    began on ``~start`` (std_msgs/Time; 0: no plan is driven), and how the last drive of a plan
    ended on ``~verdict`` (std_msgs/String). All are latched.

    Example: ``rosrun mushr_ros_intro drive_monitor.py _plan_file:=figure_8``
    """

    PARAMETERS = (
        node.car_name("the car to watch"),
        loaded("plan_file", fixed_plan, PLAN)._replace(default=None),
        choice("car", names_in(package_folder("config/cars")), None, CAR),
    )

    def __init__(self, values: Values) -> None:
        name = values["car_name"]
        self._fixed = values["plan_file"]
        self._expectations = Expectations(name, values["car"], values["plan_file"])
        self._car_name = name
        self._events: SimpleQueue[Tuple[Callable[[Any], None], Any]] = SimpleQueue()
        self._car = CarWatch(f"/{name}/car_pose")
        mux = f"/{name}/mux/ackermann_cmd_mux"
        self._senders = Senders(f"{mux}/input/")
        self._active: Optional[str] = None
        self._driver: Optional[str] = None
        """The node whose commands the mux forwards; None if the mux does not publish it."""
        self._is_judged = True
        """Whether the drive has been seen from its first command."""
        self._watched: Optional[WatchedDrive] = None
        self._verdict: Optional[Verdict] = None
        self._seen: List[str] = []
        self._pub_start = rospy.Publisher("~start", Time, queue_size=1, latch=True)
        self._pub_verdict = rospy.Publisher("~verdict", String, queue_size=1, latch=True)

        self._mux = [
            self._subscribe(f"{mux}/active", String, self._on_active),
            self._subscribe(f"{mux}/output", AckermannDriveStamped, self._on_command),
        ]
        self._subscribe(f"{mux}/driver", String, self._on_driver)
        self._subscribe(self._car.topic, PoseStamped, self._on_pose, queue_size=1)
        self._subscribe(f"/{name}/car_sim/collision", PoseArray, self._on_collision)
        rospy.loginfo("%s", values.text)

    def _subscribe(
        self, topic: str, kind: type, callback: Callable[[Any], None], **options: Any
    ) -> rospy.Subscriber:
        """Subscribe to a topic; the thread of `run` calls `callback` with each message."""
        put = self._events.put
        return rospy.Subscriber(
            topic, kind, lambda msg: put((callback, msg)), tcp_nodelay=True, **options
        )

    def run(self) -> int:
        """Watch until the node is shut down, or with ``~plan_file`` until the end of one drive.

        Returns the exit status: 1 if the plan has not been driven.
        """
        connected = [wait_until_connected(each, "publishers", minimum=1) for each in self._mux]
        deadline = time.monotonic() + 1.0
        while self._active is None and time.monotonic() < deadline:  # it is latched
            self._take_events(TICK)
        if all(connected):
            rospy.loginfo("watching the drives of /%s", self._car_name)
        next_check = 0.0
        while not rospy.is_shutdown():
            # Calls to the master can take seconds. Then take what has arrived before a judgement.
            self._take_events(TICK if self._watched else CHECK_PERIOD)
            if self._watched and not self._watched.is_identified:
                self._identify(self._watched)
                continue
            if self._watched and (verdict := self._watched.ended()):
                self._conclude(verdict)
            if self._fixed and self._verdict:
                return self._result(self._verdict)
            if time.monotonic() >= next_check:
                next_check = time.monotonic() + CHECK_PERIOD
                self._check()
        return 1 if self._fixed else 0

    # Events, in the thread of `run`

    def _take_events(self, seconds: float) -> None:
        """Process the messages that have arrived; wait up to `seconds` for the first one."""
        try:
            for count in range(EVENTS):
                callback, msg = self._events.get(count == 0 and seconds > 0.0, seconds)
                callback(msg)
        except Empty:
            pass

    def _on_active(self, msg: String) -> None:
        name = msg.data.strip()
        if self._active is None:  # the latched message when this node has connected
            self._is_judged = name.lower() in NOBODY
        self._active = name
        watched = self._watched
        sender = watched.sender if watched and name.lower() not in NOBODY else None
        if watched and sender and not self._senders.is_input_of(sender, name):
            watched.note_input(name)

    def _on_driver(self, msg: String) -> None:
        self._driver = msg.data
        if self._watched and self._watched.sender:
            self._watched.note_driver(msg.data)

    @conversions.ignore_bad_messages
    def _on_command(self, msg: AckermannDriveStamped) -> None:
        command = conversions.command_from_msg(msg)
        command = command._replace(stamp=ros_time.received_stamp(command.stamp))
        if self._watched and (self._watched.is_next(command) or self._is_of_new_node(command)):
            self._overtake()
        if self._watched:
            self._watched.add(command)
        elif command.speed or command.steering_angle:
            self._watched = WatchedDrive(command, self._car)

    def _is_of_new_node(self, command: Command) -> bool:
        """Return whether a command comes after a pause in which the node of the drive has ended."""
        watched = self._watched
        if not watched or not watched.sender or not watched.continues(command):
            return False
        with suppress(rosgraph.MasterException, OSError):
            self._senders.look()
        known = self._senders.known.get(watched.sender.name)
        return known is None or known.address != watched.sender.address

    @conversions.ignore_bad_messages
    def _on_pose(self, msg: PoseStamped) -> None:
        report = self._car.report(msg, time.monotonic())
        if self._watched and self._watched.begins_again(report):
            self._overtake()

    def _on_collision(self, msg: PoseArray) -> None:
        if self._watched and msg.poses:
            pose = conversions.pose_from_msg(msg.poses[0])
            self._watched.note_wall(msg.header.stamp.to_nsec(), pose)

    # Nodes and plans

    def _check(self) -> None:
        """Look for senders, for other nodes on the same topic, and whether the car is lost."""
        try:
            new = self._senders.look()
        except (rosgraph.MasterException, OSError) as error:
            rospy.logwarn_throttle(10.0, f"the master does not answer: {error}")
            new = []
        if self._watched:
            self._watched.note_car(self._car.changes())
            self._watched.note_others(self._senders.known.values())
        else:
            for sender in new:
                self._expectations.of(sender)
            self._end_without_drive()

    def _end_without_drive(self) -> None:
        """End the wait for one drive if its node has ended, and has not moved the car."""
        names = list(self._senders.known)
        if self._fixed and self._seen and not names:
            raise UserError(f"{', '.join(self._seen)} has ended, and has not moved the car")
        self._seen = names

    def _identify(self, watched: WatchedDrive) -> None:
        """Find the node of a drive, and its plan."""
        with suppress(rosgraph.MasterException, OSError):
            self._senders.look()
        self._take_events(0.0)
        watched.sender = self._senders.driver(self._driver)
        expected = None
        if self._is_judged:
            expected, watched.why_not = self._expectations.of(watched.sender)
        else:
            watched.why_not = "its first command came before this monitor was connected"
        self._is_judged = True
        watched.identified(expected)
        if watched.planned:
            self._pub_verdict.publish(String(""))
            self._pub_start.publish(Time(ros_time.time_from(watched.planned.begin)))

    # Ends

    def _overtake(self) -> None:
        """Conclude the drive, because the next one begins."""
        assert self._watched
        if verdict := self._watched.overtaken():
            self._conclude(verdict)
        else:
            rospy.loginfo("the next drive began before the car stood; the last one is not judged")
            self._watched = None

    def _conclude(self, verdict: Verdict) -> None:
        """Log the result of the drive, except an error that ends this node."""
        assert self._watched
        is_planned = self._watched.planned is not None
        for line in verdict.lines if verdict.is_good or not self._fixed else ():
            (rospy.loginfo if verdict.is_good or not is_planned else rospy.logerr)("%s", line)
        self._watched, self._verdict = None, verdict
        if is_planned:
            self._pub_verdict.publish(String("\n".join(verdict.lines)))
        self._pub_start.publish(Time(ros_time.time_from(0)))

    @staticmethod
    def _result(verdict: Verdict) -> int:
        """Return the exit status; raise UserError with the reason of a failure."""
        for each in RESULT_FILES:
            write_result(each, verdict)
        if not verdict.is_good:
            raise UserError("\n".join(verdict.lines))
        return 0


RESULT_FILES = [each.partition("xml:")[2] for each in sys.argv if each.startswith("--gtest_output")]
"""The JUnit file, if rostest runs this node as a test."""

if __name__ == "__main__":
    sys.argv = [each for each in sys.argv if not each.startswith("--gtest_output")]
    node.main("drive_monitor", DriveMonitor)
