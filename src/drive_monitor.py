#!/usr/bin/python3
"""Watch the drives of any node, and report how each of them ended."""

import sys
import time
from collections import deque
from contextlib import suppress
from typing import Any, Callable, Deque, List, Optional, Tuple

import rosgraph
import rospy
from ackermann_msgs.msg import AckermannDriveStamped
from geometry_msgs.msg import PoseArray, PoseStamped
from std_msgs.msg import String, Time

from mushr_ros_intro.car.model import Command
from mushr_ros_intro.car.profile import names_in
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.monitor.car_watch import CarWatch
from mushr_ros_intro.monitor.drive import Report
from mushr_ros_intro.monitor.expectation import Expectations
from mushr_ros_intro.monitor.senders import Sender, Senders
from mushr_ros_intro.monitor.verdict import Verdict
from mushr_ros_intro.monitor.watched_drive import WatchedDrive
from mushr_ros_intro.parameters import Values, choice, loaded
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.plan.parse import read_named_plan
from mushr_ros_intro.ros import conversions, node, ros_time
from mushr_ros_intro.ros.connections import wait_until_connected
from mushr_ros_intro.ros.junit import write_junit

TICK = 0.1
"""Period at which a drive is looked at [s of wall-clock time]."""

CHECK_PERIOD = 0.4
"""Period of the calls to the master and to nodes [s of wall-clock time]."""

ANNOUNCEMENT_TIMEOUT = 0.5
"""Longest wait for the name of the node of a drive [s of wall-clock time]."""

NOBODY = ("", "idle", "default")
"""The active input, in lower case, if no input drives; MuSHR's input default gets only stops."""

PLAN = (
    "watch one drive of this plan, whose result is the exit status; by default, the plans of nodes"
)
CAR = "car of the prediction, a name in config/cars; by default the simulated car"


