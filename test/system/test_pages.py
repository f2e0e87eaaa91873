"""Type the commands of the pages as they are printed, in order, and compare what they print."""

import contextlib
import glob
import os
import re
import shutil
import signal
import subprocess
import textwrap

import pytest

from support.controllers import CONTROLLERS
from support.helpers import PATIENCE, free_port, wait_for
from support.listing_page import states
from support.paths import CHECKOUT, copy_package
from support.scripts import add_programs, needs_workspace

pytestmark = [pytest.mark.full, needs_workspace]

NOT_TYPED = {
    "scripts/shell": "each terminal begins with it",
    "scripts/(test|dev/)": "this is a test of it",
    "python3 -m pytest": "the same",
    "docker": "no container engine",
    "(unset ROS_HOSTNAME|export ROS_(MASTER_URI|IP)=)": "a second machine; test_network.py has one",
    "git clone https://github.com/ORGANISATION": "the course of a reader",
    "rosrun mushr_sim grade.py submissions/ .* --file control_node": "the packages of CSE 478",
    "rosrun rviz": "nodes/test_rviz.py opens the view",
    "roslaunch mushr_ros_intro view.launch": "the same",
    "roslaunch mushr_ros_intro real_car.launch": "it drives the actual car",
    "rostopic pub -r 6 /car/mux": "for the command before; it has no output, so it is never ready",
    "rosbag record": "the actual car has a localisation",
    "rosrun mushr_ros_intro compare_drive": "the same; unit/comparison has such drives",
    "rostest .*my_package": "docs/checks.md has it with a package that exists",
    # Text that no command prints.
    "0, 0, 0.785 ": "a plan",
    "<launch>": "a launch file",
    "default: ": "points.yaml",
    "- run:": "for GitHub",
    "parameter  ": "the drive of an actual car",
    "saved /home/student/": "the result of a drive by hand",
}
"""The begin of a command or block, and the reason."""

ENDLESS = {
    "roslaunch mushr_sim teleop.launch": "ready: the car",
    r"roslaunch mushr_ros_intro sim\.launch(?! --)": "ready: the car",
    r"rosrun mushr_\w+ map_server.py": "cells of",
    "rosrun mushr_ros_intro drive_monitor.py": "watching the drives",
    "rosrun mushr_ros_intro click_planner.py": "steering from",
    "rosrun mushr_ros_intro plan_recorder.py": "recording begins",
    "rostopic echo /": "",
    "rosrun .* _loop:=true": "",
}
"""A command that only Ctrl-C ends, and what its terminal shows when it is ready."""

CLICK = "rostopic pub -1 /clicked_point geometry_msgs/PointStamped"
BEFORE = {
    "rosservice call /click_planner/undo": [
        f"{CLICK} '{{header: {{frame_id: map}}, point: {{x: {x}}}}}'" for x in (1.0, 2.0)
    ],
    "[INFO] the plan of": [
        "roslaunch mushr_ros_intro sim.launch",
        "rosrun mushr_ros_intro path_publisher.py _plan_file:=figure_8",
    ],
    "cd ~/ros_ws": ["mkdir -p ~/ros_ws/src"],
}
"""What is typed before a command or a text, which the page describes in words."""

