"""Grade a class with replays that are computed, and with the results of earlier runs."""

import gc
import json
import multiprocessing
import os
import pathlib
import runpy
import signal
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest

from mushr_ros_intro.classroom import grading
from mushr_ros_intro.classroom.store import Store, from_json, load_all, to_json
from mushr_ros_intro.classroom.submissions import collect
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.isolation.sandbox import Sandbox
from mushr_ros_intro.plan.parse import read_plan
from mushr_ros_intro.replay.following import judge_drive
from mushr_ros_intro.replay.own_process import ReplayError
from mushr_ros_intro.replay.setting import read_setting
from support.grades import store
from support.paths import PACKAGE
from support.recorded import map_of, replay
from support.submissions import XML, fill, unchecked  # noqa: F401

FILES = {"package.xml": XML, "src/path_publisher.py": b"#!/usr/bin/python3\n"}

TEXT = "1.0, 2.0, 0.5\n2.0, 0.1\n1.0, -0.1, 0.5\n1.0, -0.1, 0.25\n"


class Course:
    """A class of three submissions; ``driven`` lists the replays of the last run."""

    def __init__(self, folder, monkeypatch):
        self.folder, self.out, self.driven = folder, folder / "out", []
        for name in ("ann", "bob", "eve"):
            fill(folder / "class" / name, FILES)
        (folder / "plan.txt").write_text(TEXT)
        self.plans = {"plan": str(folder / "plan.txt")}
        self.options = {"jobs": 1}
        self.setting = {"tolerances": {}, "remap": ()}
        self.fail = {}
        monkeypatch.setattr(grading, "probe", lambda plan, setting: None)
        monkeypatch.setattr(grading, "build", lambda submission, setting: "")
        monkeypatch.setattr(grading, "record", self.record)
        monkeypatch.setattr(grading, "judges", lambda: ThreadPoolExecutor(1))
        monkeypatch.setattr(grading, "judge_and_draw", self.judge)

    def record(self, job):
        self.driven.append(job.name)
        if job.name in self.fail:
            raise self.fail[job.name]
        output = f"{job.folder}/src/path_publisher.py: hello"
        error = f"FileNotFoundError: {job.folder}/a.txt (path_publisher.py, line 3)"
        return replay(job.plan, grid=None, output=output, error=error)

    def judge(self, recorded, tolerances):
        return judge_drive(recorded, tolerances), 1.0, "<svg/>"

    def run(self, stop_after=None):
        """Grade; return the results by name, and the names of those that are new."""
        self.driven.clear()
        gc.collect()  # the store of the last run, with its lock
        workspace = pathlib.Path(tempfile.mkdtemp(dir=self.folder))
        found = collect([str(self.folder / "class")], str(workspace))
        plans = {name: read_plan(path) for name, path in self.plans.items()}
        others = {"sandbox": Sandbox(), "ros": {}}
        setting = read_setting(PACKAGE, "ideal", "none", **self.setting, **others)
        store = Store(str(self.out))
        tasks = [grading.Task(each, plans) for each in found]
        run = grading.Grading(setting, store, **self.options).run(tasks)
        results = [each for _, each in zip(range(stop_after or 9), run)]
        run.close()
        return {each.name: each for each, _ in results}, [each.name for each, new in results if new]


@pytest.fixture
def course(tmp_path, monkeypatch, unchecked):  # noqa: F811
    return Course(tmp_path, monkeypatch)


