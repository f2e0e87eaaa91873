"""Try on this machine which attacks of a node the sandbox stops: grade.py --check-environment."""

import json
import os
import secrets
import shutil
import signal
import socket
import tempfile
from contextlib import suppress
from typing import Dict, List

from mushr_ros_intro.classroom import attacks
from mushr_ros_intro.classroom.attacks import LEAVE, REPEATED, Targets
from mushr_ros_intro.isolation import system_calls
from mushr_ros_intro.isolation.workspace import temporary_folder
from mushr_ros_intro.paths import package_folder
from mushr_ros_intro.plan.plan import Plan
from mushr_ros_intro.replay.job import Job, Setting, run_job
from mushr_ros_intro.replay.own_process import ReplayError

INSTALLED = ("/usr/lib/mushr_ros_intro", "/usr/share/doc/ros-mushr-ros-intro/examples")
"""Where Debian's packages have solutions."""


def check_environment(plan: Plan, setting: Setting) -> int:
    """Print which attacks the sandbox stops here; return 0 if it stops all, else 1.

    Raises:
        UserError, OSError: an attack could not be tried.
    """
    found = _try_attacks(plan, setting)
    for name, reached in found.items():
        print(f"NOT STOPPED  {name}: {reached}" if reached else f"stopped      {name}")
    missed = sum(map(bool, found.values()))
    print(f"{len(found) - missed} of {len(found)} attacks stopped")
    return int(missed > 0)


def _try_attacks(plan: Plan, setting: Setting) -> Dict[str, str]:
    """Return what each attack has reached, "" if it has been stopped; errors as above."""
    submission = os.path.join(setting.sandbox.folder, "attacks")
    program = os.path.join(submission, "path_publisher.py")
    os.mkdir(submission)
    os.chmod(submission, 0o755)
    shutil.copyfile(attacks.__file__, program)
    os.chmod(program, 0o755)
    token = os.environ["MUSHR_CHECK_ENVIRONMENT"] = secrets.token_hex(16)
    with socket.create_server(("127.0.0.1", 0)) as server, tempfile.TemporaryDirectory(
        dir=temporary_folder()
    ) as folder:
        os.chmod(folder, 0o755)
        secret = os.path.join(folder, "plan.txt")
        with open(secret, "w", encoding="ascii") as file:
            file.write("a hidden plan")
        os.chmod(secret, 0o666)
        package = package_folder(".")
        solutions = [f"{package}/src/path_publisher.py", f"{package}/examples", *INSTALLED]
        port, number = server.getsockname()[1], system_calls.number_of("add_key")
        targets = Targets(secret, ":".join(solutions), port, os.getpid(), token, number)
        with open(os.path.join(submission, "targets.json"), "w", encoding="utf-8") as file:
            json.dump(targets._asdict(), file)

        def run(name: str) -> str:
            job = Job("attacks", (program, name), plan, setting, submission)
            return run_job(job).recorded.output

        output = run("all")
        with suppress(ValueError, IndexError):
            found: Dict[str, str] = json.loads(output.splitlines()[-1])
            found[LEAVE] = " ".join(_end_survivors(token))
            for name, most in REPEATED.items():
                output = run(name)
                # When it is ended, Python may print an exception of a process that has just begun.
                *_, reached = (line for line in output.splitlines() if line[:1].isdigit())
                found[name] = reached if int(reached.split()[0]) > most else ""
            return found
    raise ReplayError(f"the attacks could not be tried: {output or 'they printed nothing'}")


def _end_survivors(token: str) -> List[str]:
    """End the processes that an attack has left behind, and return them."""
    found = []
    for process in filter(str.isdigit, os.listdir("/proc")):
        with suppress(OSError), open(f"/proc/{process}/cmdline", "rb") as file:
            if token.encode() in file.read():
                os.kill(int(process), signal.SIGKILL)
                found.append(f"process {process}")
    return found
