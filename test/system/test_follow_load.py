"""A controller drives equally under any load."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import pytest

from support.controllers import copy_controllers, follow

STYLES = [
    "three_threads",
    *(
        pytest.param(name, marks=pytest.mark.full)
        for name in ("loop", "answer", "timer", "explorer")
    ),
]


@pytest.mark.parametrize("name", STYLES)
def test_equal_drives(tmp_path, name):
    """Alone, and three at the same time beside two busy processes."""
    copy_controllers(tmp_path)
    alone = follow(name, tmp_path)
    assert alone.passed, alone.verdict
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    try:
        with ThreadPoolExecutor(3) as pool:
            others = list(pool.map(follow, 3 * [name], 3 * [tmp_path]))
    finally:
        for each in busy:
            each.kill()
    for each in others:
        assert each.drive.driven.tobytes() == alone.drive.driven.tobytes()
        assert each.verdict == alone.verdict