def test_only_what_has_changed_is_driven(course, monkeypatch):
    results, new = course.run()
    assert sorted(course.driven) == sorted(new) == ["ann", "bob", "eve"]
    assert all(each.passed for each in results.values())
    again, new = course.run()
    assert course.driven == new == [] and all(each.passed for each in again.values())
    assert again["ann"].plans[0].picture == "<svg/>"
    with open(course.folder / "class" / "bob" / "src" / "path_publisher.py", "a") as file:
        file.write("# changed\n")
    assert (course.run()[1], course.driven) == (["bob"], ["bob"])
    (course.folder / "class" / "eve" / "extra.txt").touch()
    assert course.run()[1] == ["eve"]
    course.setting["remap"] = ("a:=b",)
    assert len(course.run()[1]) == 3
    (course.folder / "plan.txt").write_text(f"# a comment\n{TEXT}")
    course.run()
    assert len(course.driven) == 3
    (course.folder / "package.xml").write_text("<package><version>9.9.9</version></package>")
    monkeypatch.setattr(grading, "package_folder", lambda name: str(course.folder / name))
    course.run()
    assert len(course.driven) == 3
    course.options["isolation"] = "not isolated"
    course.run()
    assert len(course.driven) == 3


def test_drives_are_judged_again(course):
    course.run()
    course.setting["tolerances"] = {"path": -1.0}
    strict, new = course.run()
    assert course.driven == new == []
    assert not any(each.passed for each in strict.values())
    course.setting["tolerances"] = {}
    assert course.run()[0]["ann"].passed


def test_a_stored_drive(course):
    """It is equal to the recorded one, but for paths of the machine, and the cells of the map."""
    course.run()
    (stored,) = load_all(str(course.out))[0].drives
    recorded = replay(read_plan(str(course.folder / "plan.txt")), grid=None)
    for name, value in recorded._asdict().items():
        if name not in ("plan", "output", "error"):
            np.testing.assert_array_equal(getattr(stored.recorded, name), value)
    assert stored.recorded.plan == recorded.plan._replace(path=stored.recorded.plan.path)
    assert stored.recorded.output == "src/path_publisher.py: hello"
    grid = map_of(20, 30, Pose(-5.0, -4.0, 0.1))
    seen = from_json(json.loads(json.dumps(to_json(grid))))
    assert (seen.cells.shape, seen.origin, seen.resolution) == ((30, 20), grid.origin, 1.0)


def test_what_failed_is_graded_again(course):
    course.fail = {"ann": ReplayError("no memory")}
    results, _ = course.run()
    assert results["ann"].error == "plan: no memory" and results["bob"].passed
    course.fail = {"ann": ReplayError("no memory")}
    assert course.run()[1] == ["ann"]
    assert [each.error for each in load_all(str(course.out))] == ["plan: no memory", "", ""]
    course.fail = {}
    assert course.run()[0]["ann"].passed and course.driven == ["ann"]


def test_an_interrupted_run_is_continued(course):
    results, _ = course.run(stop_after=1)
    (first,) = results
    stored = {each.name: each.error for each in load_all(str(course.out))}
    assert {stored.pop(first), *stored.values()} == {"", "it has not been graded yet"}
    assert len(stored) == 2
    course.run()
    assert first not in course.driven and course.driven


def test_an_interruption_also_ends_the_repetition_of_a_killed_replay(course, monkeypatch):
    codes, has_begun = [], threading.Event()

    def record(job):
        if job.name == "ann":
            assert has_begun.wait(10.0)
            return course.record(job)
        for _ in range(2):
            process = multiprocessing.get_context("fork").Process(target=signal.pause)
            process.start()
            has_begun.set()
            process.join()
            codes.append(process.exitcode)
        raise ReplayError("killed")

    course.options["jobs"] = 2
    monkeypatch.setattr(grading, "record", record)
    assert list(course.run(stop_after=1)[0]) == ["ann"]
    assert codes[1:] and set(codes) == {-signal.SIGKILL}


def test_a_plan_that_is_dropped(course):
    """It is not stored any more, so --merge does not count it."""
    course.plans["other"] = course.plans["plan"]
    course.run()
    del course.plans["other"]
    course.run()
    assert course.driven == []
    plans = [[drive.plan for drive in each.drives] for each in load_all(str(course.out))]
    assert plans == 3 * [["plan"]]


