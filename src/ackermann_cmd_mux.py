#!/usr/bin/python3
"""Select one of several command inputs for the car."""

from mushr_ros_intro.ros import node
from mushr_ros_intro.simulator.ackermann_cmd_mux import AckermannCmdMux

if __name__ == "__main__":
    node.main("ackermann_cmd_mux", AckermannCmdMux)
