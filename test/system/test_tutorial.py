"""Type the tutorial and a course's exercise as they are printed, and check where the car ends.

The tutorial's text is not part of this package. If it is beside the checkout, the commands, the
code and the launch file are those of the text; otherwise those of the corrected listing.
"""

import glob
import math
import os
import re
import signal
import subprocess

import pytest
import rosgraph

from support.helpers import PATIENCE, Process, free_port, wait_for
from support.paths import CHECKOUT, FIXTURES, copy_package
from support.scripts import add_programs, needs_workspace

pytestmark = [pytest.mark.full, needs_workspace]

LENGTH = 46.0
"""[m] The distance of the plan straight_line."""

TOO_LONG = 1.2
"""[m/m] The tutorial's listing drives each row too long, by up to this factor."""

COMMANDS = """
cd ~/catkin_ws/src
catkin_create_pkg mushr_ros_intro std_msgs rospy ackermann_msgs
cd ~/catkin_ws
catkin_make
source devel/setup.bash
roscd mushr_ros_intro
mkdir plans
mkdir launch
chmod a+x src/path_publisher.py
roslaunch mushr_sim teleop.launch
rosrun rviz rviz -d $HOME/catkin_ws/src/mushr/mushr_utils/rviz/default.rviz
roslaunch mushr_ros_intro path_publisher.launch
"""


def read(path):
    with open(path, encoding="utf-8") as file:
        return file.read()


def tutorial():
    """Return the commands and the files of the tutorial."""
    found = glob.glob(f"{os.path.dirname(os.path.realpath(CHECKOUT))}/shared/seeds/*.txt")
    texts = [text for text in map(read, found) if text.startswith("Intro to ROS")]
    if not texts:
        example = f"{CHECKOUT}/examples/my_ros_intro"
        launch = read(f"{example}/launch/my_path_publisher.launch.xml")
        launch = launch.replace("my_ros_intro", "mushr_ros_intro")
        names = ("plans/straight_line.txt", "plans/figure_8.txt")
        plans = {name: read(f"{example}/{name}") for name in names}
        code = read(f"{example}/src/path_publisher.py")
        code = code.replace("/usr/bin/python3", "/usr/bin/env python", 1)
        return COMMANDS.split("\n"), code, launch, plans
    (text,) = texts
    code = re.search(r"^ (#!/usr/bin/env python\n.*?)^The code, explained", text, re.S | re.M)[1]
    launch = re.search(r"containing:\s*(<launch>.*?</launch>)", text, re.S)[1]
    plans = dict(re.findall(r"^(plans/\w+.txt)\s+(.*?\n)\n", text, re.S | re.M))
    return re.findall(r"^\$ (.*)", text, re.MULTILINE), code, launch, plans


class Terminal:
    """A shell in a new terminal of a student."""

    def __init__(self, home, port):
        self._environment = {
            "HOME": str(home),
            "PATH": f"{home}/bin:/usr/bin:/bin",
            "ROS_MASTER_URI": f"http://localhost:{port}",
            "PYTHONUNBUFFERED": "1",
        }
        self._source = "source ~/catkin_ws/devel/setup.bash"

    def type(self, *commands, sources=True):
        """Type commands; return the output of all of them and the exit status of the last one."""
        lines = ["set -e", *([self._source] if sources else []), *commands]
        done = subprocess.run(
            ["bash", "-c", "\n".join(lines)],
            cwd=self._environment["HOME"],
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=10 * PATIENCE,
        )
        return done.stdout, done.returncode

    def start(self, command):
        """Type a command that does not end by itself."""
        line = f"{self._source}; exec {command}"
        environment = (f"{name}={value}" for name, value in self._environment.items())
        return Process("env", "-i", *environment, "bash", "-c", line)


def shell(home, *arguments, typed="", status=0):
    """Type commands in scripts/shell; return their output and that of the script."""
    done = subprocess.run(
        [f"{CHECKOUT}/scripts/shell", *arguments],
        cwd=home,
        env={"HOME": str(home), "PATH": f"{home}/bin:/usr/bin:/bin"},
        input=typed,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=10 * PATIENCE,
        start_new_session=True,
    )
    assert done.returncode == status, done.stdout
    return done.stdout


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """Return a home with a workspace that scripts/shell --tutorial has created.

    ROS has searched the workspace, as after the completion of a name with Tab.
    """
    tmp_path = tmp_path_factory.mktemp("home")
    add_programs(tmp_path / "bin", ("python",), 'exec /usr/bin/python3 "$@"')
    tab = "COMP_WORDS=(roscd mushr_) COMP_CWORD=1; _roscomplete; echo found: ${COMPREPLY[*]}\n"
    plans = "ls $(rospack find mushr_sim)/plans/slalom.txt\n"
    typed = f"{tab}rosrun mushr_sim check_plan.py slalom\n{plans}rospack find mushr_ros_intro\n"
    output = shell(tmp_path, "--tutorial", typed=typed + "exit 0\n")
    assert re.search("found: .*mushr_sim", output) and "no faults" in output, output
    assert "/plans/slalom.txt\n" in output, output
    assert "package 'mushr_ros_intro' not found" in output, output
    assert f"source {tmp_path}/catkin_ws/devel/setup.bash" in output, output
    return tmp_path


def position_of_car(terminal):
    """Return the car's x and y [m]."""
    output, _ = terminal.type("rostopic echo -n 1 /car/car_pose/pose/position")
    return [float(each) for each in re.findall(r"^[xy]: (.*)", output, re.MULTILINE)]


