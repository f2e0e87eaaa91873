"""Replays of nodes, and controllers that follow a path."""

import glob
import os
import shutil
import threading
import xmlrpc.client

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.isolation.workspace import inherited
from mushr_ros_intro.replay.job import Job, run_job
from mushr_ros_intro.replay.reference import read_references
from mushr_ros_intro.replay.setting import read_setting
from mushr_ros_intro.replay.world import ReplayWorld
from support.paths import CHECKOUT, PACKAGE

CONTROLLERS = f"{CHECKOUT}/test/fixtures/controllers"

(_TWO_PERIODS,) = read_references(["wave"], f"{CHECKOUT}/plans").values()

WAVE = _TWO_PERIODS._replace(poses=_TWO_PERIODS.poses[:81], stamps=_TWO_PERIODS.stamps[:81])
"""The first period of the path wave, 3.8 s."""


def copy_controllers(folder):
    """Copy the controllers to a folder; rosrun must not find those of the fixtures."""
    for path in glob.glob(f"{CONTROLLERS}/*.py"):
        os.chmod(shutil.copy(path, folder), 0o755)


def replay(path, exercise, remap=(), map_name="none"):
    """Return the judgement on a node, given its path and what it drives."""
    setting = _setting(remap, map_name)
    return run_job(Job(os.path.basename(path), (os.fspath(path),), exercise, setting))


def _setting(remap=(), map_name="none"):
    return read_setting(
        *(PACKAGE, "ideal", map_name),
        remap=remap,
        tolerances={},
        sandbox=Sandbox(),
        ros=inherited(),
    )


def _world():
    """Return the world of a replay in this process."""
    setting = _setting()
    return ReplayWorld(Car(), setting.parameters, setting.mux, None, WAVE)


def unobserved_threads():
    """Return the names of the threads of this process for which the clock does not wait."""
    world = _world()
    threads = threading.enumerate()
    world._others.observe()
    return [each.name for each in threads if str(each.native_id) not in world._others.usages]


def limits_calls():
    """Return whether calls from a replay in this process to the node under test have a timeout."""
    _world()
    return isinstance(xmlrpc.client.Transport().make_connection("localhost").timeout, float)


def follow(name, folder, *remap):
    """Return the judgement on a controller."""
    return replay(os.path.join(folder, f"{name}.py"), WAVE, remap)
