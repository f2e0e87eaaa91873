"""Check who may use the server."""

import pytest

from mushr_ros_intro.browser.access import refusal


@pytest.mark.parametrize(
    ("host", "origin", "token"),
    [
        ("localhost:9090", None, None),
        ("127.0.0.1:9090", "http://127.0.0.1:9090", None),
        ("[::1]:9090", "http://[::1]:9090", None),
        ("localhost", "http://localhost", "wrong"),
        ("lab.example:9090", "http://lab.example:9090", None),
        ("localhost:9090", "http://evil.com", "secret"),
    ],
)
def test_allowed(host, origin, token):
    assert not refusal(host, origin, token, ["Lab.example"], "secret")


@pytest.mark.parametrize(
    ("host", "origin", "token", "message"),
    [
        (None, None, None, "the host '' is not a name of this server"),
        ("[", None, None, "the host '' is not a name of this server"),
        ("evil.com:9090", None, None, "the host 'evil.com' is not a name of this server"),
        ("evil.com", "http://evil.com", "secret", "the host 'evil.com' is not a name of"),
        ("localhost.evil.com", None, None, "the host 'localhost.evil.com' is not a name of"),
        ("localhost:9090", "http://evil.com", None, "pages of 'http://evil.com' may not use this"),
        ("localhost:9090", "http://localhost:8080", "s\u00e9", "pages of 'http://localhost:8080'"),
        ("localhost:9090", "https://localhost:9090", None, "pages of 'https://localhost:9090'"),
        ("localhost:9090", "null", None, "pages of 'null' may not use this server"),
        ("localhost:9090", "", None, "pages of '' may not use this server"),
    ],
)
def test_refused(host, origin, token, message):
    assert refusal(host, origin, token, ["Lab.example"], "secret").startswith(message)
