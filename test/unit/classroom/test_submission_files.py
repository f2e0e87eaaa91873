"""Check that copied and unpacked submissions do not leave their folder, and are not too large."""

import os
import zipfile

import pytest

from mushr_ros_intro.errors import UserError
from support.submissions import (
    LINK,
    NODE,
    PACKAGE,
    PUBLISHER,
    collected,
    fill,
    inside,
    only,
    unchecked,  # noqa: F401
    zip_bytes,
    zipped,
)

pytestmark = pytest.mark.usefixtures("unchecked")


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"../x.py": NODE}, "has the entry '../x.py'"),
        ({"a/../../x.py": NODE}, "has the entry 'a/../../x.py'"),
        ({"/tmp/x.py": NODE}, "has the entry '/tmp/x.py'"),
        ({"C:\\x.py": NODE}, "has the entry 'C:"),
        ({"..\\x.py": NODE}, "has the entry '.."),
        ({f"{k}.txt": b"" for k in range(2001)}, "more than 2000 files"),
        ({"zeros": b"\0" * 50_000_001}, "more than 50 MB"),
        ({"a": NODE, "a/path_publisher.py": NODE}, "File exists"),
    ],
)
def test_zips_that_are_not_safe(tmp_path, files, said):
    found = only(tmp_path, zipped(tmp_path / "a.zip", files))
    assert said in found.fault and not os.path.exists(tmp_path / "workspace" / "a")


@pytest.mark.parametrize(
    ("files", "link"),
    [
        ({"a/link": b"../../secret"}, "a/link"),
        ({"link": b"/etc"}, "link"),
        ({"a": b".", "b": b"a/../secret"}, "b"),
    ],
)
def test_links_that_leave_the_folder_of_a_zip(tmp_path, files, link):
    found = only(tmp_path, zipped(tmp_path / "a.zip", files, mode=LINK))
    assert any(f"'{link}' is left out" in note for note in found.notes)
    assert not os.path.lexists(tmp_path / "workspace" / "a" / link)


def damage(data, place, value):
    """Overwrite bytes of the first entry in the central directory of a zip."""
    begin = data.index(b"PK\x01\x02") + place
    return data[:begin] + value + data[begin + len(value) :]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda data: data[:-30], "The zip cannot be read (File is not a zip file)"),
        (lambda data: b"", "The zip cannot be read"),
        (lambda data: data.replace(b"hello", b"hallo"), "The zip cannot be read (Bad CRC-32"),
        (lambda data: damage(data, 8, b"\1"), "is encrypted, password required"),
        (lambda data: damage(data, 10, b"\x09"), "compression method is not supported"),
        (lambda data: damage(data, 24, b"\1\0\0\0"), "The zip cannot be read"),  # size of the file
    ],
)
def test_zips_that_cannot_be_read(tmp_path, change, said):
    data = zip_bytes(tmp_path, {"path_publisher.py": NODE}, compression=zipfile.ZIP_STORED)
    (tmp_path / "a.zip").write_bytes(change(data))
    assert said in only(tmp_path, "a.zip").fault


def test_links_and_special_files(tmp_path):
    folder = tmp_path / "a"
    fill(tmp_path, {**inside("a"), "secret": b"x", "a/plans/p.txt": b""}, 0o700)
    os.symlink("../secret", folder / "secret")
    os.symlink(tmp_path, folder / "all")
    os.symlink("../plans", folder / "src" / "plans")
    os.mkfifo(folder / "pipe")
    os.chmod(folder / "plans", 0o700)
    old = os.umask(0o077)
    try:
        found = only(tmp_path, "a")
    finally:
        os.umask(old)
    top = tmp_path / "workspace" / "a"
    assert found.fault == "" and len(found.notes) == 3
    assert not os.path.lexists(top / "secret") and not os.path.lexists(top / "all")
    assert os.path.samefile(top / "src" / "plans" / "p.txt", top / "plans" / "p.txt")
    modes = {".": 0o755, "plans": 0o755, "plans/p.txt": 0o644, PUBLISHER: 0o755}
    assert {each: os.stat(top / each).st_mode & 0o7777 for each in modes} == modes
    os.mkdir(tmp_path / "class")
    os.mkfifo(tmp_path / "class" / "c.py")
    with pytest.raises(UserError, match="is not a submission"):
        collected(tmp_path, "class/c.py")


def test_large_folder(tmp_path):
    fill(tmp_path / "a", {**PACKAGE, "data": b"\0" * 50_000_000})
    assert "more than 50 MB" in only(tmp_path, "a").fault
