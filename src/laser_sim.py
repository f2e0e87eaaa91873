#!/usr/bin/python3
"""Simulate the car's laser scanner in the map."""

from typing import Optional

import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan

from mushr_ros_intro.geometry import Pose, compose
from mushr_ros_intro.ros import conversions, node
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds
from mushr_ros_intro.world.laser import Beams, Laser, add_noise


class LaserSim:
    """The laser scanner as a node.

    Subscribes to ``car_pose`` in the car's namespace and to /map. Publishes ``scan``: each scan is
    taken at a received pose and has its stamp.
    """

    def __init__(self) -> None:
        parameters = node.parameters()
        default = Beams()
        number, integer = parameters.number, parameters.integer
        self._beams = Beams(
            angle_min=number("angle_min", default.angle_min, "rad", -6.3, 6.3),
            angle_increment=number("angle_increment", default.angle_increment, "rad", 1e-4, 6.3),
            number=integer("beams", default.number, 1, 62832),
            range_min=number("range_min", default.range_min, "m", 0.0, 1000.0),
            range_max=number("range_max", default.range_max, "m", 0.0, 1000.0),
        )
        self._beams.check()
        self._period = from_seconds(1.0 / number("scan_rate", 10.0, "Hz", 0.1, 1000.0))
        self._mount = Pose(number("offset", 0.1227, "m", -10.0, 10.0), 0.0, 0.0)
        self._noise_std = number("noise_std", 0.0, "m", 0.0, 1000.0)
        self._seed = integer("seed", 0, 0, 1e9)
        rospy.loginfo("%s", parameters)
        prefix = rospy.get_namespace().strip("/")
        self._frame = f"{prefix}/laser_link".lstrip("/")

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
        """Use this map for the following scans."""
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


if __name__ == "__main__":
    node.main("laser_sim", LaserSim)
