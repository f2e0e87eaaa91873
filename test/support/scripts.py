"""Code of the tests of scripts/."""

import os

import pytest

from support.paths import CHECKOUT

needs_workspace = pytest.mark.skipif(
    not os.path.exists(f"{CHECKOUT}/build/.workspace/sources"),
    reason="scripts/setup has not built here, and a test does not install anything",
)


def add_programs(folder, names, script="exit 3"):
    """Write shell scripts with these names into a new folder."""
    folder.mkdir()
    for name in names:
        (folder / name).write_text(f"#!/bin/sh\n{script}\n")
        (folder / name).chmod(0o755)
