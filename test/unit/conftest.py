"""A clock for the tests of this folder."""

import pytest
import rospy
from rospy.rostime import _set_rostime, switch_to_wallclock


@pytest.fixture
def set_clock(monkeypatch):
    """Simulate time, from 5 s on, in a node that is not shut down; return a function that sets it.

    The function takes a stamp [ns].
    """

    def set_to(stamp):
        _set_rostime(rospy.Time(0, stamp))

    monkeypatch.setattr("rospy.rostime._rostime_initialized", True)
    monkeypatch.setattr("rospy.is_shutdown", lambda: False)
    set_to(5_000_000_000)
    yield set_to
    switch_to_wallclock()
