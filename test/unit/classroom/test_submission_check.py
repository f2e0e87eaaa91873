"""Check that a node that cannot be run is found before it runs."""

import os

import pytest

from mushr_ros_intro import program_file
from mushr_ros_intro.isolation import workspace
from support.submissions import NODE, PACKAGE, PUBLISHER, XML, fill, only, zipped

CMAKE = b"PROJECT(intro)\nfind_package(catkin)\ncatkin_package(\n  DEPENDS # add_library(x)\n)\n"
NAMED = "#!/usr/bin/env {}\n".format
SEVERAL = "several files path_publisher.py"


@pytest.mark.parametrize(
    ("files", "said"),
    [
        (
            {"README.md": b"", "a.tar": b""},
            "There is no path_publisher.py; found 'README.md', 'a.t",
        ),
        ({"package.xml": XML, "src/talker.py": NODE}, "found 'src/talker.py', 'package.xml'"),
        ({"a/path_publisher.py": NODE, "b/path_publisher.py": NODE + b"#"}, f"{SEVERAL}: 'a/"),
        ({**PACKAGE, "scripts/path_publisher.py": NODE + b"#"}, f"{SEVERAL}: 'scr"),
        (
            {"package.xml": XML, "src/path_publisher.cpp": b""},
            "'src/path_publisher.cpp'. Hand in a",
        ),
        (
            {"src/a.py": NODE, "test/path_publisher.py": NODE},
            "There is no path_publisher.py; found",
        ),
        ({"path_publisher.ipynb": b"{}"}, "found 'path_publisher.ipynb'. Hand in a package"),
        ({**PACKAGE, "package.xml": b"<package>"}, "'package.xml' is not valid XML: no element"),
        (
            {**PACKAGE, "package.xml": b"<package/>"},
            "'package.xml' has no name; expected <package>",
        ),
        ({**PACKAGE, "package.xml": "<!DOCTYPE a><a/>".encode("utf-16")}, "or a DOCTYPE"),
        (
            {PUBLISHER: b"print(1)\n"},
            "does not start with a shebang line. Make its first line: #!/usr/b",
        ),
        ({PUBLISHER: NAMED("python3.99").encode()}, "interpreter 'python3.99', which is not inst"),
        ({PUBLISHER: b"#!python\n"}, "the interpreter 'python', which is not installed"),
        ({PUBLISHER: NAMED("python3 -u").encode()}, "the interpreter 'python3 -u', which is not"),
        ({PUBLISHER: NODE + b"x = '\0'\n"}, "null bytes"),
        ({PUBLISHER: b"#!/usr/bin/python3\n# coding: rot13\n"}, "not a text encoding"),
        ({PUBLISHER: NODE + b"x = " + b"-" * 100_000 + b"1\n"}, "too complex to compile"),
        ({PUBLISHER: NODE + b"#" * 1_000_000}, "more than 1 MB"),
    ],
)
def test_faults(tmp_path, monkeypatch, files, said):
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "python3").symlink_to("/usr/bin/python3")
    monkeypatch.setenv("PATH", str(tmp_path / "bin"))
    found = only(tmp_path, zipped(tmp_path / "a.zip", files))
    assert said in found.fault


def test_a_node_that_is_compiled_for_ever(tmp_path, monkeypatch):
    """Only the processor time counts, so the load of the machine is no fault of a submission."""
    endless = program_file.COMPILE.replace("compile(", "while True: pass #")
    monkeypatch.setattr(program_file, "COMPILE", endless)
    monkeypatch.setattr(program_file, "COMPILE_TIME", 1)
    found = only(tmp_path, zipped(tmp_path / "a.zip", PACKAGE))
    assert found.fault.endswith("is too complex to compile. Expected a program in Python.")


def test_a_package_with_the_name_test(tmp_path):
    """Its node is no test."""
    files = {f"test/{name}": content for name, content in PACKAGE.items()}
    assert not only(tmp_path, zipped(tmp_path / "a.zip", files)).fault


