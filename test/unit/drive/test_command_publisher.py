"""Test when another input has taken over the car of a sender."""

import pytest

from mushr_ros_intro.drive.command_publisher import is_taken_over


@pytest.mark.parametrize(
    "active, has_driven, is_lost",
    [
        ("navigation", False, False),
        ("navigation", True, False),
        ("idle", False, False),
        ("default", False, False),  # MuSHR's, which gets six stops per second
        ("idle", True, True),
        ("default", True, True),
        ("teleop", False, True),
        ("safety", True, True),
    ],
)
def test_when_the_car_is_lost(active, has_driven, is_lost):
    assert is_taken_over(active, "navigation", has_driven) == is_lost
