"""Tracks from the messages of other packages, as their real definitions have them."""

import math
from importlib import import_module
from typing import get_args, get_type_hints

import numpy as np
import pytest
from geometry_msgs.msg import Point32
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2
from shape_msgs.msg import SolidPrimitive

from cmpsp_ros.guidance.messages import ObjectTracks, Track, TrackError
from cmpsp_ros.guidance.messages.objects import TrackedObject, objects_of
from cmpsp_ros.nodes.common.messages import cloud_of
from cmpsp_ros.sensing import TrackSource

KINDS = get_args(get_type_hints(TrackSource)['type'])
HERE, AT_REST = np.zeros(3), np.zeros(3)
SECOND = 1_000_000_000
FIRST = 2 * Track.SEEN


def covariance(xx, xy, yy, heading=0.0):
    """A covariance of six coordinates, with the plane in it and a height that is unknown."""
    rows = np.diag([xx, yy, 1e6, 1.0, 1.0, heading])
    rows[0, 1] = rows[1, 0] = xy
    return rows.ravel()


def upright(heading):
    return {'z': math.sin(heading / 2.0), 'w': math.cos(heading / 2.0)}


def fill(message, **values):
    """Set fields of a message, those of its parts by dictionaries."""
    for key, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, key), **value)
        else:
            setattr(message, key, value)
    return message


@pytest.fixture
def make(interfaces):
    """Make a message of a package: `make('radar_msgs/RadarTrack', **fields)`."""

    def new(name, **values):
        package, kind = name.split('/')
        if package != 'sensor_msgs':
            interfaces(package)
        return fill(getattr(import_module(f'{package}.msg'), kind)(), **values)

    return new


def stamped(stamp=SECOND, frame_id='odom'):
    return {'stamp': Time(nanoseconds=stamp).to_msg(), 'frame_id': frame_id}


def detection(make, x, name='', size=(0.6, 0.8), **rest):
    box = {'center': {'position': {'x': x, 'y': 2.0}}, 'size': dict(zip('xy', size, strict=True))}
    return make('vision_msgs/Detection3D', bbox=box, id=name, **rest)


def detections(make, found, stamp=SECOND):
    name = 'vision_msgs/Detection3DArray'
    return make(name, header=stamped(stamp), detections=found)


def test_detections(make):
    guess = {'hypothesis': {'score': 0.2}, 'pose': {'covariance': covariance(9.0, 0.0, 9.0)}}
    surest = {'hypothesis': {'score': 0.7}, 'pose': {'covariance': covariance(0.01, 0.0, 0.04)}}
    hypotheses = [make('vision_msgs/ObjectHypothesisWithPose', **each) for each in (guess, surest)]
    found = [detection(make, 1.0, 'ann', results=hypotheses), detection(make, 3.0)]
    assert objects_of(detections(make, found), KINDS[1]) == [
        TrackedObject('ann', 1.0, 2.0, 0.5, None, 0.2),
        TrackedObject(None, 3.0, 2.0, 0.5, None),
    ]


def test_a_box_that_lies_down_is_covered_as_one_that_stands_is_not(make):
    box = make('vision_msgs/Detection3D', bbox={'size': {'x': 0.5, 'y': 0.3, 'z': 1.8}})
    for roll, radius in ((0.0, 0.292), (0.2, 0.292), (math.pi / 2.0, 0.946), (math.pi, 0.946)):
        turned = {'x': math.sin(roll / 2.0), 'w': math.cos(roll / 2.0)}
        fill(box, bbox={'center': {'orientation': turned}})
        (found,) = objects_of(detections(make, [box]), KINDS[1])
        assert found.radius == pytest.approx(radius, abs=1e-3)


