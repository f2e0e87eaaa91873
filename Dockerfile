# The simulated car in a container: see docs/install.md. The default target is full, which also builds and
# tests; the target slim only runs.
FROM debian:12 AS base
# Leave out large files that nothing here needs: documentation except licences, static libraries, the headers of
# boost, cpack, sanitizers, link-time optimisation, and below, the unit tests of Python packages. To build nodes in
# C++, delete this file, and reinstall.
RUN printf 'path-exclude=/usr/%s\n' 'share/doc/*' 'share/info/*' 'share/locale/*' 'share/man/*' \
    'share/unicode/*' 'include/boost/*' 'lib/gcc/*/lto1' 'bin/*-lto-dump-*' 'bin/cpack' 'lib/*/lib*san.*' \
    'lib/*/libboost*.a' 'lib/*/libicu*.a' 'lib/*/libpython*.a' 'lib/*blas*/*.a' >/etc/dpkg/dpkg.cfg.d/small && \
    echo 'path-include=/usr/share/doc/*/copyright' >>/etc/dpkg/dpkg.cfg.d/small
COPY scripts/dev/packages /opt/
RUN . /opt/packages && apt-get -q update && \
    DEBIAN_FRONTEND=noninteractive apt-get -q -y install --no-install-recommends $runtime_packages && \
    find /usr/lib/python3 -depth -path '*/tests/*' -delete && apt-get clean && rm -rf /var/lib/apt/lists/*
# Any user may write in the home directory: docker run --user. Shells and commands use a mounted workspace, and
# limit the open files, because rosout allocates 8 bytes for each: 8 GB with Docker's limit on some systems.
RUN useradd --create-home --uid 1000 --shell /bin/bash student && chmod 777 /home/student && \
    install -d -o student -g student /home/student/mushr_ros_intro && \
    printf '%s\n' 'ulimit -n 4096 2>/dev/null || true' 'mkdir -p "$ROS_HOME/log"' \
    'for file in /usr/share/bash-completion/completions/rosbash ~/catkin_ws/devel/setup.bash; do' \
    '  [ ! -e "$file" ] || . "$file"' done >/opt/workspace.bash && \
    echo '. /opt/workspace.bash' >>/etc/bash.bashrc
# What setup.bash of the package's workspace sets. As variables of the image, docker exec has them, too.
ENV HOME=/home/student LANG=C.UTF-8 WORKSPACE=/home/student/mushr_ros_intro/build/.workspace
ENV CMAKE_PREFIX_PATH=$WORKSPACE/devel PYTHONPATH=$WORKSPACE/devel/lib/python3/dist-packages \
    ROS_PACKAGE_PATH=$WORKSPACE/src ROS_MASTER_URI=http://localhost:11311 ROS_HOSTNAME=localhost \
    ROS_DISTRO=Debian ROS_ETC_DIR=/etc/ros ROS_VERSION=1 ROS_PYTHON_VERSION=3 \
    ROS_HOME=/tmp/ros OPENBLAS_NUM_THREADS=1 PYTHONUNBUFFERED=1
WORKDIR /home/student
USER student
EXPOSE 9090
# The shell replaces itself by the command, which then receives the signals of docker stop and Ctrl-C.
ENTRYPOINT ["bash", "-c", ". /opt/workspace.bash && exec \"$@\"", "-"]
# The port is open to the container's network; docker run -p decides who reaches it.
CMD ["roslaunch", "mushr_ros_intro", "sim.launch", "web:=true", "web_address:=0.0.0.0"]

FROM base AS build
USER root
RUN . /opt/packages && apt-get -q update && \
    DEBIAN_FRONTEND=noninteractive apt-get -q -y install --no-install-recommends \
    $build_packages $display_and_test_packages && \
    find /usr/lib/python3 -depth -path '*/tests/*' -delete && apt-get clean && rm -rf /var/lib/apt/lists/*
COPY --chown=student:student . mushr_ros_intro
USER student
RUN mushr_ros_intro/scripts/setup && \
    python3 -m compileall -q mushr_ros_intro/src mushr_ros_intro/build/.workspace/devel/lib

FROM base AS slim
COPY --from=build --chown=student:student /home/student/mushr_ros_intro mushr_ros_intro

FROM build AS full
