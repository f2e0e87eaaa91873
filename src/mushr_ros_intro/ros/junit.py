"""Write the results of a test node for rostest."""

import os
from typing import Mapping, Optional
from xml.etree import ElementTree


def write_junit(
    path: str, node: str, failures: Mapping[str, Optional[str]], text: str = ""
) -> None:
    """Write a JUnit file. It is complete, or it does not exist, which rostest reports as an error.

    Args:
        path: of the file.
        node: the name of the test node.
        failures: by the name of each test case, why it has failed; None if it has passed.
        text: the output of the node.
    """
    count = sum(each is not None for each in failures.values())
    counts = {"tests": str(len(failures)), "failures": str(count), "errors": "0", "time": "0"}
    suite = ElementTree.Element("testsuite", {"name": node, **counts})
    for name, failure in failures.items():
        names = {"classname": node, "name": name, "time": "0"}  # rosunit reads the time
        case = ElementTree.SubElement(suite, "testcase", names)
        if failure is not None:
            ElementTree.SubElement(case, "failure", type="").text = failure
    ElementTree.SubElement(suite, "system-out").text = text
    ElementTree.ElementTree(suite).write(f"{path}.part", encoding="utf-8")
    os.replace(f"{path}.part", path)
