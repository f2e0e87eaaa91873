#!/usr/bin/python3
"""Open rviz with the package's view of a car.

rviz/default.rviz is the view of the car named "car". For another car its names are replaced in the
text, because rviz can remap topics but not frames.
"""

import os
import sys

from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.ros.commands import as_typed

USAGE = "usage: view.py CAR_NAME [options of rviz]"


def view_of(car_name: str, text: str) -> str:
    """Return the rviz configuration of a car, given that of the car named "car"."""
    for topic in ("/initialpose", "/clicked_point", "/click_planner/"):
        text = text.replace(f" {topic}", f" /{car_name}{topic}")
    for start in (" /", " "):
        text = text.replace(f"{start}car/", f"{start}{car_name}/")
    return text


def main() -> None:
    """Replace this program by rviz."""
    if {"-h", "--help"} & set(sys.argv[1:2]):
        print(USAGE, __doc__.partition("\n")[0], "Example: view.py car --fullscreen", sep="\n")
        return
    if len(sys.argv) < 2 or sys.argv[1].startswith("-") or ":=" in sys.argv[1]:
        sys.exit(USAGE)
    car_name = sys.argv[1].strip("/")
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        command = as_typed("roslaunch mushr_ros_intro web.launch")
        sys.exit(
            "view.py: DISPLAY is not set; expected a display for the window of rviz. "
            f"To see the car in a browser, type: {command}"
        )
    path = package_folder("rviz/default.rviz")
    if car_name != "car":
        with open(path, encoding="utf-8") as file:
            text = view_of(car_name, file.read())
        # A file in memory, which disappears when rviz ends.
        descriptor = os.memfd_create(f"{car_name}.rviz", 0)
        os.write(descriptor, text.encode())
        path = f"/proc/self/fd/{descriptor}"
    try:
        os.execvp("rviz", ["rviz", "-d", path, *sys.argv[2:]])
    except OSError as error:
        sys.exit(
            f"view.py: rviz cannot be started ({error.strerror}); expected it on the PATH. "
            "Install the package rviz (Debian) or ros-noetic-rviz (Ubuntu)"
        )


if __name__ == "__main__":
    main()
