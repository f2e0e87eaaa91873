#!/usr/bin/python3
"""Simulate the car's laser scanner in the map."""

from typing import Optional

import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan

from mushr_ros_intro.geometry import Pose, compose
from mushr_ros_intro.parameters import Parameters
from mushr_ros_intro.ros import conversions, node
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds
from mushr_ros_intro.world.laser import Beams, Laser, add_noise

RATE = "rate of the scans, at most that of the car's pose"


class LaserSim:
    """The laser scanner as a node.

    Subscribes to ``car_pose`` in the car's namespace and to /map. Publishes ``scan``: each scan is
    taken at a received pose and has its stamp.

    Example: ``rosrun mushr_ros_intro laser_sim.py __ns:=car _noise_std:=0.01``
    """

    def __init__(self) -> None:
        with node.parameters() as parameters:
            self._beams = _beams_from(parameters)
            number = parameters.number
            rate = number("scan_rate", 10.0, "Hz", 0.1, 1e3, RATE)
            meaning = "distance from the rear axle forward to the laser"
            offset = number("offset", 0.1227, "m", -10.0, 10.0, meaning)
            meaning = "standard deviation of the noise of each range"
            self._noise_std = number("noise_std", 0.0, "m", 0.0, 1e3, meaning)
            self._seed = parameters.integer("seed", 0, 0, 1e9, "seed of the noise")
            self._frame = node.frame_prefix(parameters) + "laser_link"
        self._beams.check()
        self._period = from_seconds(1.0 / rate)
        self._mount = Pose(offset, 0.0, 0.0)
        rospy.loginfo("%s", parameters)

        self._laser: Optional[Laser] = None
        self._slot = 0

        self._scan_pub = rospy.Publisher("scan", LaserScan, queue_size=1, tcp_nodelay=True)
        self._map_sub = rospy.Subscriber(
            "/map", numpy_msg(OccupancyGrid), self._on_map, queue_size=1, buff_size=1 << 20
        )
        self._pose_sub = rospy.Subscriber(
            "car_pose", PoseStamped, self._on_pose, queue_size=1, tcp_nodelay=True
        )

    def run(self) -> None:
        """Scan until the node is shut down."""
        rospy.spin()

    @conversions.ignore_bad_messages
    def _on_map(self, msg: OccupancyGrid) -> None:
        grid = conversions.grid_from_msg(msg)
        self._laser = Laser(grid, self._beams)
        rospy.loginfo("scanning in a map of %d x %d cells", grid.width, grid.height)

    @conversions.ignore_bad_messages
    def _on_pose(self, msg: PoseStamped) -> None:
        """Publish a scan if this is the first pose of its period."""
        stamp = msg.header.stamp.to_nsec()
        laser, slot = self._laser, stamp // self._period
        if laser is None or slot == self._slot:
            return
        self._slot = slot
        if not self._scan_pub.get_num_connections():
            return
        pose = conversions.pose_from_msg(msg.pose)
        ranges = laser.scan(compose(pose, self._mount))
        if self._noise_std:
            ranges = add_noise(ranges, self._beams, self._noise_std, (self._seed, stamp))
        period = self._period / NANOSECONDS
        self._scan_pub.publish(
            conversions.scan_to_msg(ranges, self._beams, stamp, period, self._frame)
        )


def _beams_from(parameters: Parameters) -> Beams:
    default, number = Beams(), parameters.number
    meaning = "direction of the first beam; 0 is ahead, left is positive"
    angle_min = number("angle_min", default.angle_min, "rad", -6.3, 6.3, meaning)
    meaning = "angle between two beams"
    increment = number("angle_increment", default.angle_increment, "rad", 1e-4, 6.3, meaning)
    meaning = "number of beams; they cover less than a full turn"
    return Beams(
        angle_min,
        increment,
        parameters.integer("beams", default.number, 1, 62832, meaning),
        number("range_min", default.range_min, "m", 0.0, 1e3, "shortest range"),
        number("range_max", default.range_max, "m", 0.0, 1e3, "longest range"),
    )


if __name__ == "__main__":
    node.main("laser_sim", LaserSim)