LISTING, *_, EXACT = states().values()
TWO_COLUMNS = LISTING.replace('line.split(","))\n    drive', 'line.split(",")[:2])\n    drive')
NAMED = EXACT.replace("import math\n", "import math\nimport os\n").replace(
    "    plan = read_plan(",
    """    def read_named_plan(name):
        package = os.path.dirname(os.path.dirname(os.path.realpath(__file__)))
        path = f"{package}/plans/{name}.txt"
        return read_plan(path if os.path.exists(path) else name)

    plan = read_named_plan(""",
)
LOOPED = NAMED.replace(
    "    stop.header.stamp = run_plan(",
    """    while rospy.get_param("~loop", False):
        run_plan(pub_init_pose, pub_controls, plan)
    stop.header.stamp = run_plan(""",
)
WRITTEN = {
    "": [(None, 0, "")],
    # The plan is faster than the car.
    "rosrun mushr_sim check_plan.py figure_8 --car mushr_nano": [(None, 1, "1 fault")],
    "rosrun mushr_sim doctor.py": [(None, 1, "no node publishes commands")],
    "rosrun mushr_ros_intro doctor.py": [(None, 1, "no node publishes commands")],
    "scripts/grade": [(None, 1, "submissions? passed")],
    "scripts/grade --autograder": [(None, 0, "")],
    "chmod a+x src/path_publisher.py": [(LISTING, 0, "")],
    "rosrun mushr_sim grade.py plans/durations.txt": [
        (LISTING, 1, "ValueError: too many values to unpack"),
        (TWO_COLUMNS, 1, ""),
        (EXACT, 0, "\nall checks passed\n"),
    ],
    "rosrun mushr_ros_intro path_publisher.py _plan_file:=my_plan": [(NAMED, 0, "")],
    "rosrun mushr_ros_intro path_publisher.py _plan_file:=my_plan _loop:=true": [
        (LOOPED, 0, r"0\.5\s+---\s+0\.5"),
    ],
}
"""The student's nodes with which a command is typed, its exit status, and what then is printed."""

SUBMISSIONS = {
    "ann": EXACT,
    "bob": EXACT.replace("speed=v)", "speed=-v)"),
    "carl": EXACT.replace("\n", "\r\n"),
}
"""The class of docs/teach.md."""


