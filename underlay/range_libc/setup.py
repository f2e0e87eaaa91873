"""Install the module range_libc."""

from catkin_pkg.python_setup import generate_distutils_setup
from setuptools import setup

setup(**generate_distutils_setup(packages=["range_libc"], package_dir={"": "src"}))
