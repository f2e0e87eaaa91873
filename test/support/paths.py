"""The folders of the package that tests read."""

import os

PACKAGE = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
CHECKOUT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.realpath(__file__))))
"""The same folder without symbolic links: a test workspace links to it."""
PLANS = os.path.join(PACKAGE, "plans")
FIXTURES = os.path.join(PACKAGE, "test", "fixtures")
