# ROS with the actions that the stories use: they have no package in it.
ARG BASE
FROM ${BASE}
USER 0:0
RUN --mount=type=cache,id=robot-offload-pip,target=/root/.cache/pip,sharing=locked \
    python3 -m pip install --no-compile ros-jazzy-test-msgs==2.0.3
