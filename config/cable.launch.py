"""The node with a scene, and RViz where it is wanted.

    ros2 launch dlo_sim cable.launch.py scene:=two_grippers rviz:=true

RViz shows what is in the frame `world`; a scene with another frame_id needs it as its fixed frame.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` starts; it ends with the node."""
    view = PathJoinSubstitution([FindPackageShare("dlo_sim"), "config", "cable.rviz"])
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "scene",
                default_value="hanging_cable",
                description="scene file, or a shipped scene's name",
            ),
            DeclareLaunchArgument(
                "rviz",
                default_value="false",
                choices=["true", "false"],
                description="whether to start RViz, too",
            ),
            Node(
                package="dlo_sim",
                executable="node",
                arguments=["--scene", LaunchConfiguration("scene")],
                output="screen",
                on_exit=Shutdown(),
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                arguments=["-d", view],
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
