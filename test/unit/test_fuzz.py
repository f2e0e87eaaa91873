"""Feed some random bytes to everything that reads files; scripts/dev/fuzz feeds many."""

import pytest

from support.helpers import Process
from support.paths import CHECKOUT

pytestmark = pytest.mark.full


def test_each_kind():
    with Process(f"{CHECKOUT}/scripts/dev/fuzz", "--runs", "30") as process:
        assert process.wait() == 0, process.output
    assert process.output.count(" accepted, ") == 9, process.output
