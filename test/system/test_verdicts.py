"""Check that the load of the machine does not change a verdict."""

import sys

import pytest

from support.helpers import Process
from support.paths import CHECKOUT

# Without right_thread_*: their final pose depends on which of two threads wakes up first, see
# docs/grading.md.
PATTERNS = (
    *("right_plain", "right_sleep*", "right_time_sleep", "right_perf_counter", "right_timer"),
    *("right_on_pose", "right_poll_rate", "right_while_sleep"),
    *("wrong_burst*", "wrong_wall_stamps", "wrong_hz_20", "wrong_sleep_150", "wrong_segfault"),
)


@pytest.mark.full
def test_equal_verdicts_beside_busy_processes():
    program = (f"{CHECKOUT}/scripts/dev/verdicts.py", "--runs", "2", "--busy", "4")
    with Process(sys.executable, *program, *PATTERNS) as process:
        assert process.wait(600.0) == 0, process.output
