"""Programs that cannot be started, each as a file."""

import os

import pytest

from mushr_ros_intro.doctor.programs import program_findings

START = "#!/usr/bin/python3\n"


@pytest.mark.parametrize(
    "text, mode, words",
    [
        ("import rospy\nrospy.init_node('a')\n", 0o755, "does not start with a shebang line. Make"),
        ("#!/usr/bin/env no_such_python\n", 0o755, "interpreter 'no_such_python', which is not"),
        ("#!/no/such/python\n", 0o755, "interpreter '/no/such/python'"),
        ("#!/no/such/env python3\n", 0o755, "interpreter '/no/such/env'"),
        ("#!\n", 0o755, "interpreter ''"),
        (" #!/usr/bin/python3\n", 0o755, "has blanks or empty lines before '#!'. Delete"),
        ("\n#!/usr/bin/python3\n", 0o755, "has blanks or empty lines before '#!'. Delete"),
        ("#!/bin/bash\n", 0o755, "interpreter '/bin/bash', which is not Python. Make its first"),
        ("#!/usr/bin/python3\r\n", 0o755, r"has Windows line ends (CRLF), so its first line does"),
        ("\ufeff#!/usr/bin/python3\n", 0o755, r"a byte order mark, so its first line does not"),
        ("#!/usr/bin/python3\n# \udcfc\n", 0o755, "is not UTF-8 in line 2. Save it as UTF-8"),
        ("#!/usr/bin/python3\nprint(\n", 0o755, "has a syntax error in line 2: "),
        ("#!/usr/bin/python3\nprint 'a'\n", 0o755, ". Correct this line, or the one before it"),
        ("#!/usr/bin/python3\n", 0o644, "is not executable. Type: chmod +x '"),
        (
            "#!/usr/bin/python3\nimport no_such\n",
            0o755,
            "imports no_such in line 2, but Python does not find this module. Correct the name, or "
            "install the module; for one of ROS, type: sudo apt-get install python3-no-such",
        ),
        (f"{START}from ackerman_msgs.msg import Drive\n", 0o755, "Did you mean ackermann_msgs?"),
        (
            f"{START}import tf.transformation\n",
            0o755,
            "does not find this module. Correct the name",
        ),
    ],
)
def test_a_program_that_cannot_be_started(tmp_path, text, mode, words):
    path = tmp_path / "my drive.py"
    path.write_bytes(text.encode(errors="surrogateescape"))
    path.chmod(mode)
    (finding,) = map(str, program_findings(str(tmp_path)))
    assert finding.startswith(f"{path} ")
    assert words in finding


def test_the_first_line_and_the_mode(tmp_path):
    """Both are reported at once."""
    path = tmp_path / "drive.py"
    path.write_bytes(b"#!/usr/bin/python3\r\n")
    first, second = map(str, program_findings(str(tmp_path)))
    assert "has Windows line ends" in first
    assert second == f"{path} is not executable. Type: chmod +x {path}"


def test_an_interpreter_without_rospy(tmp_path, monkeypatch):
    folder = tmp_path / "pyenv"
    folder.mkdir()
    interpreter = folder / "python3"
    interpreter.write_text("#!/bin/sh\nexit 1\n")
    interpreter.chmod(0o755)
    monkeypatch.setenv("PATH", str(folder), prepend=os.pathsep)
    for name, program in (("drive.py", "python3"), ("run", "bash")):
        (tmp_path / name).write_text(f"#!/usr/bin/env {program}\n")
        (tmp_path / name).chmod(0o755)
    (finding,) = map(str, program_findings(str(tmp_path)))
    assert finding == (
        f"{tmp_path}/drive.py names the interpreter 'python3', which is {interpreter} in this "
        "terminal and cannot import rospy. Make its first line: #!/usr/bin/python3"
    )


def test_an_editor_that_appends_txt(tmp_path):
    path = tmp_path / "drive.py.txt"
    path.write_text("#!/usr/bin/python3\n")
    (finding,) = map(str, program_findings(str(tmp_path)))
    assert finding.startswith(f"{path} has the ending .txt, ")
    assert finding.endswith(f"Type: mv {path} {tmp_path}/drive.py")


def test_a_program_that_catkin_has_installed(tmp_path):
    """rosrun starts the installed program, so the one in the folder need not be executable."""
    folder, installed = tmp_path / "student", tmp_path / "lib" / "drive.py"
    folder.mkdir()
    path = folder / "drive.py"
    path.write_text("#!/usr/bin/python3\r\n")
    installed.parent.mkdir()
    installed.write_text("#!/usr/bin/python3\n")
    installed.chmod(0o755)
    nodes = {"drive.py": [str(path), str(installed)]}
    assert program_findings(str(folder), find_node=nodes.get) == []
    installed.chmod(0o644)
    (finding,) = map(str, program_findings(str(folder), find_node=nodes.get))
    assert finding == f"{installed} is not executable. Type: chmod +x {installed}"


def test_a_folder_that_hides_a_module(tmp_path):
    """Hiding files, and what rospy imports: test_submission_check."""
    folder = tmp_path / "geometry_msgs"
    folder.mkdir()
    (folder / "__init__.py").touch()
    path = tmp_path / "drive.py"
    path.write_text("#!/usr/bin/python3\nfrom geometry_msgs.msg import Point\n")
    path.chmod(0o755)
    (finding,) = map(str, program_findings(str(tmp_path)))
    assert finding.startswith(
        f"{folder}/__init__.py hides the module geometry_msgs of Python or ROS"
    )
    assert finding.endswith("Give it another name")


def test_files_that_hide_nothing(tmp_path):
    """The node does not need this module of Python; a folder without __init__.py hides nothing."""
    (tmp_path / "turtle.py").write_text("")
    (tmp_path / "geometry_msgs").mkdir()
    path = tmp_path / "drive.py"
    path.write_text("#!/usr/bin/python3\nimport math\n")
    path.chmod(0o755)
    assert program_findings(str(tmp_path)) == []


@pytest.mark.parametrize(
    "name, text",
    [
        ("drive.py", "#!/usr/bin/python3 -u\n"),
        ("drive", "#! /usr/bin/env -S python3 -u\n"),
        ("module.py", "import math\n"),
        ("setup.py", "if __name__ == '__main__':\n    pass\n"),
        (
            "drive.py",
            "#!/usr/bin/python3\ntry:\n    import faster\nexcept ImportError:\n    pass\n",
        ),
        ("drive.py", "#!/usr/bin/python3\nfrom os import path\nfrom concurrent import futures\n"),
        ("drive.py", "#!/usr/bin/python3\nfrom mushr_ros_intro.ros import node\n"),
    ],
)
def test_no_finding(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    path.chmod(0o755 if text.startswith("#!") else 0o644)
    assert program_findings(str(tmp_path)) == []
    assert program_findings(str(tmp_path / "none")) == []
