"""Test the values that parameters accept, and the messages for those that they refuse."""

import os

import pytest

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import Parameters


def read(kind, value, *arguments):
    return getattr(Parameters({"name": value}), kind)("name", *arguments)


def refusal(kind, value, *arguments):
    with pytest.raises(UserError) as caught:
        read(kind, value, *arguments)
    return str(caught.value)


@pytest.mark.parametrize("value", [0.5, 1, 2.0, 2, "1e-0", "0.5"])
def test_good_number(value):
    found = read("number", value, 1.0, "Hz", 0.5, 2.0)
    assert found == float(value) and isinstance(found, float)


def test_bad_number():
    infinite = [float("nan"), float("inf"), -float("inf"), "nan", 10**400]
    for value in [0.49, 2.01, -1, True, "one", "", None, [1.0], *infinite]:
        expected = f"parameter ~name is {value!r}; expected a number from 0.5 to 2 Hz"
        assert refusal("number", value, 1.0, "Hz", 0.5, 2.0) == expected
    # No float holds this one, and there is no limit.
    message = refusal("number", 10**400, 0.0, "m/s", 0.0, float("inf"))
    assert message.endswith("expected a number from 0 to inf m/s")
    message = refusal("number", -1, 0, "", 0, 9)
    assert message == "parameter ~name is -1; expected a number from 0 to 9"


def test_integer():
    for value in (3, 3.0, "3"):
        assert repr(read("integer", value, 1, 0, 9)) == "3"
    assert refusal("integer", 1.5, 1, 0, 9) == "parameter ~name is 1.5; expected a whole number"
    assert refusal("integer", 10, 1, 0, 9).endswith("is 10; expected a number from 0 to 9")


def test_flag():
    assert read("flag", True, False) is True and read("flag", False, True) is False
    for value in (0, 1, "true", None):
        message = refusal("flag", value, True)
        assert message == f"parameter ~name is {value!r}; expected true or false"


def test_text():
    assert read("text", "/a") == "/a"
    for value in ("", " \t", 3, None, ["a"]):
        message = refusal("text", value, "default")
        assert message == f"parameter ~name is {value!r}; expected text that is not empty"
    assert refusal("text", 3, None, "a plan").endswith("; expected a plan")


def test_optional_text_and_choice():
    assert read("optional_text", "a") == "a"
    assert read("optional_text", "") is None
    assert read("any_text", "", "default", "", "") == ""
    assert Parameters({}).any_text("name", "default", "", "") == "default"
    assert "expected text" in refusal("any_text", 3, "default", "", "")
    assert Parameters({}).optional_text("name") is None
    assert "expected text" in refusal("optional_text", 3)
    assert read("choice", "b", ["a", "b"]) == "b"
    assert refusal("choice", "c", ["a", "b"]) == "parameter ~name is 'c'; expected one of a, b"
    cars = ["ideal", "mushr_nano_master", "mushr_nano"]
    assert refusal("choice", "nano", cars).endswith("; did you mean mushr_nano?")
    assert refusal("choice", "id", cars).endswith("mushr_nano")  # too short for a suggestion


def test_a_missing_parameter_has_its_default():
    parameters = Parameters({})
    assert parameters.number("rate", 3.0, "Hz", 0.0, 9.0) == 3.0
    assert parameters.flag("loop", True) is True
    assert parameters.text("topic", "/a") == "/a"
    assert parameters.choice("car", ["a", "b"], "a") == "a"
    assert parameters.file_name("file", "plan.txt") == "plan.txt"
    resolved = {"rate": 3.0, "loop": True, "topic": "/a", "car": "a", "file": "plan.txt"}
    assert parameters.resolved == resolved
    with pytest.raises(UserError) as caught:
        Parameters({}, "/car/car_sim/").text("plan_file", expected="a plan")
    assert str(caught.value) == "parameter /car/car_sim/plan_file is not set; expected a plan"
    with pytest.raises(UserError) as caught:
        Parameters({"planfile": "a"}).text("plan_file", expected="a plan")
    assert str(caught.value) == "parameter ~plan_file is not set, but ~planfile is; expected a plan"


def test_folder(monkeypatch, tmp_path):
    (tmp_path / "plans").mkdir()
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("PWD", str(tmp_path))
    monkeypatch.setenv("HOME", str(tmp_path))
    for value in (".", "plans", "~/plans", str(tmp_path / "plans")):
        expected = str(tmp_path) if value == "." else str(tmp_path / "plans")
        assert read("folder", value, ".") == os.path.realpath(expected)
    for value in ("nowhere", "file"):
        message = refusal("folder", value, ".")
        assert message.startswith(f"parameter ~name is '{value}'; expected a folder; there is none")


def test_file_name():
    assert read("file_name", "a plan.txt", "x") == "a plan.txt"
    for value in ("", ".", "..", "a/b", "/a", 3, None):
        message = refusal("file_name", value, "x")
        assert message == f"parameter ~name is {value!r}; expected a file name without a folder"


def test_unknown_parameters():
    """Those that are asked for are known, whatever their values."""
    parameters = Parameters({"plan": "a", "lop": True, "x": 1, "empty": ""})
    parameters.text("plan")
    parameters.optional_text("empty")
    parameters.flag("loop", False)
    assert parameters.unknown() == [
        "parameter ~lop is not known, and has no effect; did you mean ~loop?",
        "parameter ~x is not known, and has no effect",
    ]
