"""Show how drives ended: in the log, on topics, and to rostest."""

import sys
from typing import List, Optional

import rospy
from std_msgs.msg import String, Time

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.monitor.verdict import Verdict
from mushr_ros_intro.ros import ros_time
from mushr_ros_intro.ros.junit import write_junit


def take_result_files() -> List[str]:
    """Remove rostest's arguments from the command line; return the JUnit files that it expects."""
    given = [each for each in sys.argv if each.startswith("--gtest_output")]
    sys.argv = [each for each in sys.argv if each not in (*given, "--text", "--cov")]
    return [each.partition("xml:")[2] for each in given]


class Results:
    """The results of drives, on ``~start`` and ``~verdict``.

    Args:
        files: the JUnit files for the result of one drive; None: several drives are watched.
    """

    def __init__(self, files: Optional[List[str]]) -> None:
        self._files = files
        self.last: Optional[Verdict] = None
        self._pub_start = rospy.Publisher("~start", Time, queue_size=1, latch=True)
        self._pub_verdict = rospy.Publisher("~verdict", String, queue_size=1, latch=True)

    def begin(self, stamp: int) -> None:
        """Publish that a plan is driven, whose first row began at `stamp` [ns]."""
        self._pub_verdict.publish(String(""))
        self._pub_start.publish(Time(ros_time.time_from(stamp)))

    def end(self, verdict: Verdict, is_planned: bool) -> None:
        """Publish and log the end of a drive, except an error that ends this node."""
        for line in verdict.lines if verdict.is_good or self._files is None else ():
            (rospy.loginfo if verdict.is_good or not is_planned else rospy.logerr)("%s", line)
        self.last = verdict
        if is_planned:
            self._pub_verdict.publish(String("\n".join(verdict.lines)))
        self._pub_start.publish(Time(ros_time.time_from(0)))

    def conclude(self, verdict: Verdict) -> int:
        """Return the exit status of this node; raise UserError with the reason of a failure."""
        text = "\n".join(verdict.lines)
        for each in self._files or ():
            write_junit(each, "drive_monitor", {"drive": None if verdict.is_good else text})
        if not verdict.is_good:
            raise UserError(text)
        return 0
