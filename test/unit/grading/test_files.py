"""Check the files of a replay's report."""

import json

from test_judge import PLAN, replay

from mushr_ros_intro.car.model import Car
from mushr_ros_intro.grading.files import write
from mushr_ros_intro.grading.judge import default_tolerances, judge


def test_one_fault_fails_the_report(tmp_path):
    seen = replay(outcome="it crashed")
    write(str(tmp_path), seen, judge(seen, default_tolerances(PLAN, Car())), {})
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["passed"] is False
    assert report["verdict"] == "node: it crashed"
