"""Interface packages that no package index has: built from their fields by the rosidl wheels.

One extension module holds what CMake would spread over several libraries.
"""

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import numpy as np

ROS = Path(sys.prefix)


def _parsed(text: str) -> dict[str, dict[str, str]]:
    """Fields of interfaces by package and file; before the fields of each its name."""
    found: dict[str, dict[str, str]] = {}
    for each in text.split('\n# ')[1:]:
        name, _, fields = each.partition('\n')
        package, _, file = name.partition('/')
        found.setdefault(package, {})[file] = f'{fields}\n'
    return found


DEFINITIONS = _parsed("""
# bond/msg/Status.msg
std_msgs/Header header
string id
string instance_id
bool active
float32 heartbeat_timeout
float32 heartbeat_period
# map_msgs/msg/OccupancyGridUpdate.msg
std_msgs/Header header
int32 x
int32 y
uint32 width
uint32 height
int8[] data
# nav2_msgs/action/NavigateToPose.action
geometry_msgs/PoseStamped pose
string behavior_tree
---
uint16 error_code
string error_msg
---
geometry_msgs/PoseStamped current_pose
builtin_interfaces/Duration navigation_time
builtin_interfaces/Duration estimated_time_remaining
int16 number_of_recoveries
float32 distance_remaining
# nav2_msgs/action/FollowPath.action
nav_msgs/Path path
string controller_id
string goal_checker_id
string progress_checker_id
---
std_msgs/Empty result
uint16 error_code
string error_msg
---
float32 distance_to_goal
float32 speed
# tf2_msgs/msg/TFMessage.msg
geometry_msgs/TransformStamped[] transforms
# vision_msgs/msg/Detection3DArray.msg
std_msgs/Header header
vision_msgs/Detection3D[] detections
# vision_msgs/msg/Detection3D.msg
std_msgs/Header header
ObjectHypothesisWithPose[] results
BoundingBox3D bbox
string id
# vision_msgs/msg/ObjectHypothesisWithPose.msg
ObjectHypothesis hypothesis
geometry_msgs/PoseWithCovariance pose
# vision_msgs/msg/ObjectHypothesis.msg
string class_id
float64 score
# vision_msgs/msg/BoundingBox3D.msg
geometry_msgs/Pose center
geometry_msgs/Vector3 size
# autoware_perception_msgs/msg/TrackedObjects.msg
std_msgs/Header header
TrackedObject[] objects
# autoware_perception_msgs/msg/TrackedObject.msg
unique_identifier_msgs/UUID object_id
float32 existence_probability
ObjectClassification[] classification
TrackedObjectKinematics kinematics
Shape shape
# autoware_perception_msgs/msg/ObjectClassification.msg
uint8 label
float32 probability
# autoware_perception_msgs/msg/TrackedObjectKinematics.msg
uint8 UNAVAILABLE=0
uint8 SIGN_UNKNOWN=1
uint8 AVAILABLE=2
geometry_msgs/PoseWithCovariance pose_with_covariance
geometry_msgs/TwistWithCovariance twist_with_covariance
geometry_msgs/AccelWithCovariance acceleration_with_covariance
uint8 orientation_availability
bool is_stationary
# autoware_perception_msgs/msg/Shape.msg
uint8 BOUNDING_BOX=0
uint8 CYLINDER=1
uint8 POLYGON=2
uint8 type
geometry_msgs/Polygon footprint
geometry_msgs/Vector3 dimensions
# radar_msgs/msg/RadarTracks.msg
std_msgs/Header header
radar_msgs/RadarTrack[] tracks
# radar_msgs/msg/RadarTrack.msg
uint16 NO_CLASSIFICATION=0
uint16 STATIC=1
uint16 DYNAMIC=2
unique_identifier_msgs/UUID uuid
geometry_msgs/Point position
geometry_msgs/Vector3 velocity
geometry_msgs/Vector3 acceleration
geometry_msgs/Vector3 size
uint16 classification
float32[6] position_covariance
float32[6] velocity_covariance
float32[6] acceleration_covariance
float32[6] size_covariance
# costmap_converter_msgs/msg/ObstacleArrayMsg.msg
std_msgs/Header header
costmap_converter_msgs/ObstacleMsg[] obstacles
# costmap_converter_msgs/msg/ObstacleMsg.msg
std_msgs/Header header
geometry_msgs/Polygon polygon
float64 radius
int64 id
geometry_msgs/Quaternion orientation
geometry_msgs/TwistWithCovariance velocities
# derived_object_msgs/msg/ObjectArray.msg
std_msgs/Header header
derived_object_msgs/Object[] objects
# derived_object_msgs/msg/Object.msg
std_msgs/Header header
uint32 id
uint8 detection_level
uint8 OBJECT_DETECTED=0
uint8 OBJECT_TRACKED=1
bool object_classified
geometry_msgs/Pose pose
geometry_msgs/Twist twist
geometry_msgs/Accel accel
geometry_msgs/Polygon polygon
shape_msgs/SolidPrimitive shape
uint8 classification
uint8 classification_certainty
uint32 classification_age
""")
# Those of Jazzy are Kilted's too; here is what Lyrical has instead.
LYRICAL = _parsed("""
# nav2_msgs/msg/TrackingFeedback.msg
std_msgs/Header header
float32 position_tracking_error
float32 heading_tracking_error
uint32 current_path_index
geometry_msgs/PoseStamped robot_pose
float32 distance_to_goal
float32 speed
float32 remaining_path_length
""")
LYRICAL['nav2_msgs'] |= {
    'action/FollowPath.action': DEFINITIONS['nav2_msgs']['action/FollowPath.action'].replace(
        'float32 distance_to_goal\nfloat32 speed', 'nav2_msgs/TrackingFeedback tracking_feedback'
    ),
    'action/NavigateToPose.action': DEFINITIONS['nav2_msgs']['action/NavigateToPose.action']
    + 'float32 position_tracking_error\nfloat32 heading_tracking_error\n',
}


