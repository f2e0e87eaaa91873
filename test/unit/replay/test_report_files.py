"""Check the files of a replay's report."""

import csv
import math
import sys

import pytest

from mushr_ros_intro.replay.report_files import write_report
from support.geometry import closed_form
from support.recorded import ROWS, START, replay, reported

FILES = ["picture.png", "trajectory.csv"]


def rows_of(folder):
    """Return the rows of trajectory.csv."""
    with open(folder / "trajectory.csv") as file:
        return [{key: float(text) for key, text in row.items()} for row in csv.DictReader(file)]


def test_a_failed_replay(tmp_path):
    """The files show what was predicted, even if the node sent no command."""
    write_report(str(tmp_path / "new"), reported(replay(outcome="it crashed", sent=())))
    last = rows_of(tmp_path / "new")[-1]
    end = [last[f"predicted_{name}"] for name in ("x", "y", "theta")]
    assert end == pytest.approx(closed_form(START, ROWS), abs=1e-9)
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == FILES


def test_a_drive(tmp_path):
    write_report(str(tmp_path), reported(replay()))
    rows = rows_of(tmp_path)
    assert [row["time"] for row in rows] == pytest.approx([0.02 * i for i in range(len(rows))])
    for row in rows:
        away = math.hypot(row["x"] - START[0], row["y"] - START[1])
        assert row["distance_from_start"] == pytest.approx(away)
        for name in ("x", "y", "theta"):
            assert row[name] == pytest.approx(row[f"predicted_{name}"])
    end = [rows[-1][name] for name in ("x", "y", "theta")]
    assert end == pytest.approx(closed_form(START, ROWS), abs=1e-9)
    assert (tmp_path / "picture.png").read_bytes().startswith(b"\x89PNG")


def test_without_matplotlib(tmp_path, monkeypatch, capsys):
    """The small container has none."""
    monkeypatch.setitem(sys.modules, "mushr_ros_intro.replay.pictures", None)
    write_report(str(tmp_path), reported(replay()))
    assert sorted(path.name for path in tmp_path.iterdir()) == FILES[1:]
    said = capsys.readouterr().err
    assert said.startswith(f"{tmp_path}: no picture (") and "install python3-matplotlib" in said
