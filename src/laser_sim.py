#!/usr/bin/python3
"""Simulate the car's laser scanner in the map."""

from typing import Optional

import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan

from mushr_ros_intro.geometry import Pose, compose
from mushr_ros_intro.parameters import Values, integer, number
from mushr_ros_intro.ros import conversions, node
from mushr_ros_intro.simulator.car_parameters import FRAME_PREFIX
from mushr_ros_intro.stamps import NANOSECONDS, from_seconds
from mushr_ros_intro.world.laser import Beams, Laser, add_noise

ANGLE_MIN = "direction of the first beam; 0 is ahead, left is positive"


class LaserSim:
    """The laser scanner as a node.

    Subscribes to ``car_pose`` in the car's namespace and to /map. Publishes ``scan``: each scan is
    taken at a received pose and has its stamp.

    Example: ``rosrun mushr_ros_intro laser_sim.py __ns:=car _noise_std:=0.01``
    """

    PARAMETERS = (
        number("angle_min", Beams().angle_min, "rad", -6.3, 6.3, ANGLE_MIN),
        number(
            "angle_increment", Beams().angle_increment, "rad", 1e-4, 6.3, "angle between two beams"
        ),
        integer("beams", Beams().number, 1, 62832, "number; they cover less than a full turn"),
        number("range_min", Beams().range_min, "m", 0.0, 1e3, "shortest range"),
        number("range_max", Beams().range_max, "m", 0.0, 1e3, "longest range"),
        number("scan_rate", 10.0, "Hz", 0.1, 1e3, "at most that of the car's pose"),
        number("offset", 0.1227, "m", -10.0, 10.0, "from the rear axle forward to the laser"),
        number("noise_std", 0.0, "m", 0.0, 1e3, "standard deviation of the noise of each range"),
        integer("seed", 0, 0, 1e9, "seed of the noise"),
        FRAME_PREFIX,
    )

    def __init__(self, values: Values) -> None:
        self._beams = Beams(
            values["angle_min"],
            values["angle_increment"],
            values["beams"],
            values["range_min"],
            values["range_max"],
        )
        self._noise_std, self._seed = values["noise_std"], values["seed"]
        self._frame = values["frame_prefix"] + "laser_link"
        self._beams.check()
        self._period = from_seconds(1.0 / values["scan_rate"])
        self._mount = Pose(values["offset"], 0.0, 0.0)
        rospy.loginfo("%s", values.text)

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


if __name__ == "__main__":
    node.main("laser_sim", LaserSim)