def test_the_tutorial(home):
    commands, code, launch, plans = tutorial()
    make_executable, simulate, view, drive = (
        next(each for each in commands if each.startswith(start))
        for start in ("chmod", "roslaunch mushr_sim", "rosrun rviz", "roslaunch mushr_ros_intro")
    )
    port = free_port()
    terminal = Terminal(home, port)
    first = [each for each in commands[: commands.index(make_executable)] if "<" not in each]
    output, status = terminal.type(*first, "pwd", sources=False)
    package = output.split()[-1]
    assert (status, package) == (0, f"{home}/catkin_ws/src/mushr_ros_intro"), output
    assert set(plans) == {"plans/straight_line.txt", "plans/figure_8.txt"}
    files = {"src/path_publisher.py": code, "launch/path_publisher.launch": launch}
    for name, text in {**plans, **files}.items():
        with open(os.path.join(package, name), "w", encoding="utf-8") as file:
            file.write(text)

    # Each workspace says which package has the name, and a student can open the other one.
    output = shell(home, typed="exit 0\n")
    assert f"mushr_ros_intro is the package in {CHECKOUT}\n" in output, output
    assert f"{package}; " in output and f"scripts/shell --tutorial {home}/catkin_ws" in output
    output = shell(home, "--tutorial", typed="rospack find mushr_ros_intro\n")
    assert "building" not in output and f"your own package: {package}. " in output, output
    assert output.count(package) == 2, output

    assert os.path.isfile(view.split()[-1].replace("$HOME", str(home)))
    with terminal.start(simulate) as simulation:
        wait_for(lambda: "ready: the car is at" in simulation.output, "the car", 2 * PATIENCE)
        assert "type in another terminal: rosrun mushr_sim path_pub" in simulation.output
        assert rosgraph.Master("/test", f"http://localhost:{port}").getPid()
        output, status = terminal.type(drive)
        assert "cannot launch node of type [mushr_ros_intro/path_publisher.py]" in output
        output, status = terminal.type("roscd mushr_ros_intro", make_executable, drive)
        assert status == 0, output
        assert "finished cleanly" in output
        assert 0.97 * LENGTH < position_of_car(terminal)[0] < TOO_LONG * LENGTH
        seen = f"the plan of /path_publisher: {package}/plans/"
        wait_for(lambda: seen in simulation.output, "the monitor")
        wait_for(lambda: "should" in simulation.output.partition(seen)[2], "the result")
        # The other tools are in the package that has the same name in MuSHR.
        plan = f"{package}/plans/figure_8.txt"
        command = f"rosrun mushr_sim grade.py {plan} --node mushr_ros_intro path_publisher.py"
        output, _ = terminal.type(command)
        assert f"drives {plan} with the car ideal" in output, output
        assert "ok   final_pose: the car ended at (-1." in output, output
        simulation.send_signal(signal.SIGINT)
        assert simulation.wait() == 0


def test_another_workspace_is_not_touched(tmp_path):
    (tmp_path / "catkin_ws" / "src" / "robot").mkdir(parents=True)
    output = shell(tmp_path, "--tutorial", status=1)
    assert f"{tmp_path}/catkin_ws is another workspace, and stays as it is" in output, output
    assert [each.name for each in (tmp_path / "catkin_ws").glob("**/*")] == ["src", "robot"]


def test_a_course(home):
    """Packages of a course that includes mushr_sim; its node has relative topics and no stamps."""
    for name in ("course", "introduction"):
        copy_package(f"{FIXTURES}/course/{name}", f"{home}/a course/{name}")
    # The workspace contains the package of underlay/; the one of the course replaces it.
    copy_package(f"{CHECKOUT}/underlay/mushr_utils", f"{home}/a course/mushr_utils")
    (home / "a course" / "introduction" / "lost.py").write_text("#!/usr/bin/python3\n")
    output = shell(home, "--tutorial", "--course", "a course")
    assert "setup: the course: course introduction mushr_utils \n" in output, output
    assert not os.path.lexists(f"{home}/catkin_ws/src/mushr/mushr_utils")
    assert "1 files begin with #!" in output and "introduction/lost.py" in output, output
    plan = home / "plan.txt"
    plan.write_text("1,2,0.5\n2.0,0\n1.0,0\n")
    terminal = Terminal(home, free_port())
    output, status = terminal.type("rostest introduction exercise.test.xml")
    assert status == 0 and "RESULT: SUCCESS" in output, output
    with terminal.start("roslaunch course simulation.launch.xml") as simulation:
        wait_for(lambda: "ready: the car is at (3.0000 m" in simulation.output, "the car")
        exercise = f"roslaunch introduction exercise.launch.xml plan_file:={plan}"
        output, status = terminal.type(exercise)
        assert status == 0, output
        assert re.search(r"the car moved \d.* m", output), output
        # Without stamps, the distance depends on the load. grade.py drives without this effect.
        x, y = position_of_car(terminal)
        assert x > 1.0
        assert (y - 2.0) / (x - 1.0) == pytest.approx(math.tan(0.5), abs=1e-6)
    navigation = "/car/mux/ackermann_cmd_mux/input/navigation"
    node = f"--node introduction drive_plan --remap control:={navigation}"
    terminal.type("echo 'tolerances: {position: 0.11}' > points.yaml")
    grade = f"rosrun mushr_sim grade.py {plan} {node} --points points.yaml"
    output, status = terminal.type(grade)
    assert status == 0 and "all checks passed" in output, output