@pytest.mark.parametrize(('heading', 'doubt'), [(0.0, 0.5), (0.09, 0.523), (1e3, 1.136)])
def test_who_walks_in_a_direction_in_doubt_may_walk_another_way(make, heading, doubt):
    kinematics = {
        'pose_with_covariance': {'covariance': covariance(0.0, 0.0, 0.0, heading)},
        'twist_with_covariance': {
            'twist': {'linear': {'x': 0.5, 'y': 0.1}},
            'covariance': covariance(0.25, 0.0, 0.0),
        },
    }
    found = make('autoware_perception_msgs/TrackedObject', kinematics=kinematics)
    message = make('autoware_perception_msgs/TrackedObjects', header=stamped(), objects=[found])
    assert objects_of(message, KINDS[2])[0].velocity_stddev == pytest.approx(doubt, abs=1e-3)
    fill(found, kinematics={'pose_with_covariance': {'pose': {'orientation': {'w': 0.0}}}})
    with pytest.raises(TrackError, match='moves without an orientation, wanted a quaternion'):
        objects_of(message, KINDS[2])


def test_objects_of_autoware(make):
    kinematics = {
        'pose_with_covariance': {
            'pose': {'position': {'x': 1.0, 'y': 2.0}, 'orientation': upright(math.pi / 2.0)},
            'covariance': covariance(0.02, 0.01, 0.02),
        },
        'twist_with_covariance': {
            'twist': {'linear': {'x': 0.5, 'y': 0.1}},
            'covariance': covariance(0.25, 0.0, 0.0),
        },
    }
    corners = [Point32(x=0.3, y=0.4), Point32(x=-0.1, y=0.0)]
    found = [
        make(
            'autoware_perception_msgs/TrackedObject',
            kinematics=kinematics,
            object_id={'uuid': np.full(16, number, np.uint8)},
            shape=shape,
        )
        for number, shape in enumerate(
            (
                {'type': 0, 'dimensions': {'x': 0.6, 'y': 0.8}},
                {'type': 1, 'dimensions': {'x': 0.6, 'y': 0.6}},
                {'type': 2, 'footprint': {'points': corners}},
            )
        )
    ]
    message = make('autoware_perception_msgs/TrackedObjects', header=stamped(), objects=found)
    objects = objects_of(message, KINDS[2])
    assert [each.radius for each in objects] == pytest.approx([0.5, 0.3, 0.5])
    assert [each.name for each in objects] == [bytes([k] * 16) for k in range(3)]
    assert objects[0].velocity == pytest.approx((-0.1, 0.5)), 'its own axes are turned'
    assert objects[0].position_stddev == pytest.approx(math.sqrt(0.03)), 'along its diagonal'
    assert objects[0].velocity_stddev == pytest.approx(0.5)


def test_tracks_of_a_radar_that_moves(make):
    track = make(
        'radar_msgs/RadarTrack',
        position={'x': 2.0},
        velocity={'x': -1.0},
        position_covariance=np.array([0.04, 0.0, 0.0, 0.09, 0.0, 9.0], np.float32),
        velocity_covariance=np.array([0.16, 0.0, 0.0, 0.01, 0.0, 9.0], np.float32),
    )
    message = make('radar_msgs/RadarTracks', header=stamped(), tracks=[track])
    tracks = ObjectTracks(TrackSource('radar', type=KINDS[3], radius=0.25), 2)
    # It drives to the left at 1 m/s and turns: what it sees come at it stands, but for the turn.
    there, motion = np.array([5.0, 1.0, math.pi / 2.0]), np.array([0.0, 1.0, 0.2])
    (found,) = tracks.tracks_of(message, there, motion, 1.0)
    assert (found.id, found.stamp, found.radius) == (FIRST, SECOND, 0.25)
    assert (found.x, found.y) == pytest.approx((5.0, 3.0))
    assert (found.vx, found.vy) == pytest.approx((-0.4, 0.0))
    assert (found.position_stddev, found.velocity_stddev) == pytest.approx((0.3, 0.4))


