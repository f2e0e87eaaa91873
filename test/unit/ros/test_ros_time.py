"""Test the sleep until an instant, with a clock that the test sets."""

import threading
import time

import pytest
import rospy
from rospy.rostime import switch_to_wallclock

from mushr_ros_intro.drive.timetable import Timetable
from mushr_ros_intro.plan.plan import Plan, Row
from mushr_ros_intro.ros import ros_time
from mushr_ros_intro.ros.ros_time import sleep_until
from mushr_ros_intro.stamps import COMMAND_PERIOD
from support.helpers import PATIENCE, wait_for

SECOND = 1_000_000_000


pytestmark = pytest.mark.usefixtures("set_clock")


class Sleeper:
    """A thread that sleeps until an instant."""

    def __init__(self, due, now=5 * SECOND, sleep=sleep_until):
        self._is_interrupted = False
        self._thread = threading.Thread(target=self._run, args=[sleep, due, now], daemon=True)
        self._thread.start()

    def _run(self, sleep, due, now):
        try:
            sleep(due, now)
        except rospy.ROSInterruptException:
            self._is_interrupted = True

    def sleeps(self, still=0.1):
        self._thread.join(still)
        return self._thread.is_alive()

    def is_interrupted(self):
        assert not self.sleeps(PATIENCE), "it sleeps on"
        return self._is_interrupted


@pytest.mark.parametrize("due", [4 * SECOND, 5 * SECOND - 1, 5 * SECOND])
def test_no_sleep_if_the_instant_is_past(due):
    """The clock, which waits for this node, has moved since the node looked."""
    assert not Sleeper(due, now=due - SECOND // 10).is_interrupted()
    assert not Sleeper(due + 2 * SECOND, now=6 * SECOND).is_interrupted()  # later than the clock


def test_a_timetable_does_not_oversleep_if_the_clock_moves_after_its_look(monkeypatch, set_clock):
    """In lock-step that clock waits for the command."""
    plan = Plan("plan.txt", (0.0, 0.0, 0.0), (Row(1.0, 0.0, COMMAND_PERIOD, 2),))
    timetable = Timetable(plan)
    timetable.start_after(5 * SECOND)
    timetable.due = 6 * SECOND + COMMAND_PERIOD
    look = ros_time.now

    def look_and_move():
        present = look()
        set_clock(6 * SECOND)
        return present

    monkeypatch.setattr(ros_time, "now", look_and_move)
    waits = Sleeper(0, sleep=lambda *_: timetable.wait_until(timetable.due))
    assert not waits.is_interrupted()


def test_sleep_ends_when_the_clock_is_there(set_clock):
    sleeper = Sleeper(6 * SECOND)
    for stamp in (5 * SECOND, 6 * SECOND - 1):
        set_clock(stamp)
        assert sleeper.sleeps()
    set_clock(6 * SECOND)
    assert not sleeper.is_interrupted()


def test_no_move_of_the_clock_is_missed(monkeypatch, set_clock):
    """The sleeper looks at the clock, and the clock moves before it sleeps."""
    look = rospy.get_rostime
    mover = threading.Thread(target=set_clock, args=[6 * SECOND])

    def look_and_move():
        now = look()
        if not mover.ident:
            mover.start()
            wait_for(lambda: look().to_nsec() == 6 * SECOND, "the clock")
        return now

    monkeypatch.setattr("rospy.get_rostime", look_and_move)
    assert not Sleeper(6 * SECOND).is_interrupted()
    mover.join()


def test_sleep_ends_if_the_clock_is_set_back(set_clock):
    sleeper = Sleeper(6 * SECOND)
    assert sleeper.sleeps()
    set_clock(5 * SECOND - 1)
    assert not sleeper.is_interrupted()


def test_sleep_ends_if_the_node_is_shut_down(monkeypatch):
    sleeper = Sleeper(6 * SECOND)
    assert sleeper.sleeps()
    monkeypatch.setattr("rospy.is_shutdown", lambda: True)
    assert sleeper.is_interrupted()


def test_sleep_by_the_wall_clock():
    switch_to_wallclock()
    begin = time.time_ns()
    late, early = Sleeper(begin - SECOND, begin), Sleeper(begin + SECOND // 5, begin)
    assert not late.is_interrupted() and not early.is_interrupted()
    assert time.time_ns() - begin >= SECOND // 5


def test_a_long_sleep_by_the_wall_clock_ends_if_the_node_is_shut_down(monkeypatch):
    """Such as the sleep of a mux with the timeout 60 s."""
    switch_to_wallclock()
    begin = time.time_ns()
    sleeper = Sleeper(begin + 10 * round(PATIENCE) * SECOND, begin)
    assert sleeper.sleeps()
    monkeypatch.setattr("rospy.is_shutdown", lambda: True)
    assert sleeper.is_interrupted()
