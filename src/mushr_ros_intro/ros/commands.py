"""The commands of this package that messages tell the user to type."""

import os
from contextlib import suppress

import rospkg

_PUBLISHER = "roslaunch mushr_ros_intro path_publisher.launch"

STAND_INS = (
    ("roslaunch mushr_ros_intro sim.launch", "roslaunch mushr_sim teleop.launch"),
    (f"{_PUBLISHER} plan_file:=", "rosrun mushr_sim path_publisher.py _plan_file:="),
    (
        f"{_PUBLISHER} car_name:=",
        "rosrun mushr_sim path_publisher.py _plan_file:=figure_8 _car_name:=",
    ),
    (_PUBLISHER, "rosrun mushr_sim path_publisher.py _plan_file:=figure_8"),
    ("rosrun mushr_ros_intro ", "rosrun mushr_sim "),
)
"""Commands, and how to type them if a student's package has the name of this one."""


def as_typed(text: str) -> str:
    """Return a text with the commands that work in this workspace."""
    with suppress(rospkg.ResourceNotFound):
        found = rospkg.RosPack().get_path("mushr_ros_intro")
        if not os.path.exists(os.path.join(found, "launch", "sim.launch")):
            for command, stand_in in STAND_INS:
                text = text.replace(command, stand_in)
    return text
