"""Results of grading for tests."""

import math

import numpy as np

from mushr_ros_intro.classroom.grades import Grade, PlanGrade, StoredDrive, Student
from mushr_ros_intro.classroom.store import Store
from mushr_ros_intro.replay.judge import CHECK_NAMES, Check, Judgement
from mushr_ros_intro.replay.recording import Drive
from support.recorded import replay

ANN = Student("Ann", "17", "ann@x.edu")


def graded(
    plan="circle",
    failed=(),
    message="as expected",
    count=1,
    radius=2.0,
    offset=0.5,
    unjudged=(),
    share=1.0,
):
    """Return a drive of `count` poses on a quarter of a circle, `offset` beside the prediction."""
    angles = np.linspace(0.0, math.pi / 2, count)
    driven = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), angles])
    drive = Drive(np.arange(float(count)), driven, driven + [offset, 0.0, 0.0], offset)
    checks = tuple(
        Check(name, name not in (*failed, *unjudged), f"{name}: {message}", name not in unjudged)
        for name in CHECK_NAMES
    )
    recorded = replay(output=f"the output: {message}", seconds=2.5)
    return PlanGrade(plan, Judgement(recorded, drive, None, checks), share)


def changed(plan, **changes):
    """Return a drive with other values of its judgement."""
    return plan._replace(judgement=plan.judgement._replace(**changes))


def submission(*plans, name="ann", students=(ANN,), **values):
    """Return the result of a submission."""
    return Grade(name, tuple(students), **{"fault": "", "error": "", **values}, plans=plans)


def store(folder, *names, **changes):
    """Store a drive of each submission as grade.py does, with `changes` of the recording."""
    stored = Store(str(folder))
    for name in names:
        drives = (StoredDrive("circle", "key", "", replay(**changes)),)
        stored.save(submission(name=name, drives=drives))
