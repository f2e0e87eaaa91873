"""YAML files: how scalars are loaded, and one clear error for each file that cannot be used."""

import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.yaml_file import MAX_SIZE, read_mapping


class FileError(UserError):
    """The caller's class of errors."""


def read(path, as_text=False):
    return read_mapping(str(path), "keys such as 'a: 1'", FileError, as_text)


def message_of(path):
    with pytest.raises(FileError) as caught:
        read(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and message.endswith("; expected keys such as 'a: 1'")
    assert len(message.splitlines()) == 1
    return message


def test_scalars_are_values_or_text(tmp_path):
    path = tmp_path / "file.yaml"
    path.write_text("a: 1\nb: [0.5, .inf, true, null, word]")
    assert read(path) == {"a": 1, "b": [0.5, float("inf"), True, None, "word"]}
    assert read(path, as_text=True) == {"a": "1", "b": ["0.5", ".inf", "true", "null", "word"]}
    path.write_text("# nothing yet\n")
    assert read(path) == read(path, as_text=True) == {}


ALIASES = [f"a{number}: &a{number} [{f'*a{number - 1}, ' * 9}]" for number in range(1, 30)]


@pytest.mark.parametrize(
    "data, expected",
    [
        (b"- image", "the file has no keys"),
        (b"a: [1, 2\nb: 3", "line 2, column 2: expected ',' or ']'"),
        (b"a: b: c", "line 1, column 5: mapping values are not allowed here"),
        (b"a: \x01", "unacceptable character"),
        (b"a: caf\xe9", "unacceptable character"),
        (b"a: &x 1\nb: *x", "line 2, column 4: found an alias"),
        ("\n".join(["a0: &a0 [x]", *ALIASES]).encode(), "found an alias"),
        (b"a: " + b"[" * 3000, "this is nested too deeply"),
        (b"#" * (MAX_SIZE + 1), "the file has more than 65536 bytes"),
        (b"? [a]\n: b", "found unhashable key"),
        (b"a: !!int ''", ""),
        (b"a: !!python/object:os.system x", "could not determine a constructor"),
    ],
    ids=lambda value: None if isinstance(value, str) else value[:12].decode("latin-1"),
)
def test_a_broken_file(tmp_path, data, expected):
    path = tmp_path / "file.yaml"
    path.write_bytes(data)
    assert expected in message_of(path)


def test_files_that_cannot_be_read(tmp_path):
    assert "the file cannot be read (No such file or directory)" in message_of(tmp_path / "none")
    assert "this is a directory" in message_of(tmp_path)
    os.mkfifo(str(tmp_path / "pipe"))
    assert "this is not a regular file" in message_of(tmp_path / "pipe")
    assert "null" in message_of("a\0b")


@given(st.binary(max_size=300))
def test_any_bytes(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("any") / "file.yaml"
    path.write_bytes(data)
    try:
        assert isinstance(read(path), dict)
    except FileError as error:
        assert str(error).endswith("; expected keys such as 'a: 1'")
