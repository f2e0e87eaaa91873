"""Write a picture of the page with the car in the middle of figure_8, for dev/screenshot."""

import os
import sys

from support.browser import Browser
from support.web import Simulation


def main(path):
    simulation = Simulation(os.getcwd())
    browser = Browser()
    try:
        browser.driver.set_window_size(1280, 1000)
        browser.driver.get(simulation.url)
        browser.wait(lambda: browser.find("drive").is_enabled(), "the plan")
        browser.find("drive").click()
        current = "return document.querySelector('#rows [aria-current]')?.rowIndex ?? 0"
        browser.wait(lambda: browser.run(current) >= 18, "the second loop")
        browser.picture().save(path, optimize=True)
    finally:
        browser.end()
        simulation.end()


if __name__ == "__main__":
    main(sys.argv[1])
