"""Where a node logs if it cannot write where it should."""

import os

import pytest

from mushr_ros_intro.logs import find_log_folder


@pytest.mark.parametrize("home, is_good", [("ros", True), ("file/ros", False)])
def test_log_folder(tmp_path, monkeypatch, home, is_good):
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("ROS_HOME", str(tmp_path / home))
    monkeypatch.setenv("ROS_LOG_DIR", "")  # put back after the test, whatever it becomes
    monkeypatch.delenv("ROS_LOG_DIR")
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    find_log_folder()
    other = str(tmp_path / f"ros_log_{os.getuid()}")
    assert os.environ.get("ROS_LOG_DIR") == (None if is_good else other)
    assert os.path.isdir(str(tmp_path / "ros" / "log")) == is_good
