#!/usr/bin/python3
"""Open rviz with the package's view of a car: view.py CAR_NAME.

rviz/default.rviz is the view of the car that is called car. For any other, its names are put in
place: topics and frames stand in a view as plain text, and rviz remaps topics but no frames.
"""

import os
import sys

import rospkg


def view_of(car_name: str, text: str) -> str:
    """Return the view of the car `car_name`, given the text of that of the car ``car``."""
    for topic in ("/initialpose", "/path_publisher/"):
        text = text.replace(f" {topic}", f" /{car_name}{topic}")
    for start in (" /", " "):
        text = text.replace(f"{start}car/", f"{start}{car_name}/")
    return text


def main() -> int:
    """Become rviz; return the exit status where that fails."""
    if len(sys.argv) < 2 or ":=" in sys.argv[1]:
        print("usage: view.py CAR_NAME [what rviz takes]", file=sys.stderr)
        return 2
    car_name = sys.argv[1].strip("/")
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        print(
            "view.py: DISPLAY is not set; expected a display that rviz can open a window on. "
            "The car drives without one",
            file=sys.stderr,
        )
        return 1
    path = os.path.join(rospkg.RosPack().get_path("mushr_ros_intro"), "rviz", "default.rviz")
    if car_name != "car":
        with open(path, encoding="utf-8") as file:
            text = view_of(car_name, file.read())
        # A file without a name, which ends with rviz and leaves nothing behind.
        descriptor = os.memfd_create(f"{car_name}.rviz", 0)
        os.write(descriptor, text.encode())
        path = f"/proc/self/fd/{descriptor}"
    try:
        os.execvp("rviz", ["rviz", "-d", path, *sys.argv[2:]])
    except OSError as error:
        print(
            f"view.py: rviz cannot be started ({error.strerror}); expected it on the PATH. "
            "It is in the package rviz (Debian) or ros-noetic-rviz",
            file=sys.stderr,
        )
    return 1


if __name__ == "__main__":
    sys.exit(main())
