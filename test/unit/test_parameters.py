"""Test the values that parameters accept, and the messages for those that they refuse."""

import os

import pytest

from mushr_ros_intro import parameters
from mushr_ros_intro.errors import UserError
from mushr_ros_intro.parameters import (
    REQUIRED,
    Parameters,
    choice,
    file_name,
    flag,
    loaded,
    number,
    text,
)


def read(kind, value, *arguments, **others):
    declared = getattr(parameters, kind)("name", *arguments, **others)
    return Parameters({"name": value}).get(declared)


def refusal(kind, value, *arguments, **others):
    with pytest.raises(UserError) as caught:
        read(kind, value, *arguments, **others)
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
    assert refusal("integer", 1.5, 1, 0, 9).endswith("is 1.5; expected a whole number from 0 to 9")
    assert refusal("integer", 10, 1, 0, 9).endswith("is 10; expected a whole number from 0 to 9")


def test_flag():
    assert read("flag", True, False) is True and read("flag", False, True) is False
    for value in (0, 1, "true", None):
        message = refusal("flag", value, True)
        assert message == f"parameter ~name is {value!r}; expected true or false"


def test_text():
    assert read("text", "/a", REQUIRED) == "/a"
    for value in ("", " \t", 3, None, ["a"]):
        message = refusal("text", value, "default")
        assert message == f"parameter ~name is {value!r}; expected text that is not empty"
    assert refusal("text", 3, REQUIRED, expected="a plan").endswith("; expected a plan")


def test_choice():
    assert read("choice", "b", ["a", "b"], "a") == "b"
    assert refusal("choice", "c", ["a", "b"], "a") == "parameter ~name is 'c'; expected one of a, b"
    cars = ["ideal", "mushr_sim", "mushr_nano"]
    assert refusal("choice", "nano", cars, "ideal").endswith("; did you mean mushr_nano?")
    assert refusal("choice", "id", cars, "ideal").endswith("mushr_nano")  # too short


def test_optional():
    """Empty text means that the parameter is not set, as from a launch file."""
    for kind, arguments in {
        "text": [],
        "number": ["m", 0.0, 1.0],
        "folder": [],
        "file_name": [],
    }.items():
        assert read(kind, "", None, *arguments) is None
        assert Parameters({}).get(getattr(parameters, kind)("name", None, *arguments)) is None
        assert "~name is 3; expected" in refusal(kind, 3, None, *arguments)
    assert read("choice", "", ["a"], None) is None


def test_a_missing_parameter_has_its_default():
    table = (
        number("rate", 3.0, "Hz", 0.0, 9.0),
        flag("loop", True),
        text("topic", lambda values: f"/{values['rate']:g}"),
        text("token", None),
        choice("car", ["a", "b"], "a"),
        file_name("file", "plan.txt"),
    )
    values = Parameters({"rate": "4e0"}).read(table)
    expected = {"rate": 4.0, "loop": True, "topic": "/4", "token": None, "car": "a"}
    assert values == {**expected, "file": "plan.txt"}
    assert values.text == "rate: 4e0, loop: True, topic: /4, car: a, file: plan.txt"
    plan = text("plan_file", REQUIRED, expected="a plan")
    for given, what in (({}, ""), ({"planfile": "a"}, ", but /car/car_sim/planfile is")):
        with pytest.raises(UserError) as caught:
            Parameters(given, "/car/car_sim/").get(plan)
        message = f"parameter /car/car_sim/plan_file is not set{what}; expected a plan"
        assert str(caught.value) == message


def test_loaded():
    def load(name):
        if name != "good":
            raise UserError(f"{name}:1:1: wrong")
        return [1, 2]

    values = Parameters({"plan": "good"}).read([loaded("plan", load)])
    assert values == {"plan": [1, 2]} and values.text == "plan: good"
    assert refusal("loaded", "bad", load) == "bad:1:1: wrong"
    assert refusal("loaded", 3, load, expected="a plan") == "parameter ~name is 3; expected a plan"


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
    """Those in the table are known, whatever their values."""
    given = Parameters({"plan": "a", "lop": True, "x": 1, "empty": ""})
    table = (text("plan", REQUIRED), text("empty", None), flag("loop", False))
    assert given.unknown(table) == [
        "parameter ~lop is not known, and has no effect; did you mean ~loop?",
        "parameter ~x is not known, and has no effect",
    ]
    with pytest.raises(UserError) as caught:
        given.refuse_unknown(table)
    expected = "parameter ~lop is True; expected only the keys plan, empty, loop"
    assert str(caught.value) == expected
