#!/usr/bin/python3
"""Simulate the car: a kinematic bicycle that follows commands and reports its pose."""

from mushr_ros_intro.ros import node
from mushr_ros_intro.simulator import sim_clock
from mushr_ros_intro.simulator.car_sim import CarSim

if __name__ == "__main__":
    node.check_arguments(CarSim)
    publishes_clock = sim_clock.has_to_publish_clock()
    # A node that publishes /clock must not use /clock as its own time.
    node.main("car_sim", CarSim, publishes_clock, disable_rostime=publishes_clock)
