"""The settings of hypothesis, and a clock, for all unit tests."""

import pytest
import rospy
from hypothesis import HealthCheck, settings
from rospy.rostime import _set_rostime, switch_to_wallclock


def pytest_configure():
    """Use the same examples in every run, write no file, and accept a slow machine."""
    settings.register_profile(
        "repeatable",
        max_examples=25,
        derandomize=True,
        database=None,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    settings.load_profile("repeatable")


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