def test_obstacles_of_a_costmap(make):
    shapes = ([(1.0, 2.0)], [(0.0, 0.0), (0.6, 0.8)], [(0, 0), (2, 0), (2, 2), (0, 2)])
    found = [
        make(
            'costmap_converter_msgs/ObstacleMsg',
            id=7,
            radius=0.3 if len(points) == 1 else 0.0,
            polygon={'points': [Point32(x=float(x), y=float(y)) for x, y in points]},
            velocities={'twist': {'linear': {'x': 0.2, 'y': -0.1}}},
        )
        for points in shapes
    ]
    name = 'costmap_converter_msgs/ObstacleArrayMsg'
    objects = objects_of(make(name, header=stamped(), obstacles=found), KINDS[4])
    places = [(each.x, each.y, each.radius) for each in objects]
    assert places == [
        pytest.approx(each)
        for each in ((1.0, 2.0, 0.3), (0.3, 0.4, 0.5), (1.0, 1.0, math.sqrt(2.0)))
    ]
    assert {each.name for each in objects} == {None}, 'one number for all is none'
    assert objects[0].velocity == pytest.approx((0.2, -0.1))
    found[0].polygon.points = []
    with pytest.raises(TrackError, match='Obstacle 7 has a polygon without points'):
        objects_of(make(name, header=stamped(), obstacles=found), KINDS[4])
    (elsewhere,) = found[1:2]
    elsewhere.header.frame_id = 'map'
    with pytest.raises(TrackError, match="An object is in frame 'map', wanted 'odom'"):
        objects_of(make(name, header=stamped(), obstacles=[elsewhere]), KINDS[4])


@pytest.mark.parametrize(
    ('kind', 'sizes', 'radius'),
    [
        (SolidPrimitive.BOX, [0.6, 0.8, 1.8], 0.5),
        (SolidPrimitive.SPHERE, [0.3], 0.3),
        (SolidPrimitive.CYLINDER, [1.8, 0.3], 0.3),
        (SolidPrimitive.CONE, [1.8, 0.4], 0.4),
        (SolidPrimitive.PRISM, [1.8], 0.5),
        (0, [], 0.0),
    ],
)
def test_derived_objects(make, kind, sizes, radius):
    shape = SolidPrimitive(type=kind, dimensions=sizes)
    shape.polygon.points = [Point32(x=0.3, y=0.4)] if kind == SolidPrimitive.PRISM else []
    moved = {'linear': {'x': 0.5}}
    found = [
        make(
            'derived_object_msgs/Object', id=level, detection_level=level, shape=shape, twist=moved
        )
        for level in (0, 1)
    ]
    message = make('derived_object_msgs/ObjectArray', header=stamped(), objects=found)
    detected, tracked = objects_of(message, KINDS[5])
    assert (detected.velocity, tracked.velocity) == (None, (0.5, 0.0))
    assert [each.radius for each in (detected, tracked)] == pytest.approx([radius, radius])