@pytest.mark.parametrize(
    "source",
    [
        NAMED("python3").encode(),
        b"#!/usr/bin/python\n",  # python-is-python3 may be missing here
        NAMED("-S -i A=1 python3 -u").encode(),
        b"#! /usr/bin/python3 -u \n",
        b"#!/usr/bin/env python\n",
        b"#!/bin/env -S python -u\n",
        b"#!/usr/bin/python3\n# coding: latin-1\n# \xfc\nprint('\\d')\n",
        b"#!/usr/bin/python3\nprint(1)\r\n",
    ],
)
def test_first_lines_that_work(tmp_path, monkeypatch, source):
    """If the machine that grades has no program `python`, a replay runs Python 3."""
    monkeypatch.setenv("PATH", "/usr/bin:/bin")
    assert only(tmp_path, zipped(tmp_path / "a.zip", {PUBLISHER: source})).fault == ""


@pytest.mark.parametrize(("version", "said"), [("python3.9", ""), ("python2.7", "not Python 3")])
def test_the_interpreter_is_that_of_the_node(tmp_path, monkeypatch, version, said):
    """Shims such as those of pyenv come first on the PATH of the grader, but are not for nodes."""
    for folder, target in (("shims", "/bin/false"), ("system", version)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "python").symlink_to(target)
    (tmp_path / "system" / version).write_text("#!/bin/false\n")
    (tmp_path / "system" / version).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}/shims:{tmp_path}/system")
    monkeypatch.setattr(workspace, "SYSTEM", (f"{tmp_path}/system/",))
    found = only(tmp_path, zipped(tmp_path / "a.zip", {PUBLISHER: NAMED("python").encode()}))
    assert said in found.fault and bool(found.fault) == bool(said)
    assert workspace.environment_of({})["PATH"] == f"{tmp_path}/system"


def test_a_file_that_hides_a_module(tmp_path):
    """It is a note: the node may work nevertheless."""
    files = {**PACKAGE, "src/random.py": b"", "src/turtle.py": b""}
    found = only(tmp_path, zipped(tmp_path / "a.zip", files))
    assert found.fault == ""
    (note,) = found.notes
    assert note.startswith("src/random.py hides the module random of Python or ROS")


@pytest.mark.parametrize("other", ["scripts/path_publisher.py", "test/path_publisher.py"])
def test_equal_copies_and_tests_are_no_second_node(tmp_path, other):
    content = NODE if other.startswith("s") else NODE + b"#"
    found = only(tmp_path, zipped(tmp_path / "a.zip", {**PACKAGE, other: content}))
    assert found.fault == "" and os.path.basename(found.command[0]) == "path_publisher.py"
    assert not found.command[0].endswith("test/path_publisher.py")


@pytest.mark.parametrize("how", [{"mode": 0o644}, {"mode": 0}, {"system": 0}])
def test_nodes_that_are_not_executable(tmp_path, how):
    """They are made executable, and the author learns how to do it."""
    for files, note in (
        (PACKAGE, "chmod +x src/"),
        ({"path_publisher.py": NODE}, "no package.xml"),
    ):
        found = only(tmp_path, zipped(tmp_path / f"{note[0]}.zip", files, **how))
        assert note in found.notes[-1]
        assert os.stat(found.command[0]).st_mode & 0o777 == 0o755


@pytest.mark.parametrize(
    ("text", "needs"),
    [
        (CMAKE, False),
        (CMAKE + b"#[[\nadd_library(x)\n]]\ninstall(FILES a)", False),
        (CMAKE + b"  ADD_MESSAGE_FILES (FILES A.msg)", True),
        (CMAKE + b"catkin_python_setup()", False),
    ],
)
def test_needs_build(tmp_path, text, needs):
    fill(tmp_path / "a", {**PACKAGE, "CMakeLists.txt": text})
    assert only(tmp_path, "a").needs_build == needs
