"""The `metadata.yaml` of a bag, version 9, as rosbag2 of ROS 2 Jazzy writes it.

rosbags writes one for bags of a single file; our bags may have several, and must close on a full
disk.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import yaml
from rosbags.rosbag2.metadata import dump_qos_v9

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from rosbags.interfaces import Connection, ConnectionExtRosbag2, Qos

    from cmpsp_ros.bags.storage.form import StorageName

VERSION = 9

_UNBROKEN = 1 << 30


@dataclass(frozen=True)
class FileSummary:
    """One storage file of a bag.

    Attributes:
        name: Its name in the bag's folder.
        counts: Number of messages by the number of the topic.
        start: Stamp of its first message [ns], far in the future when there is none.
        end: Stamp of its last message [ns], 0 when there is none.
    """

    name: str
    counts: Mapping[int, int]
    start: int
    end: int

    @property
    def count(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())

    @property
    def duration(self) -> int:
        """Time from the first message to the last [ns]."""
        return max(0, self.end - self.start)


def information(
    storage: StorageName,
    topics: Sequence[Connection],
    files: Sequence[FileSummary],
    custom: Mapping[str, str],
) -> dict[str, Any]:
    """What a bag says about itself, in the words of rosbag2.

    Args:
        storage: Format of the files.
        topics: The topics; their number is the key of the files' counts.
        files: The files in order of time, at least one.
        custom: What is kept with the bag, by key.
    """
    start = min(each.start for each in files)
    end = max(each.end for each in files)
    return {
        'version': VERSION,
        'storage_identifier': storage,
        'duration': {'nanoseconds': max(0, end - start)},
        'starting_time': {'nanoseconds_since_epoch': start},
        'message_count': sum(each.count for each in files),
        'topics_with_message_count': [
            {
                'topic_metadata': {
                    'name': each.topic,
                    'type': each.msgtype,
                    'serialization_format': 'cdr',
                    'offered_qos_profiles': dump_qos_v9(profiles_of(each)),
                    'type_description_hash': each.digest,
                },
                'message_count': sum(file.counts.get(each.id, 0) for file in files),
            }
            for each in topics
        ],
        'compression_format': '',
        'compression_mode': '',
        'relative_file_paths': [each.name for each in files],
        'files': [
            {
                'path': each.name,
                'starting_time': {'nanoseconds_since_epoch': each.start},
                'duration': {'nanoseconds': each.duration},
                'message_count': each.count,
            }
            for each in files
        ],
        'custom_data': dict(custom),
        'ros_distro': 'jazzy',
    }


def qos_text(profiles: Sequence[Qos]) -> str:
    """QoS profiles as the storage files keep them."""
    return as_yaml(dump_qos_v9(list(profiles))).strip()


def as_yaml(value: Any) -> str:
    """Text of a value, in blocks and without references."""
    return yaml.dump(value, Dumper=_Plain, sort_keys=False, width=_UNBROKEN)


class _Plain(yaml.SafeDumper):
    """Writes repeated values out, because not every reader of bags supports aliases."""

    def ignore_aliases(self, _data: object) -> bool:
        return True


def profiles_of(topic: Connection) -> list[Qos]:
    """What the publishers of a topic offer."""
    return list(cast('ConnectionExtRosbag2', topic.ext).offered_qos_profiles)
