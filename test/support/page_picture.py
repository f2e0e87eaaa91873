"""Write an animated picture of the page that drives figure_8, for dev/screenshot."""

import os
import sys

from support import fork_server
from support.browser import Browser
from support.web import Simulation

SIZE = (1000, 763)
"""Of the window [pixel]; the page gets 143 pixels less in height."""

FACTOR = 0.5
"""Speed of simulated time: a picture of the page takes some tenths of a second."""

STEP = 0.25
"""Between two pictures [s of simulated time]."""

LAST = 3.0
"""Time for which the last picture is shown [s]."""


STAMP = "return window.mushr.pose.stamp"
"""Returns the stamp of the pose that the page shows [s]."""


def main(path):
    folder = os.getcwd()
    simulation = Simulation(folder, "use_sim_time:=true", f"real_time_factor:={FACTOR}")
    browser = Browser()
    try:
        browser.driver.set_window_size(*SIZE)
        browser.driver.get(simulation.url)
        browser.wait(lambda: browser.find("drive").is_enabled(), "the plan")
        browser.choose("plan", "figure_8")  # fits the view
        browser.find("drive").click()
        browser.shows("speed", "2.00 m/s")
        pictures = film(browser)
    finally:
        browser.end()
        simulation.end()
    stamps, images = zip(*pictures)
    seconds = [later - stamp for stamp, later in zip(stamps, stamps[1:])] + [LAST]
    durations = [round(1000 * each) for each in seconds]
    options = {"quality": 50, "method": 6, "minimize_size": True, "loop": 0}
    images[0].save(path, save_all=True, append_images=images[1:], duration=durations, **options)


def wait_for_stamp(browser, due):
    browser.wait(lambda: browser.run(STAMP) >= due, "later poses")


def film(browser):
    """Return the stamps [s] and the pictures of the page until it shows the result of the drive."""
    pictures = []
    is_over = False
    while not is_over:
        is_over = "difference" in browser.text("drive-state")
        pictures.append((browser.run(STAMP), browser.picture()))
        wait_for_stamp(browser, pictures[-1][0] + STEP)
    return pictures


if __name__ == "__main__":
    with fork_server.running():
        main(sys.argv[1])
