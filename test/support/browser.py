"""Debian's chromium without a window, driven by python3-selenium."""

import io
import shutil
import tempfile
import time

from PIL import Image

from support.helpers import Process, free_port, wait_for

SIZE = (1000, 700)
"""Of the window [pixel]."""

PERIOD = 0.1
"""[s] Between two questions to the browser, which cost time of the processor."""

FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-dev-shm-usage "
    "--disable-background-networking --disable-component-update --disable-sync "
    "--force-device-scale-factor=1"
)


def missing():
    """Return the Debian packages that are not installed."""
    programs = {"chromium": "chromium", "chromium-driver": "chromedriver"}
    found = [name for name, program in programs.items() if not shutil.which(program)]
    try:
        import selenium  # noqa: F401
    except ImportError:
        found.append("python3-selenium")
    return found


class Browser:
    """A browser with a page."""

    def __init__(self):
        from selenium import webdriver

        self._profile = tempfile.TemporaryDirectory()
        port = free_port()
        self._server = Process("chromedriver", f"--port={port}")
        options = webdriver.ChromeOptions()
        options.binary_location = shutil.which("chromium")
        profile = f"--user-data-dir={self._profile.name}"
        for flag in (*FLAGS.split(), profile, "--window-size={},{}".format(*SIZE)):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = None
        try:
            wait_for(lambda: "started successfully" in self._server.output, "chromedriver")
            url = f"http://127.0.0.1:{port}"
            self.driver = webdriver.Remote(command_executor=url, options=options)
        except BaseException:
            self.end()
            raise

    def end(self):
        if self.driver:
            self.driver.quit()
        self._server.end()
        self._profile.cleanup()

    def run(self, script, *arguments):
        """Run JavaScript in the page; return its result."""
        return self.driver.execute_script(script, *arguments)

    def wait(self, condition, what):
        """Wait for a true value of `condition`, which asks the browser."""
        try:
            return wait_for(lambda: condition() or time.sleep(PERIOD), what)
        except AssertionError as error:
            text = self.driver.find_element("tag name", "body").text
            raise AssertionError(f"{error}\n--- the page:\n{text}") from None

    def find(self, name):
        """Return the element with an id."""
        return self.driver.find_element("id", name)

    def text(self, name):
        return self.run("return document.getElementById(arguments[0]).textContent", name)

    def shows(self, name, part):
        """Wait until an element contains a text; return the whole text."""
        self.wait(lambda: part in self.text(name), f"{part!r} in the element {name}")
        return self.text(name)

    def pose(self):
        """Return the pose (x, y, theta) that the page shows, or None."""
        found = self.run("return window.mushr.pose")
        return found and (found["x"], found["y"], found["theta"])

    def actions(self):
        from selenium.webdriver.common.action_chains import ActionChains

        return ActionChains(self.driver)

    def choose(self, name, value):
        """Select an option of a list as a user does, and wait for the list."""
        script = """
            const [list, value] = [document.getElementById(arguments[0]), arguments[1]];
            if (![...list.options].some((each) => each.value === value)) return false;
            list.value = value;
            list.dispatchEvent(new Event("change"));
            return true;
        """
        self.wait(lambda: self.run(script, name, value), f"{value} in the list {name}")

    def picture(self, name=None):
        """Return a picture of the page, or of one element."""
        data = self.find(name).screenshot_as_png if name else self.driver.get_screenshot_as_png()
        return Image.open(io.BytesIO(data)).convert("RGB")


def colours(picture, tolerance=30):
    """Return a function from a colour #rrggbb to the number of pixels with about this colour."""
    counts = picture.getcolors(picture.width * picture.height)

    def count(colour):
        wanted = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
        return sum(
            number
            for number, pixel in counts
            if all(abs(a - b) <= tolerance for a, b in zip(pixel, wanted))
        )

    return count
