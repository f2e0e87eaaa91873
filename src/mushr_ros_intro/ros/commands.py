"""The commands of this package that messages tell the user to type."""

import os
from contextlib import suppress

import rospkg

_PUBLISHER = "roslaunch mushr_ros_intro path_publisher.launch plan_file:="

STAND_INS = (
    ("roslaunch mushr_ros_intro sim.launch", "roslaunch mushr_sim teleop.launch"),
    ("roslaunch mushr_ros_intro web.launch", "roslaunch mushr_sim teleop.launch web:=true"),
    (_PUBLISHER, "rosrun mushr_sim path_publisher.py _plan_file:="),
    ("rosrun mushr_ros_intro ", "rosrun mushr_sim "),
)
"""Commands, and how to type them in a student's workspace, where this package is mushr_sim."""


def drive_command(car: str) -> str:
    """Return the command that drives a plan with a car; another car has its own node."""
    if car == "car":
        return f"{_PUBLISHER}figure_8"
    names = f"__ns:={car} _car_name:={car}"
    return f"rosrun mushr_ros_intro path_publisher.py {names} _plan_file:=figure_8"


def as_typed(text: str) -> str:
    """Return a text with the commands that work in this workspace."""
    if not _has_this_package("mushr_ros_intro") and _has_this_package("mushr_sim"):
        for command, stand_in in STAND_INS:
            text = text.replace(command, stand_in)
    return text


def _has_this_package(name: str) -> bool:
    """Return whether ROS finds a package with this name and the launch files of this package."""
    with suppress(rospkg.ResourceNotFound):
        folder = rospkg.RosPack().get_path(name)
        launch = ("launch", ".launch")  # a link in mushr_sim
        return any(os.path.exists(os.path.join(folder, each, "sim.launch")) for each in launch)
    return False
