"""Tell catkin where the package's modules are; run by CMake, not by hand."""

from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(**generate_distutils_setup(packages=["mushr_ros_intro"], package_dir={"": "src"}))
