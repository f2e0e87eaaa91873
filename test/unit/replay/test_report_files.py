"""Check the files of a replay's report."""

import csv
import json
import math
import sys

import pytest

from mushr_ros_intro.replay.report_files import write_report
from support.geometry import closed_form
from support.recorded import ROWS, START, replay, reported

FILES = ["distances.png", "locations.png", "report.json", "trajectory.csv"]


def written(folder, seen):
    """Write the files of a replay; return its report, and report.json."""
    report = reported(seen)
    write_report(str(folder), report, {"seed": "7"})
    return report, json.loads((folder / "report.json").read_text())


def test_a_failed_replay(tmp_path):
    """The files show what was predicted, even if the node sent no command."""
    report, said = written(tmp_path / "new", replay(outcome="it crashed", sent=()))
    assert said["arguments"] == {"seed": "7"}
    assert said["tolerances"] == report.tolerances._asdict()
    assert not said["passed"] and said["commands"] == 0
    assert said["verdict"] == report.verdict.splitlines()
    assert said["checks"] == [each._asdict() for each in report.checks]
    end = said["predicted_final_pose"].values()
    assert [*end] == pytest.approx(closed_form(START, ROWS), abs=1e-9)
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == FILES


def test_a_drive(tmp_path):
    seen = replay()
    _, report = written(tmp_path, seen._replace(outcome="it crashed"))
    assert not report["passed"]
    _, report = written(tmp_path, seen)
    assert report["passed"] and report["verdict"][-1] == "all checks passed"
    assert report["commands"] == len(seen.sent)
    assert report["frechet_distance"] == pytest.approx(0.0, abs=1e-9)
    for pose in (report["final_pose"], report["predicted_final_pose"]):
        assert [*pose.values()] == pytest.approx(closed_form(START, ROWS), abs=1e-9)
    with open(tmp_path / "trajectory.csv") as file:
        rows = [{key: float(text) for key, text in row.items()} for row in csv.DictReader(file)]
    assert [row["time"] for row in rows] == pytest.approx([0.02 * i for i in range(len(rows))])
    for row in rows:
        away = math.hypot(row["x"] - START[0], row["y"] - START[1])
        assert row["distance_from_start"] == pytest.approx(away)
        for name in ("x", "y", "theta"):
            assert row[name] == pytest.approx(row[f"predicted_{name}"])
    assert {name: rows[-1][name] for name in ("x", "y", "theta")} == report["final_pose"]
    for name in ("distances.png", "locations.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG"), name


def test_without_matplotlib(tmp_path, monkeypatch, capsys):
    """The small container has none."""
    monkeypatch.setitem(sys.modules, "mushr_ros_intro.replay.pictures", None)
    written(tmp_path, replay())
    assert sorted(path.name for path in tmp_path.iterdir()) == FILES[2:]
    said = capsys.readouterr().err
    assert said.startswith(f"{tmp_path}: no pictures (") and "install python3-matplotlib" in said
