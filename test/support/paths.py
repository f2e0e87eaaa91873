"""Folders of the package."""

import os

PACKAGE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
CHECKOUT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.realpath(__file__))))
"""The same folder without symbolic links: a workspace can contain a link to it."""
PLANS = os.path.join(PACKAGE, "plans")
FIXTURES = os.path.join(PACKAGE, "test", "fixtures")