def build(package: str, folder: Path, definitions: dict[str, dict[str, str]] = DEFINITIONS) -> Path:
    """Build a package that has definitions here, and return the folder to import it from."""
    source, interfaces = folder / 'source', definitions[package]
    for name, text in interfaces.items():
        path = source / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding='utf-8')
    command = [sys.executable, __file__, package, str(folder), *interfaces]
    environment = {**os.environ, 'AMENT_PREFIX_PATH': str(ROS)}
    subprocess.run(command, env=environment, check=True, capture_output=True)
    _compile(package, folder)
    return folder / 'python'


def _generate(package: str, folder: Path, files: list[str]) -> None:
    from rosidl_cli.command.translate.api import translate
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_py.cli import GeneratePython
    from rosidl_typesupport_c.cli import GenerateCTypesupport
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
    from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

    share, c = [str(ROS / 'share')], folder / 'c' / package
    idl = translate(
        package_name=package,
        interface_files=[f'{folder / "source"}:{each}' for each in files],
        include_paths=share,
        output_format='idl',
        output_path=folder / package,
    )
    python = {'typesupport_implementations': ['rosidl_typesupport_c']}
    for generator, output in (
        (GenerateC('c'), c),
        (GenerateFastRTPSCTypesupport('fastrtps_c'), c),
        (GenerateIntrospectionCTypesupport('introspection_c'), folder / 'introspection' / package),
        (GenerateCTypesupport('c'), folder / 'c' / 'dispatch'),
        (GeneratePython('py', **python), folder / 'python' / package),
    ):
        generator.generate(package, list(idl), share, output_path=output)


def _compile(package: str, folder: Path) -> None:
    python, library = folder / 'python' / package, ROS / 'lib'
    (python / '__init__.py').touch()
    needed = [*library.glob('lib*__rosidl_*_c.so'), *library.glob('lib*__rosidl_generator_py.so')]
    needed += library.glob('librosidl_*.so')
    needed += [library / f'lib{each}.so' for each in ('fastcdr', 'rmw', 'rcutils')]
    # The dispatcher loads one library for each kind by its name, unless it is there already.
    kinds = [
        f'lib{package}__rosidl_typesupport_{kind}.so' for kind in ('fastrtps_c', 'introspection_c')
    ]
    first, second = (python / each for each in kinds)
    _link(folder, first, [*_sources(folder / 'c'), *_sources(folder / 'introspection'), *needed])
    _link(folder, second, [first])
    module = python / f'{package}_s__rosidl_typesupport_c.so'
    _link(folder, module, [*_sources(python), first, second, *needed])


def _sources(folder: Path) -> list[Path]:
    return [path for path in folder.rglob('*') if path.suffix in {'.c', '.cpp'}]


def _link(folder: Path, target: Path, parts: list[Path]) -> None:
    headers = [
        folder / 'c',
        folder / 'introspection',
        sysconfig.get_path('include'),
        np.get_include(),
    ]
    headers += [ROS / 'include', *(ROS / 'include').iterdir()]
    subprocess.run(
        [
            *('gcc', '-shared', '-fPIC', '-O0', '-w', '-Wl,--no-as-needed'),
            *(f'-I{each}' for each in headers),
            *(*map(str, parts), '-lstdc++', f'-Wl,-rpath,{ROS / "lib"}:{target.parent}'),
            *(f'-Wl,-soname,{target.name}', '-o', str(target)),
        ],
        check=True,
        capture_output=True,
    )


if __name__ == '__main__':
    _generate(sys.argv[1], Path(sys.argv[2]), sys.argv[3:])
