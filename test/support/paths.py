"""Folders of the package."""

import glob
import os
import shutil

PACKAGE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
CHECKOUT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.realpath(__file__))))
"""The same folder without symbolic links: a workspace can contain a link to it."""
PLANS = os.path.join(PACKAGE, "plans")
FIXTURES = os.path.join(PACKAGE, "test", "fixtures")


def copy_package(source, target):
    """Copy an example or a fixture, which is not executable here; return the path of the copy.

    In this package, rosrun would find an executable file, because it searches all subfolders.
    """
    shutil.copytree(source, target)
    for path in glob.glob(f"{target}/**/*", recursive=True):
        if os.path.isfile(path):
            with open(path, "rb") as file:
                if file.read(2) == b"#!":
                    os.chmod(path, 0o755)
    return target
