"""A bag that cannot be audited is refused in one line that says why."""

import numpy as np
import pytest

from cmpsp_ros.bags import BagError
from cmpsp_ros.bags.audit import Sources, read_record
from cmpsp_ros.parameters import ParameterError


def refusal(drive, path, sources=None, kind=BagError):
    bag = drive.write(path)
    with pytest.raises(kind) as caught:
        read_record(bag, sources)
    text = str(caught.value)
    assert '\n' not in text
    return text


def test_a_value_that_nobody_knows_is_not_guessed(drive, tmp_path):
    center = drive.parameters.pop('road.center')
    drive.changes = [(drive.commands[5].received, 'road.center', center)]
    assert 'change of road.center of /guidance' in refusal(drive, tmp_path / 'bag')
    drive.changes = [(drive.commands[0].received - 1, 'road.center', center)]
    assert 'road.center' in read_record(drive.write(tmp_path / 'sound')).history.given


@pytest.mark.parametrize(
    ('sources', 'said'),
    [
        (Sources(odom='/cmd_vel'), 'found geometry_msgs/msg/Twist in /cmd_vel'),
        (Sources(cmd_vel='/odom'), 'found nav_msgs/msg/Odometry in /odom'),
    ],
)
def test_a_topic_of_another_type_is_refused(drive, tmp_path, sources, said):
    assert said in refusal(drive, tmp_path / 'bag', sources)


def test_a_bag_without_a_drive_is_refused(drive, tmp_path):
    drive.odometry = drive.odometry[:1]
    assert 'wanted a drive' in refusal(drive, tmp_path / 'bag')


def test_several_robots_have_to_be_told_apart(drive, tmp_path, monkeypatch):
    drive.namespace = '/r1'
    bag = drive.write(tmp_path / 'bag')
    from cmpsp_ros.bags import Bag

    # As if a second robot's parameters had been recorded beside.
    with Bag(bag) as opened:
        parameters = {**opened.parameters, '/r2/guidance': opened.parameters['/r1/guidance']}
    from cmpsp_ros.bags.audit.sources import find

    with Bag(bag) as opened:
        opened.parameters = parameters
        with pytest.raises(BagError, match=r'--odom /r1/odom'):
            find(opened, Sources())
        assert find(opened, Sources(odom='/r1/odom')).decision == '/r1/guidance/decision'


def test_parameters_of_a_file_that_cannot_be_used_are_named(drive, tmp_path):
    text = refusal(drive, tmp_path / 'bag', Sources(params_file='case99'), ParameterError)
    assert 'case99' in text


def test_a_position_beyond_all_measure_is_refused(drive, tmp_path):
    drive.odometry[7].pose = np.array([1e300, 0.0, 0.0])
    assert 'wanted one on Earth' in refusal(drive, tmp_path / 'bag')


def test_a_decision_beyond_all_time_is_refused(drive, tmp_path):
    drive.decisions[3] = drive.decisions[3]._replace(stamp=(1 << 62) + 1, plan=None)
    assert 'wanted one of a clock' in refusal(drive, tmp_path / 'bag')