def test_a_student_who_left(course):
    course.run()
    ann = course.folder / "class" / "ann"
    ann.rename(course.folder / "ann")
    assert set(course.run()[0]) == {"bob", "eve"}
    (course.folder / "ann").rename(ann)
    assert course.run()[0]["ann"].passed and course.driven == []
    assert len(load_all(str(course.out))) == 3


def test_a_damaged_file_is_graded_again(course):
    course.run()
    (course.out / "data" / "ann.json").write_text("{")
    with pytest.raises(UserError, match="not the output of grade.py"):
        load_all(str(course.out))
    course.run()
    assert course.driven == ["ann"]


def test_paths_are_short(course):
    submission = SimpleNamespace(folder="/tmp/x.y/ann", name="ann")
    text = "/tmp/x.y/ann/src/a.py /tmp/submissions/ann/b /tmp/plans/c.txt:2 /tmpx /car/odom"
    assert grading._shortened(text, submission) == "src/a.py b c.txt:2 /tmpx /car/odom"


@pytest.fixture
def grade(monkeypatch, tmp_path):
    """Return the globals of grade.py, and a function that runs it in a folder with arguments."""
    program = runpy.run_path(os.path.join(PACKAGE, "src", "grade.py"))
    main = program["main"]
    monkeypatch.setenv("ROS_HOSTNAME", "localhost")
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    monkeypatch.setitem(main.__globals__, "judges", lambda: ThreadPoolExecutor(1))
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["grade.py", *arguments])
        return main()

    run.globals = main.__globals__
    return run


def test_merge(grade, tmp_path, capsys):
    """Of several results of a submission, that of the last folder is used."""
    folders = [str(tmp_path / name) for name in ("one", "two", "all")]
    store(folders[0], "ann", outcome="it crashed")
    store(folders[1], "ann", "bob")
    assert grade("--merge", *folders[:-1], "--out", folders[-1]) == 0
    printed = capsys.readouterr()
    assert (
        "2 of 2 submissions passed" in printed.out
        and f"ann: that of {folders[1]} is used" in printed.err
    )


def test_merge_of_submissions_that_could_not_be_run(grade, tmp_path):
    """They know no plan, so the file of points cannot be compared with the plans."""
    (tmp_path / "points.yaml").write_text("plans: {test_drive: {path: 3}}")
    submission = SimpleNamespace(name="ann", students=())
    result = grading.not_graded(submission)._replace(fault="There is no node.", error="")
    Store(str(tmp_path / "one")).save(result)
    assert grade("--merge", "one", "--out", "all", "--points", "points.yaml") == 1


def test_two_processes(tmp_path):
    store = Store(str(tmp_path / "out"))
    assert (tmp_path / "out").stat().st_mode & 0o777 == 0o700  # results are private
    with pytest.raises(UserError, match="another grade.py writes to this folder"):
        Store(str(tmp_path / "out"))
    del store
    Store(str(tmp_path / "out"))


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can change the owner of files")
def test_results_belong_to_the_user_of_sudo(course, monkeypatch):
    monkeypatch.setenv("SUDO_UID", "1234")
    monkeypatch.setenv("SUDO_GID", "1235")
    course.out = course.folder / "a" / "out"
    course.run()
    files = [course.out.parent, course.out, *course.out.rglob("*")]
    assert len(files) == 7
    assert {(each.stat().st_uid, each.stat().st_gid) for each in files} == {(1234, 1235)}
    assert course.folder.stat().st_uid == 0
    assert load_all(str(course.out))[0].name == "ann"


def test_a_defect_is_no_verdict(grade, monkeypatch, capsys):
    """If grade.py itself fails unexpectedly, its exit status does not blame the node."""
    monkeypatch.setitem(grade.globals, "parse_arguments", lambda *_: SimpleNamespace())
    assert grade() == 3
    assert "AttributeError" in capsys.readouterr().err
