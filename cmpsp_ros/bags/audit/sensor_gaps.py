"""Sensors without usable messages: when, and why."""

import numpy as np

from cmpsp_ros.bags.audit.record import AuditRecord
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.runs import in_words
from cmpsp_ros.bags.runs.odometry import Hole
from cmpsp_ros.sensing import ScanError, Sensor, sight_of


def sensor_gap(record: AuditRecord, _worst: object = None) -> str:
    """Why obstacles are not known everywhere, in sentences; empty if they are."""
    sensors = record.settings.sight.sensors
    if record.history.simulated or not sensors:
        return ''
    said = []
    if not all(record.seen):
        said.append('Only sensors know the obstacles, and in the bag they saw nothing.')
    else:
        blind: list[Hole] = []
        for each in record.seen:
            looks = np.unique(np.concatenate([one.looks for one in each]))
            blind += each[0].blind(looks, record.settings)
        said += [f'No sensor saw anything {in_words(blind, record.start)}.'] if blind else []
    # `~/sighting` is of all sensors.
    alone = [leg[0] for leg in record.seen if leg and all(each.heard for each in leg)]
    for sensor in sensors:
        blind = [
            hole for leg in alone for hole in leg.blind(leg.heard[sensor.name], record.settings)
        ]
        why = _refusal(record, sensor) if blind or not all(record.seen) else ''
        when = f' shows nothing {in_words(blind, record.start)}' if blind else ''
        if when or why:
            said.append(f'Sensor {sensor.name}{when}{": " if why else ""}{why}.')
    return ' '.join(said)


def _refusal(record: AuditRecord, sensor: Sensor) -> str:
    """Why the first unusable message of a sensor is refused, or why it has none; else empty."""
    with Bag(record.path) as bag:
        name = sensor.topic_in(record.places.namespace)
        if name not in bag.topics:
            return f'{name} is not in the bag'
        if (found := bag.topics[name].msgtype) != sensor.message_type:
            return f'found {found} in {name}, wanted {sensor.message_type}'
        try:
            for _, message in bag.messages(name):
                sight_of(message, sensor)
        except ScanError as error:
            return str(error)
    return ''
