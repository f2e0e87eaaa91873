"""Write the drive of a replay as a bag, for rviz and Foxglove."""

from typing import Sequence

from mushr_ros_intro.car.model import Command, State, at_rest
from mushr_ros_intro.car.odometry import Odometer
from mushr_ros_intro.geometry import Pose
from mushr_ros_intro.replay.judge import Judgement
from mushr_ros_intro.ros import conversions
from mushr_ros_intro.stamps import from_seconds

FRAMES = ("car/odom", "car/base_footprint")


def write_bag(path: str, judgement: Judgement, states: Sequence[State]) -> None:
    """Write a bag, compressed with lz4: the map, both paths, poses, frames and commands.

    Args:
        path: of the bag.
        judgement: on the replay.
        states: the states of the car that were reported.

    Raises:
        OSError: the file cannot be written.
    """
    import rosbag  # slow, because it imports encryption, and rarely needed

    begin = states[0].stamp
    with rosbag.Bag(path, "w", compression="lz4") as bag:

        def add(topic: str, msg: object, stamp: int) -> None:
            bag.write(topic, msg, conversions.time_from(stamp))

        if judgement.recorded.grid is not None:
            grid = judgement.recorded.grid
            add("/map", conversions.grid_to_msg(grid, begin, conversions.MAP_FRAME), begin)
        times, poses = judgement.drive.times.tolist(), judgement.drive.predicted.tolist()
        predicted = [at_rest(from_seconds(t), Pose(*pose)) for t, pose in zip(times, poses)]
        add("/car/predicted_path", conversions.path_to_msg(predicted, begin), begin)
        driven = conversions.path_to_msg([s._replace(stamp=s.stamp - begin) for s in states], begin)
        add("/car/driven_path", driven, begin)
        odometer = Odometer(judgement.recorded.car)
        for state in states:
            measured = odometer.read(state)
            add("/car/car_pose", conversions.car_pose_to_msg(state), state.stamp)
            add("/tf", conversions.transforms_to_msg(measured.state, *FRAMES), state.stamp)
            add("/car/odom", conversions.odometry_to_msg(measured, *FRAMES), state.stamp)
        for sent in judgement.recorded.sent:
            command = Command(sent.time, sent.speed, sent.steering_angle)
            msg = conversions.command_to_msg(command, FRAMES[1])
            add("/car/mux/ackermann_cmd_mux/input/navigation", msg, max(begin, sent.time))
