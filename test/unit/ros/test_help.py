"""Test the answers to --help, and that unknown arguments are refused."""

import glob
import importlib
import os
import re
import signal
import subprocess
import sys

import pytest
import yaml

from mushr_ros_intro.ros import node
from mushr_ros_intro.simulator.car_sim import CarSim
from support import helpers
from support.paths import PACKAGE

FILES = {*glob.glob(f"{PACKAGE}/config/*.yaml")} - {f"{PACKAGE}/config/vesc.yaml"}
"""The files with parameters of nodes of this package."""

NO_MASTER = {"ROS_MASTER_URI": "http://localhost:1"}


def nodes():
    """Return what `node.check_arguments` gets from each program that calls it, by its file name."""
    found = {}
    for path in sorted(glob.glob(f"{PACKAGE}/src/*.py")):
        with open(path) as file:
            call = re.search(r'node\.(main\("\w+", |check_arguments\()(\w+)', file.read())
        if call:
            found[os.path.basename(path)] = call[2]
    return found


NODES = nodes()


def class_of(program, monkeypatch):
    monkeypatch.syspath_prepend(f"{PACKAGE}/src")
    return getattr(importlib.import_module(program[:-3]), NODES[program])


def parameters_in(text):
    """Return the names of the parameters in an answer to --help."""
    return set(re.findall(r"^  (\w+)$", text.split("\n\n")[-1], re.M))


@pytest.mark.parametrize("program", NODES)
def test_help(program, monkeypatch):
    """It names the purpose, the topics, an example, and every parameter."""
    text = node.help_text(class_of(program, monkeypatch))
    kinds = "a number|a whole|true or|one of|a file name|default|required"
    without = rf"^  (\w+)\n    (?:{kinds}|\n|$)"
    assert re.findall(without, text, re.M) == [], "expected a meaning of each parameter"
    expected = "expected a docstring of the class with a sentence, the topics, and an example"
    assert text.count("\n\n") >= 2, expected
    purpose, *_, example, _ = text.split("\n\n")
    assert purpose.endswith("."), expected
    assert re.search("Subscribes|Publishes|topics", text), expected
    assert re.match(r"Example: (rosrun|roslaunch|<test)", example), expected
    assert parameters_in(text)


@pytest.mark.parametrize("name", sorted(os.path.basename(each) for each in FILES))
def test_files_of_parameters(name, monkeypatch):
    program = {"laser.yaml": "laser_sim"}.get(name, name[: -len(".yaml")])
    with open(f"{PACKAGE}/config/{name}") as file:
        names = set(yaml.safe_load(file))
    assert names <= parameters_in(node.help_text(class_of(f"{program}.py", monkeypatch)))


def test_a_program_that_catkin_has_wrapped():
    """The wrapper in devel/lib reads the program and runs it with exec."""
    with open(f"{PACKAGE}/src/laser_sim.py") as file:
        namespace = {"__name__": "__main_of_the_test__", "__doc__": None}
        exec(compile(file.read(), "laser_sim.py", "exec"), namespace)
    assert node.help_text(namespace["LaserSim"]).startswith("Simulate the car's laser scanner")


def test_range_and_default(monkeypatch):
    text = node.help_text(class_of("keyboard_teleop.py", monkeypatch))
    assert text.endswith(
        "  steering_angle\n"
        "    steering angle of A, of D to the right; a number from 0 to 1.5 rad; default 0.34"
    )
    text = node.help_text(class_of("map_server.py", monkeypatch))
    assert "_map_file:=sandbox; required\n" in text
    text = node.help_text(class_of("click_planner.py", monkeypatch))
    assert "\n    by default that of the car; a number from 0.01 to 100 m\n" in text


def test_a_program_answers_before_it_needs_a_master():
    with helpers.node("map_server.py", "--help", "_map_file:=sandbox", **NO_MASTER) as process:
        assert process.wait() == 0, process.output
    assert process.output.startswith("map_server.py: Serve a map from a YAML file")


@pytest.mark.parametrize("program", ["car_sim.py", "doctor.py", "grade.py"])
def test_an_output_that_is_cut_off(program):
    """As in `grade.py --help | head`: the program ends quietly."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, f"{PACKAGE}/src/{program}", "--help"]
    ended = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (-signal.SIGPIPE, b"")


@pytest.mark.parametrize("argument", ["--strict", "-x", "figure_8", "_loop", "--loop:=true", ""])
def test_unknown_arguments(argument, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["/a/node.py", "_loop:=true", argument])
    with pytest.raises(SystemExit) as caught:
        node.check_arguments(CarSim)
    assert caught.value.code == 2
    expected = f"node.py: unknown argument '{argument}'; expected _PARAMETER:=VALUE, FROM:=TO for "
    assert capsys.readouterr().err.startswith(expected)


def test_known_arguments(monkeypatch):
    arguments = ["__name:=a", "_x:=-1", "/tf:=/tf_old", "--gtest_output=xml:a.xml"]
    monkeypatch.setattr(sys, "argv", ["node.py", *arguments])
    node.check_arguments(CarSim, "--gtest_output=")


def test_rviz_without_a_display(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.syspath_prepend(f"{PACKAGE}/src")
    monkeypatch.setattr(sys, "argv", ["view.py", "car"])
    with pytest.raises(SystemExit, match="in a browser, type: roslaunch mushr_ros_intro web"):
        importlib.import_module("view").main()
