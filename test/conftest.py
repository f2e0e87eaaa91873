"""The fork server for all tests, and a ROS system for each module that defines `start_world`."""

import pytest

from support import fork_server


def pytest_configure(config):
    """Describe the mark; see scripts/dev/run_tests."""
    config.addinivalue_line("markers", "full: only with scripts/test --all")


@pytest.fixture(scope="session", autouse=True)
def _fork_server():
    with fork_server.running():
        yield


@pytest.fixture(scope="module", autouse=True)
def _world(request, _fork_server):
    """Run the ROS system of a test module: the nodes that its function `start_world` starts."""
    start = getattr(request.module, "start_world", None)
    if not start:
        yield
        return
    from support import world

    with world.running(start):
        yield
