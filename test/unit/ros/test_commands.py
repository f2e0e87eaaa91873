"""Test the commands that messages tell the user to type."""

import os

import pytest

from mushr_ros_intro.ros.commands import as_typed, drive_command


@pytest.mark.parametrize(
    "text, expected",
    [
        ("roslaunch mushr_ros_intro sim.launch", "roslaunch mushr_sim teleop.launch"),
        ("roslaunch mushr_ros_intro web.launch", "roslaunch mushr_sim teleop.launch web:=true"),
        ("a, rosrun mushr_ros_intro doctor.py b", "a, rosrun mushr_sim doctor.py b"),
        (drive_command("car"), "rosrun mushr_sim path_publisher.py _plan_file:=figure_8"),
        (
            drive_command("car2"),
            "rosrun mushr_sim path_publisher.py __ns:=car2 _car_name:=car2 _plan_file:=figure_8",
        ),
    ],
)
def test_commands_in_the_workspace_of_a_student(text, expected, tmp_path, monkeypatch):
    """There, mushr_ros_intro is the package of the student, and mushr_sim has the nodes."""
    assert as_typed(text) == text
    (tmp_path / "package.xml").write_text("<package><name>mushr_ros_intro</name></package>")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"{tmp_path}:{os.environ['ROS_PACKAGE_PATH']}")
    assert as_typed(text) == expected
    (tmp_path / "launch").mkdir()
    (tmp_path / "launch" / "sim.launch").touch()
    assert as_typed(text) == text, "another copy of this package"
