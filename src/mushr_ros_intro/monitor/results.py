"""Write the result of a drive for rostest."""

import os
from xml.etree import ElementTree

from mushr_ros_intro.monitor.verdict import Verdict


def write_result(path: str, verdict: Verdict) -> None:
    """Write a JUnit file with one test case. It is complete, or it does not exist."""
    counts = {"tests": "1", "failures": str(int(not verdict.is_good)), "errors": "0", "time": "0"}
    suite = ElementTree.Element("testsuite", {"name": "drive_monitor", **counts})
    names = {"classname": "drive_monitor", "name": "drive", "time": "0"}
    case = ElementTree.SubElement(suite, "testcase", names)
    if not verdict.is_good:
        ElementTree.SubElement(case, "failure", type="").text = "\n".join(verdict.lines)
    ElementTree.ElementTree(suite).write(f"{path}.part", encoding="utf-8")
    os.replace(f"{path}.part", path)
