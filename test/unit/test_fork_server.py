"""Check that a program in a fork behaves like a program of its own."""

import os
import signal
import sys

import pytest

from support.helpers import ForkedProcess, Process, wait_for

PROGRAMS = {
    "returns": "print('done')",
    "exits": "import sys\nprint('three')\nsys.exit(3)",
    "exits with a message": "import sys\nsys.exit('a reason')",
    "fails": "raise ValueError('a fault')",
    "kills itself": "import os, signal\nprint('x')\nos.kill(os.getpid(), signal.SIGKILL)",
    "has arguments": "import sys\nprint(sys.argv[1:], __name__)",
    "has an environment": "import os\nprint(os.environ['COLOUR'], 'ROS_NAMESPACE' in os.environ)",
    "leads a session": "import os\nprint(os.getsid(0) == os.getpid(), os.getcwd())",
    "reads": "import sys\nprint(sys.stdin.read() == '')",
    "ends its threads": "import threading\nmain = threading.main_thread()\n"
    "threading.Thread(target=lambda: (main.join(), print('late'))).start()\nprint('soon')",
    "runs code at the end": "import atexit\natexit.register(print, 'the end')",
    "imports rospy": "import sys\nprint('rospy' in sys.modules)\nimport rospy\n"
    "print(rospy.names.get_mappings())",
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_same_as_a_process(tmp_path, name):
    path = tmp_path / "program.py"
    path.write_text(PROGRAMS[name])
    ends = []
    for command, start in (((path,), ForkedProcess), ((sys.executable, path), Process)):
        process = start(*map(str, command), "_a:=1", "b:=c", COLOUR="red")
        status, lines = process.wait(), process.output.splitlines()
        ends.append((status, lines[-1:] if "Traceback" in process.output else lines))
    assert ends[0] == ends[1]


def test_signals(tmp_path):
    path = tmp_path / "program.py"
    # A long sleep would be wrong: Python does not notice a SIGINT that comes just before the sleep.
    path.write_text("import time\nprint('ready')\nwhile True:\n    time.sleep(0.01)")
    for number, status in ((signal.SIGTERM, -signal.SIGTERM), (signal.SIGINT, -signal.SIGINT)):
        process = ForkedProcess(str(path))
        assert process.running
        wait_for(lambda p=process: "ready" in p.output, "the program to start")
        os.kill(process.pid, number)
        assert process.wait() == status
