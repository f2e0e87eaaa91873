"""The settings of hypothesis for all unit tests."""

from hypothesis import HealthCheck, settings

collect_ignore_glob = ["*_test.py"]  # rostests

# Use the same examples in every run, write no file, and accept a slow machine.
settings.register_profile(
    "repeatable",
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("repeatable")
