"""YAML files: one clear error for each file that cannot be used."""

import pytest

from mushr_ros_intro.errors import UserError
from mushr_ros_intro.yaml_file import read_mapping


def read(path):
    return read_mapping(str(path), "keys such as 'a: 1'")


def message_of(path):
    with pytest.raises(UserError) as caught:
        read(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ") and message.endswith("; expected keys such as 'a: 1'")
    assert len(message.splitlines()) == 1
    return message


def test_a_mapping_and_an_empty_file(tmp_path):
    path = tmp_path / "file.yaml"
    path.write_text("a: 1\nb: [0.5, .inf, true, null, word]")
    assert read(path) == {"a": 1, "b": [0.5, float("inf"), True, None, "word"]}
    path.write_text("a: &common {b: 1, c: 2}\nd: {<<: *common, b: 3}")
    assert read(path)["d"] == {"b": 3, "c": 2}
    path.write_text("# nothing yet\n")
    assert read(path) == {}


@pytest.mark.parametrize(
    "data, expected",
    [
        (b"- image", "the file has no keys"),
        (b"a: [1, 2\nb: 3", "line 2, column 2: expected ',' or ']'"),
        (b"a: b: c", "line 1, column 5: mapping values are not allowed here"),
        (b"a: \x01", "unacceptable character"),
        (b"a: 1\nb: {c: 1}\na: 2", "line 3, column 1: the key 'a' is there twice"),
        (b"a: {c: 1, c: 1}", "line 1, column 11: the key 'c' is there twice"),
        (b"a: 1\n---\nb: 2", "found another document"),
        (b"a: caf\xe9", "unacceptable character"),
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
    assert "the file cannot be read (Is a directory)" in message_of(tmp_path)
    assert "null" in message_of("a\0b")
