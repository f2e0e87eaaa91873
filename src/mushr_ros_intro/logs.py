"""See to it that what a node says is seen."""

import os
import tempfile

import rospkg


def find_log_folder() -> None:
    """Have rospy log into the temporary folder where it cannot write into its own.

    Otherwise it would say nothing, not even on the terminal: where a home is read-only or full,
    nobody would hear why a node has ended.
    """
    folder = rospkg.get_log_dir()
    try:
        os.makedirs(folder, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return
    except OSError:
        other = os.path.join(tempfile.gettempdir(), f"ros_log_{os.getuid()}")
        os.environ[rospkg.environment.ROS_LOG_DIR] = other
