"""Bridges from a rig to the tools of robotics: node programs in the place of the robot's program.

::

    hilrig run robot.toml --realtime --node 'python3 -m hilrig.bridges.ros1 robot.toml'

``foxglove``, ``ros1`` and ``ros2`` publish the lidar, the odometry, the transforms and the clock of
the rig, and drive the robot by velocity commands (``docs/bridges.md``).
"""