class Terminal:
    """A terminal in which a shell was opened."""

    def __init__(self, home, number, shell, master):
        self._path = home / f"terminal {number}"
        self._log = open(self._path, "wb")  # noqa: SIM115
        self._command, self._count, self._begin = "", 0, 0
        self._shell = subprocess.Popen(
            shell,
            cwd=home,
            env={"HOME": str(home), "PATH": f"{home}/bin:/usr/bin:/bin", "PYTHONUNBUFFERED": "1"},
            stdin=subprocess.PIPE,
            stdout=self._log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        packages = f"ROS_PACKAGE_PATH=$ROS_PACKAGE_PATH:{home}/packages"
        self.type(f"export ROS_MASTER_URI=http://localhost:{master} {packages}")
        self.wait()

    @property
    def shown(self):
        """What it shows since the last command was typed, once or several times."""
        return self._path.read_text(errors="replace")[self._begin :]

    def type(self, command):
        """Type a command, after Ctrl-C if the last one still runs."""
        if self._count and not self._status():
            wait_for(lambda: self._children() or self._status(), "the shell to start the command")
            for pid in self._children():
                os.kill(int(pid), signal.SIGINT)
            self.wait()
        if command != self._command:
            self._begin += len(self.shown)
        self._command = command
        self._count += 1
        self._shell.stdin.write(f"{command}\necho status $? of $(({self._count}))\n".encode())
        self._shell.stdin.flush()

    def wait(self):
        """Wait for the end of the command; return its exit status."""
        wait_for(self._status, f"the end of {self._command}:\n{self.shown}", 10 * PATIENCE)
        return int(self._status()[1])

    def _children(self):
        with open(f"/proc/{self._shell.pid}/task/{self._shell.pid}/children") as file:
            return file.read().split()

    def _status(self):
        return re.search(rf"status (\d+) of {self._count}\n", self.shown)

    def close(self):
        self.type("exit")
        self._shell.stdin.close()
        self._shell.wait(PATIENCE)
        self._log.close()


def read(page):
    with open(f"{CHECKOUT}/{page}", encoding="utf-8") as file:
        return file.read()


def ready_sign(command):
    """Return what a command that does not end shows when it is ready; None for one that ends."""
    return next((sign for begin, sign in ENDLESS.items() if re.match(begin, command)), None)


def terminal_of(command):
    """Return the terminal of a command without a number: 1 for the car, 2 for endless tools."""
    if ready_sign(command) == "ready: the car" and "car_name" not in command:
        return "1"
    return "3" if ready_sign(command) is None else "2"


FILES = glob.glob(f"{CHECKOUT}/*.md") + glob.glob(f"{CHECKOUT}/docs/*.md")
PAGES = {os.path.relpath(path, CHECKOUT) for path in FILES} - {"docs/exact.md"}
"""Not docs/exact.md: test_listing.py types its program after each change, and grades it."""


def steps(page):
    """Yield (file, text) to write, (terminal, command) to type, and ("", line) to be printed."""
    blocks = re.findall(r"(?:^ {4}.*\n)+|(?:^\S.*\n)+", read(page), re.M)
    name, text = None, ""
    for block in blocks:
        if block[0] != " ":
            name = re.search(r"[Ww]rite\s(?:these lines to )?`(\S+/\S+)`|$", block)[1]
            text = ""
            continue
        block = textwrap.dedent(block)
        if name and "$ " not in block[:3]:
            text += block
            yield name, text
        elif not re.match("|".join(NOT_TYPED), block):
            for line in re.sub(r"\\\n *", "", block).splitlines():
                number, is_command, line = re.match(r"(?:(\d?)(\$ ))?(.*)", line).groups()
                for typed in next((BEFORE[each] for each in BEFORE if line.startswith(each)), ()):
                    yield terminal_of(typed), typed
                yield (number or terminal_of(line)) if is_command else "", line


@pytest.mark.parametrize("page", sorted(page for page in PAGES if "$ " in read(page)))
def test_page(tmp_path, page):
    add_programs(tmp_path / "bin", ("python",), 'exec /usr/bin/python3 "$@"')
    for name in ("packages/my_ros_intro", *(f"submissions/{each}" for each in SUBMISSIONS)):
        copy_package(f"{CHECKOUT}/examples/my_ros_intro", tmp_path / name)
    for name, program in SUBMISSIONS.items():
        (tmp_path / "submissions" / name / "src" / "path_publisher.py").write_text(program)
        shutil.copy(f"{CONTROLLERS}/pursuit.py", tmp_path / f"submissions/{name}/src/controller.py")
    (tmp_path / "hidden").mkdir()
    shutil.copy(f"{CHECKOUT}/plans/test_drive.txt", tmp_path / "hidden" / "s_curve.txt")
    (points,) = re.findall(r"^ {4}default: .*\n(?: {4}.*\n)+", read("docs/teach.md"), re.M)
    (tmp_path / "points.yaml").write_text(textwrap.dedent(points))
    (tmp_path / "my_plan.txt").write_text("0, 0, 0\n0.5, 0.1\n")
    own = tmp_path / "catkin_ws" / "src" / "mushr_ros_intro"
    shell = [f"{CHECKOUT}/scripts/shell", *(["--tutorial"] if "tutorial" in page else [])]
    if "install" in page:
        shell = ["bash"]
    master = free_port()
    terminals = {}

    def wait_to_show(pattern, where="123"):
        def shown():
            return [terminals[each].shown for each in where]

        try:
            wait_for(lambda: any(re.search(pattern, each) for each in shown()), repr(pattern))
        except AssertionError as error:
            logs = [each[-3000:] for each in shown()]
            raise AssertionError("\n".join([repr(pattern), *logs])) from error

    with contextlib.ExitStack() as stack:
        for number in "123":
            terminals[number] = Terminal(tmp_path, number, shell, master)
            stack.callback(terminals[number].close)
        for place, text in steps(page):
            if "/" in place:
                (own / place).write_text(text)
            elif not place:
                line = re.escape(text.strip()).replace(r"\.\.\.", ".*")
                wait_to_show(line.replace(r"INFO\]", "INFO].*"))
            elif not re.match("|".join(NOT_TYPED), text):
                begin = max((each for each in WRITTEN if text.startswith(each)), key=len)
                for program, status, printed in WRITTEN[begin]:
                    if program:
                        (own / "src" / "path_publisher.py").write_text(program)
                    terminals[place].type(re.sub("^(?=scripts/)|CHECKOUT/?", f"{CHECKOUT}/", text))
                    if ready_sign(text) is None:
                        assert terminals[place].wait() == status, terminals[place].shown
                    wait_to_show(ready_sign(text) or "", place)
                    wait_to_show(printed)
