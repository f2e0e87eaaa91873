"""Test when another input has taken over the car of a sender."""

import pytest

from mushr_ros_intro.drive.command_publisher import TakeoverMonitor


def after(names, monitor=None, is_sending=True):
    """Return the monitor after the mux has published names, separated by spaces."""
    monitor = monitor or TakeoverMonitor("navigation")
    for name in names.split(" "):
        monitor = monitor.on_active(name, is_sending)
    return monitor


@pytest.mark.parametrize(
    "names, taken_over_by",
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
def test_when_the_car_is_lost(names, taken_over_by):
    assert after(names).taken_over_by == taken_over_by


def test_the_end_of_another_plan_on_the_same_input_is_no_loss():
    monitor = after("navigation idle", is_sending=False)
    assert not monitor.taken_over_by
    assert after("navigation idle", monitor).taken_over_by == "idle"


def test_a_monitor_keeps_the_car_while_it_sends_nothing():
    monitor = after("navigation", after("navigation"), is_sending=False)
    assert monitor.on_active(" \n", is_sending=False).taken_over_by == "idle"


def test_between_two_plans_the_car_may_be_idle_but_not_taken_over():
    resting = after("navigation").plan_ended()
    assert not after("idle", resting).taken_over_by
    assert after("idle navigation idle", resting).taken_over_by == "idle"
    assert after("teleop", resting).taken_over_by == "teleop"
