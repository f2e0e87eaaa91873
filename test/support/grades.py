"""Results of grading for tests."""

import numpy as np

from mushr_ros_intro.classroom.grades import Grade, PlanGrade, StoredDrive, Student
from mushr_ros_intro.classroom.store import Store
from mushr_ros_intro.replay.judge import CHECK_NAMES, Check, Judgement
from mushr_ros_intro.replay.recording import Drive
from support.recorded import replay

ANN = Student("Ann", "17", "ann@x.edu")


def graded(plan="circle", failed=(), message="as expected", unjudged=(), share=1.0):
    """Return the verdict on a drive of one pose, 0.5 m beside the prediction."""
    drive = Drive(np.zeros(1), np.zeros((1, 3)), np.array([[0.5, 0.0, 0.0]]), 0.5)
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
