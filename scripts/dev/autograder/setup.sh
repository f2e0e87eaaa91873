#!/bin/bash
# Gradescope runs this script as root, once, when it builds the image. It runs no submission.
set -eu
umask 022
package=/opt/mushr_ros_intro
source=/autograder/source/mushr_ros_intro
if [ ! -d "$source" ]; then
  echo "setup.sh: this script is for Gradescope's image, in which $source exists" >&2
  exit 2
fi

# Nodes run as users without rights. They must not read /autograder/source, which contains hidden plans, and
# need nothing of this package.
rm -rf "$package"
cp -r "$source" "$package"
"$package/scripts/setup"
# Otherwise each run in a new container would compile the modules again.
/usr/bin/python3 -m compileall -q "$package/src" "$package/build/.workspace/devel/lib"
chmod o= /autograder/source "$package"
