"""The values of parameters that nodes take, and the words for those that they do not."""

import os

import pytest

from mushr_ros_intro.parameters import ParameterError, file_name, flag, folder, number, text


@pytest.mark.parametrize("value", [0.5, 1, 2.0, 2])
def test_good_number(value):
    found = number("~rate", value, "Hz", 0.5, 2.0)
    assert found == value and isinstance(found, float)


@pytest.mark.parametrize(
    "value",
    [
        0.49,
        2.01,
        -1,
        float("nan"),
        float("inf"),
        -float("inf"),
        pytest.param(10**400, id="huge"),
        True,
        "1",
        None,
        [1.0],
    ],
)
def test_bad_number(value):
    with pytest.raises(ParameterError) as caught:
        number("~rate", value, "Hz", 0.5, 2.0)
    expected = f"parameter ~rate is {value!r}; expected a number from 0.5 to 2 Hz"
    assert str(caught.value) == expected


def test_a_number_that_no_float_holds_is_refused_also_where_there_is_no_limit():
    with pytest.raises(ParameterError, match="expected a number from 0 to inf m/s"):
        number("~speed_limit", 10**400, "m/s", 0.0, float("inf"))


def test_flag():
    assert flag("~loop", True) is True and flag("~loop", False) is False
    for value in (0, 1, "true", None):
        with pytest.raises(ParameterError) as caught:
            flag("~loop", value)
        assert str(caught.value) == f"parameter ~loop is {value!r}; expected true or false"


def test_text():
    assert text("~topic", "/a") == "/a"
    for value in ("", " \t", 3, None, ["a"]):
        with pytest.raises(ParameterError) as caught:
            text("~topic", value)
        assert f"parameter ~topic is {value!r}; expected text" in str(caught.value)


def test_folder(monkeypatch, tmp_path):
    here, home = str(tmp_path / "here"), str(tmp_path / "home")
    for path in (f"{here}/plans", f"{home}/plans"):
        os.makedirs(path)
    monkeypatch.setenv("PWD", here)
    monkeypatch.setenv("HOME", home)
    assert folder("~folder", "plans") == f"{here}/plans"
    assert folder("~folder", "/proc") == "/proc"
    assert folder("~folder", "~/plans") == f"{home}/plans"
    with pytest.raises(ParameterError, match="expected text"):
        folder("~folder", "")
    with pytest.raises(
        ParameterError, match=f"'plan'; expected a folder; there is none at {here}/plan"
    ):
        folder("~folder", "plan")


def test_file_name():
    assert file_name("~name", "a.txt") == "a.txt"
    for value in ("", ".", "..", "a/b", "/a", 3, None):
        with pytest.raises(ParameterError) as caught:
            file_name("~name", value)
        assert f"parameter ~name is {value!r}; expected a file's name" in str(caught.value)
