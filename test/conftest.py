"""What every unit test shares: how hypothesis draws its examples."""

from hypothesis import HealthCheck, settings

collect_ignore_glob = ["*_test.py"]  # the nodes of the rostests

# The same examples in every run, no file written, and no verdict on how fast the machine is.
settings.register_profile(
    "repeatable",
    derandomize=True,
    database=None,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("repeatable")
