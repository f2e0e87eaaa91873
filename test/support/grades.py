"""Results of grading for tests."""

import math

from mushr_ros_intro.classroom.grades import Grade, PlanGrade, Student
from mushr_ros_intro.classroom.store import Key, Record, Store, StoredDrive
from mushr_ros_intro.replay.judge import CHECK_NAMES, Check

ANN = Student("Ann", "17", "ann@x.edu")


def graded(
    plan="circle",
    failed=(),
    message="as expected",
    count=0,
    radius=2.0,
    offset=0.5,
    unjudged=(),
):
    """Return a drive of `count` poses on a quarter of a circle, `offset` beside the prediction."""
    angles = [math.pi / 2 * index / max(count - 1, 1) for index in range(count)]
    driven = tuple(
        (radius * math.cos(angle), radius * math.sin(angle), angle + math.pi / 2)
        for angle in angles
    )
    return PlanGrade(
        plan,
        tuple(
            Check(
                name, name not in (*failed, *unjudged), f"{name}: {message}", name not in unjudged
            )
            for name in CHECK_NAMES
        ),
        f"the verdict: {message}",
        f"the output: {message}",
        2.5,
        tuple(float(index) for index in range(count)),
        driven,
        tuple((x + offset, y, theta) for x, y, theta in driven),
    )


def submission(*plans, name="ann", students=(ANN,), **values):
    """Return the result of a submission."""
    return Grade(name, tuple(students), **{"fault": "", "error": "", **values}, plans=plans)


def store(folder, *results, time=0.0):
    """Write results as grade.py does, without recordings."""
    key = Key("files", "plan", "options", "package", "tolerances")
    stored = Store(str(folder))
    for result in results:
        drives = {plan.plan: StoredDrive(key, "", plan, {}) for plan in result.plans}
        stored.save(Record(result, drives, time))