def take_result_files() -> List[str]:
    """Remove rostest's arguments from the command line; return the JUnit files that it expects."""
    given = [each for each in sys.argv if each.startswith("--gtest_output")]
    sys.argv = [each for each in sys.argv if each not in (*given, "--text", "--cov")]
    return [each.partition("xml:")[2] for each in given]


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
        loaded("plan_file", read_named_plan, PLAN)._replace(default=None),
        choice("car", names_in(package_folder("config/cars")), None, CAR),
    )

    def __init__(self, values: Values, result_files: List[str]) -> None:
        name = values["car_name"]
        self._fixed = values["plan_file"]
        self._expectations = Expectations(name, values["car"], values["plan_file"])
        self._car_name = name
        self._events: Deque[Tuple[Callable[[Any, int], None], Any, int]] = deque()
        self._car = CarWatch(f"/{name}/car_pose")
        mux = f"/{name}/mux/ackermann_cmd_mux"
        self._senders = Senders(f"{mux}/input/")
        self._active: Optional[str] = None
        self._driver: Optional[str] = None
        """The node whose commands the mux forwards; None if the mux does not publish it."""
        self._announced: List[str] = []
        """The names that the mux has published since the last command or identification."""
        self._is_judged = True
        """Whether the drive has been seen from its first command."""
        self._watched: Optional[WatchedDrive] = None
        self._seen: List[str] = []
        self._result_files = result_files
        self._last: Optional[Verdict] = None
        self._start_pub = rospy.Publisher("~start", Time, queue_size=1, latch=True)
        self._verdict_pub = rospy.Publisher("~verdict", String, queue_size=1, latch=True)
        self._mux = [
            self._subscribe(f"{mux}/active", String, self._on_active),
            self._subscribe(f"{mux}/output", AckermannDriveStamped, self._on_command),
        ]
        self._subscribe(f"{mux}/driver", String, self._on_driver)
        self._subscribe(self._car.topic, PoseStamped, self._on_pose)
        self._subscribe(f"/{name}/car_sim/collision", PoseArray, self._on_collision)
        rospy.loginfo("%s", values.text)

    def _subscribe(
        self, topic: str, kind: type, callback: Callable[[Any, int], None]
    ) -> rospy.Subscriber:
        """Subscribe to a topic.

        The thread of `run` calls `callback` with each message and the time of its arrival [ns].
        """

        def receive(msg: Any) -> None:
            self._events.append((callback, msg, ros_time.now()))

        return rospy.Subscriber(topic, kind, receive, tcp_nodelay=True)

    def run(self) -> int:
        """Watch until the node is shut down, or with ``~plan_file`` until the end of one drive.

        Returns the exit status.

        Raises:
            UserError: the plan has not been driven.
        """
        connected = [wait_until_connected(each, "publishers", minimum=1) for each in self._mux]
        deadline = time.monotonic() + 1.0
        while self._active is None and time.monotonic() < deadline:  # it is latched
            self._take_events()
        if all(connected):
            rospy.loginfo("watching the drives of /%s", self._car_name)
        next_check = 0.0
        while not rospy.is_shutdown():
            # Calls to the master can take seconds. Then take what has arrived before a judgement.
            self._take_events()
            if self._has_to_identify():
                self._identify()
                continue
            if self._watched and (verdict := self._watched.ended()):
                self._conclude(verdict)
            if self._fixed and self._last:
                return self._write(self._last)
            if time.monotonic() >= next_check:
                next_check = time.monotonic() + CHECK_PERIOD
                self._check()
        return 1 if self._fixed else 0

    # Events, in the thread of `run`

    def _take_events(self) -> None:
        """Wait for a tick, which needs less time than to wake up for each message; take them."""
        time.sleep(TICK)
        for _ in range(len(self._events)):
            if self._has_to_identify():
                return  # before what other nodes do
            callback, msg, arrival = self._events.popleft()
            callback(msg, arrival)

    def _on_active(self, msg: String, _: int) -> None:
        name = msg.data.strip()
        is_idle = name.lower() in NOBODY
        if self._active is None or is_idle and not self._watched:  # first the latched message
            self._is_judged = is_idle
        self._active = name
        sender = self._watched.sender if self._watched else None
        is_other = sender and not self._senders.is_input_of(sender, name)
        if self._watched and is_other and name.lower() not in NOBODY:
            self._watched.note_other(f"the input {name} of the mux")

    def _on_driver(self, msg: String, _: int) -> None:
        self._driver = msg.data
        self._announced.append(msg.data)

    @conversions.ignore_bad_messages
    def _on_command(self, msg: AckermannDriveStamped, arrival: int) -> None:
        command = conversions.command_from_msg(msg)
        command = command._replace(stamp=ros_time.received_stamp(command.stamp, arrival))
        if self._watched and (self._watched.is_next(command) or self._is_of_new_node(command)):
            self._overtake()
        if self._watched:
            self._watched.add(command)
        elif command.speed or command.steering_angle:
            self._watched = WatchedDrive(command, self._car)
            self._announced = self._announced[-1:]
        if self._watched and self._watched.is_identified:
            for name in self._announced:
                self._watched.note_other(name)
            self._announced = []

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
    def _on_pose(self, msg: PoseStamped, arrival: int) -> None:
        report = self._car.report(msg, arrival)
        if self._watched and self._watched.begins_again(report):
            self._overtake()

    def _on_collision(self, msg: PoseArray, _: int) -> None:
        if self._watched and msg.poses:
            pose = conversions.pose_from_msg(msg.poses[0])
            self._watched.note_wall(Report(msg.header.stamp.to_nsec(), pose))

    # Nodes and plans

    def _check(self) -> None:
        """Look for nodes with a plan; during a drive, for other nodes, and whether the car is lost.

        A mux that publishes the node whose commands it forwards shows other nodes itself.
        """
        new: List[Sender] = []
        try:
            if not self._watched or self._driver is None:
                new = self._senders.look()
        except (rosgraph.MasterException, OSError) as error:
            rospy.logwarn_throttle(10.0, f"the master does not answer: {error}")
        if self._watched:
            if change := self._car.change():
                self._watched.note_car(change)
            if self._driver is None:
                self._watched.note_others(self._senders.known.values())
        else:
            for sender in new:
                self._expectations.of(sender)
            self._end_without_drive()

    def _end_without_drive(self) -> None:
        """End the wait for one drive if its node has ended, and has not moved the car."""
        names = list(self._senders.known)
        if self._fixed and self._seen and not names:
            self._take_events()  # its commands may have arrived since the last time
            if not self._watched:
                text = f"{', '.join(self._seen)} has ended, and has not moved the car"
                self._end(Verdict(False, [text]), is_planned=False)
        self._seen = names

    def _has_to_identify(self) -> bool:
        """Return whether to look for the node of the drive: the mux has announced it, or is late.

        ROS does not order two topics.
        """
        watched = self._watched
        if not watched or watched.is_identified:
            return False
        return bool(self._announced) or time.monotonic() > watched.began + ANNOUNCEMENT_TIMEOUT

    def _identify(self) -> None:
        """Find the node of a drive, and its plan."""
        watched = self._watched
        assert watched
        with suppress(rosgraph.MasterException, OSError):
            self._senders.look()
        watched.sender = self._senders.driver(next(iter(self._announced), self._driver))
        self._announced = self._announced[1:]
        expected = None
        if self._is_judged:
            expected, watched.why_not = self._expectations.of(watched.sender)
        else:
            watched.why_not = "its first command came before this monitor was connected"
        self._is_judged = True
        watched.identified(expected)
        if watched.planned:
            self._verdict_pub.publish(String(""))
            self._start_pub.publish(Time(ros_time.time_from(watched.planned.begin)))

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
        assert self._watched
        self._end(verdict, self._watched.planned is not None)
        self._watched = None

    def _end(self, verdict: Verdict, is_planned: bool) -> None:
        """Publish and log the end of a drive, except an error that ends this node."""
        for line in verdict.lines if verdict.is_good or not self._fixed else ():
            (rospy.loginfo if verdict.is_good or not is_planned else rospy.logerr)("%s", line)
        self._last = verdict
        if is_planned:
            self._verdict_pub.publish(String("\n".join(verdict.lines)))
        self._start_pub.publish(Time(ros_time.time_from(0)))

    def _write(self, verdict: Verdict) -> int:
        """Write the result of the only drive for rostest; see `run`."""
        text = "\n".join(verdict.lines)
        for each in self._result_files:
            write_junit(each, "drive_monitor", {"drive": None if verdict.is_good else text})
        if not verdict.is_good:
            raise UserError(text)
        return 0


if __name__ == "__main__":
    node.main("drive_monitor", DriveMonitor, take_result_files())
