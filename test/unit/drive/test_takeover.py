"""Test when a sender has lost the car."""

import pytest

from mushr_ros_intro.drive.takeover import TakeoverMonitor


def hear(names, monitor=None, is_sending=True):
    """Return the monitor after the mux has published names, separated by spaces."""
    monitor = monitor or TakeoverMonitor("navigation")
    for name in names.split(" "):
        monitor = monitor.hear(name, is_sending)
    return monitor


@pytest.mark.parametrize(
    "names, lost_to",
    [
        ("idle navigation", ""),
        ("Default Navigation", ""),  # MuSHR's, whose default gets six stops per second
        ("idle Default idle", ""),
        ("idle teleop", "teleop"),
        ("Teleoperation", "Teleoperation"),
        ("navigation teleop idle navigation", "teleop"),  # lost for good
        ("Navigation Safety", "Safety"),
        ("navigation idle", "idle"),
        ("Navigation Default", "Default"),
        ("navigation ", "idle"),
    ],
)
def test_when_the_car_is_lost(names, lost_to):
    assert hear(names).lost_to == lost_to


def test_the_end_of_another_plan_on_the_same_input_is_no_loss():
    monitor = hear("navigation idle", is_sending=False)
    assert not monitor.lost_to
    assert hear("navigation idle", monitor).lost_to == "idle"


def test_a_monitor_keeps_the_car_while_it_sends_nothing():
    monitor = hear("navigation", hear("navigation"), is_sending=False)
    assert monitor.hear(" \n", is_sending=False).lost_to == "idle"


def test_between_two_plans_the_car_may_be_idle_but_not_taken_over():
    resting = hear("navigation").rest()
    assert not hear("idle", resting).lost_to
    assert hear("idle navigation idle", resting).lost_to == "idle"
    assert hear("teleop", resting).lost_to == "teleop"
