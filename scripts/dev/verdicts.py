#!/usr/bin/python3
"""Measure whether verdicts depend on the load of the machine.

Grades the class of test/support/styles.py several times, idle, beside busy processes, or on one
core. Prints each node that is judged wrongly, or differently in two runs. Run it in scripts/shell:

    python3 scripts/dev/verdicts.py --runs 10
    python3 scripts/dev/verdicts.py --busy 8 --core
"""

import argparse
import fnmatch
import os
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor

CHECKOUT = os.path.abspath(os.path.join(os.path.dirname(__file__), "../.."))
sys.path.insert(0, os.path.join(CHECKOUT, "test"))

from mushr_ros_intro.errors import UserError  # noqa: E402
from mushr_ros_intro.isolation.sandbox import Sandbox  # noqa: E402
from mushr_ros_intro.isolation.workspace import inherited  # noqa: E402
from mushr_ros_intro.plan.parse import read_plan  # noqa: E402
from mushr_ros_intro.replay.job import Job, run_job  # noqa: E402
from mushr_ros_intro.replay.setting import read_setting  # noqa: E402
from support import styles  # noqa: E402

BUSY = "while True: pass"


def grade(name, folder, plan, setting):
    """Return the name of a node, a letter for each check, the drive, and the failed checks.

    The letters are: . passed, F failed, - not judged.
    """
    path = os.path.join(folder, name, "path_publisher.py")
    try:
        judgement = run_job(Job(name, (path,), plan, setting))
    except UserError as error:
        return name, str(error), "", []
    failed = [each.name for each in judgement.checks if each.is_judged and not each.passed]
    letters = "".join("-F."[each.is_judged + each.passed] for each in judgement.checks)
    sent = judgement.recorded.sent
    commands = [(each.arrived - sent[0].arrived, each.time - each.arrived, each) for each in sent]
    return name, letters, str(commands and [each[:2] + each[2].values for each in commands]), failed


def is_expected(name, failed):
    """Return whether the failed checks are those that the class expects."""
    kind, _, style = name.partition("_")
    return not failed if kind == "right" else styles.WRONG[style][1] in failed


def measure(names, folder, options):
    """Grade the class; return the number of nodes whose verdict is wrong or differs."""
    plan = read_plan(os.path.join(folder, "plan.txt"))
    others = {"remap": (), "tolerances": {}}
    setting = read_setting(CHECKOUT, "ideal", "none", **others, sandbox=Sandbox(), ros=inherited())
    seen = {name: set() for name in names}
    drives = {name: set() for name in names}
    wrong = set()
    for run in range(options.runs):
        began = time.monotonic()
        with ThreadPoolExecutor(options.jobs) as pool:
            for name, letters, drive, failed in pool.map(
                lambda name: grade(name, folder, plan, setting), names
            ):
                seen[name].add(letters)
                drives[name].add(drive)
                if not is_expected(name, failed):
                    wrong.add(name)
        print(f"run {run + 1}: {time.monotonic() - began:.0f} s", flush=True)
    faults = [name for name in names if name in wrong or len(seen[name]) > 1]
    for name in faults:
        print(f"{name}: {' '.join(sorted(seen[name]))}")
    several = [name for name in names if len(drives[name]) > 1]
    print(f"different drives: {' '.join(several) or 'none'}")
    print(f"{len(names)} nodes, {options.runs} runs: {len(faults)} judged wrongly or differently")
    return len(faults)


def main():
    """Return 0 if all verdicts are as expected, and equal in all runs, else 1."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("patterns", nargs="*", default=["*"], help="names, such as 'right_*'")
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=4, help="simultaneous replays")
    parser.add_argument("--busy", type=int, default=0, help="number of busy processes")
    parser.add_argument("--core", action="store_true", help="run everything on one core")
    options = parser.parse_args()
    if options.core:
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    with tempfile.TemporaryDirectory() as folder:
        styles.write(folder)
        found = (fnmatch.filter(sorted(os.listdir(folder)), each) for each in options.patterns)
        names = list(dict.fromkeys(name for group in found for name in group))
        with open(os.path.join(folder, "plan.txt"), "w", encoding="ascii") as file:
            file.write(styles.PLAN)
        busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(options.busy)]
        try:
            return int(measure(names, folder, options) > 0)
        finally:
            for each in busy:
                each.kill()
                each.wait()


if __name__ == "__main__":
    sys.exit(main())