def test_a_derived_object_is_as_large_as_its_polygon_and_seen_when_its_message_is(make):
    corners = [Point32(x=float(x), y=float(y)) for x, y in ((2, -1), (4, -1), (4, 1), (2, 1))]
    found = make('derived_object_msgs/Object', pose={'position': {'x': 3.0}})
    found.polygon.points = corners
    message = make('derived_object_msgs/ObjectArray', header=stamped(), objects=[found])
    for seen in (0, SECOND, SECOND - SECOND // 20):
        fill(found, header=stamped(seen))
        assert objects_of(message, KINDS[5])[0].radius == pytest.approx(math.sqrt(2.0))
    fill(found, header=stamped(SECOND * 2 // 5))
    with pytest.raises(TrackError, match=r'An object was seen 0\.600 s before its message'):
        objects_of(message, KINDS[5])


def test_more_objects_than_any_tracker_has_are_refused_without_a_look_at_them(make):
    found = [detection(make, 0.0, str(k)) for k in range(1001)]
    assert len(objects_of(detections(make, found[:-1]), KINDS[1])) == 1000
    with pytest.raises(TrackError, match='more than 1000 objects'):
        objects_of(detections(make, found * 100), KINDS[1])


def test_names_become_numbers_and_keep_them():
    tracks = ObjectTracks(TrackSource('people'), 2)
    names, places = (70, 3, -5), ((1.0, 0.0), (2.0, 0.0), (3.0, 0.0))
    for step in range(3):
        stamp = (1 + step) * SECOND // 10
        named = zip(names, places, strict=True)
        seen = [Track(name, stamp, 0.3, *at, 0.1, 0.2) for name, at in named]
        found = tracks.tracks_of(cloud_of(seen[step:], stamp, 'odom'), HERE, AT_REST, 1.0)
        assert [each.id for each in found] == [FIRST, FIRST + 1, FIRST + 2][step:]
        assert {(each.radius, each.position_stddev) for each in found} == {(0.3, 0.1)}
    later = cloud_of([Track(70, 2 * SECOND, 0.3, 1.0, 0.0, 0.0, 0.0)], 2 * SECOND, 'odom')
    (again,) = tracks.tracks_of(later, HERE, AT_REST, 1.0)
    assert again.id == FIRST + 3, 'it was out of sight for too long'


@pytest.mark.parametrize('named', [True, False])
def test_detections_get_their_velocity_from_their_places(make, named):
    """Two cross: one of them at 0.8 m/s, the other at -0.5 m/s, 0.6 m beside."""
    tracks = ObjectTracks(TrackSource('camera', type=KINDS[1], position_stddev=0.05), 3)
    noise, ids = np.random.default_rng(1), set()
    for step in range(40):
        stamp, time = SECOND + step * SECOND // 10, step / 10.0
        places = np.array([[0.8 * time, 0.0], [2.6 - 0.5 * time, 0.6]])
        places += noise.normal(0.0, 0.05, (2, 2))
        found = [
            detection(make, float(x), name if named else '')
            for (x, _), name in zip(places, ('a', 'b'), strict=True)
        ]
        for each, (_, y) in zip(found, places.tolist(), strict=True):
            each.bbox.center.position.y = y
        shuffled = found if step % 2 else found[::-1]
        seen = tracks.tracks_of(detections(make, shuffled, stamp), HERE, AT_REST, 1.0)
        seen.sort(key=lambda each: each.y)
        ids.add(tuple(each.id for each in seen))
        if step == 0:
            assert all(each.velocity_stddev == 1.0 for each in seen), 'nothing is known of it'
    first, second = seen
    assert len(ids) == 1, 'each keeps its number'
    assert (first.vx, first.vy) == pytest.approx((0.8, 0.0), abs=0.15)
    assert (second.vx, second.vy) == pytest.approx((-0.5, 0.0), abs=0.15)
    assert 0.0 < first.position_stddev < 0.05
    assert 0.0 < first.velocity_stddev < 0.4
    old = detections(make, [detection(make, 9.0, 'a')], stamp - SECOND // 10)
    assert not named or tracks.tracks_of(old, HERE, AT_REST, 1.0) == []


@pytest.mark.parametrize(
    ('change', 'said'),
    [
        ({'x': math.nan}, 'a number that is not finite'),
        ({'radius': -0.1}, 'a radius of -0.1 m'),
        ({'vx': 1e5}, 'a velocity of 1e+05'),
        ({'position_stddev': -1.0}, 'a standard deviation of -1'),
        ({'velocity_stddev': 1e200}, 'a standard deviation of 1e+200, wanted one on Earth'),
    ],
)
def test_a_message_with_a_bad_object_is_refused_as_a_whole(change, said):
    tracks = ObjectTracks(TrackSource('people'), 2)
    good = Track(1, SECOND, 0.3, 0.0, 0.0, 0.0, 0.0)
    bad = Track(**{**vars(good), 'id': 2, **change})
    with pytest.raises(TrackError, match=said.replace('+', r'\+')):
        tracks.tracks_of(cloud_of([good, bad], SECOND, 'odom'), HERE, AT_REST, 1.0)
    (found,) = tracks.tracks_of(cloud_of([good], SECOND, 'odom'), HERE, AT_REST, 1.0)
    assert found.id == FIRST


def test_an_empty_message_has_no_tracks():
    message = cloud_of([], SECOND, 'odom')
    assert isinstance(message, PointCloud2)
    assert ObjectTracks(TrackSource('people'), 2).tracks_of(message, HERE, AT_REST, 1.0) == []
