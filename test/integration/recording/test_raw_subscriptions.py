"""The subscriptions, against a publisher that does not wait for it."""

from __future__ import annotations

import threading

import pytest
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from std_msgs.msg import UInt32

from cmpsp_ros.nodes.recording.received import RawSubscriptions

pytestmark = pytest.mark.integration

COUNT = 10_000
TOPICS = ('/cause', '/effect')


def test_what_comes_first_is_taken_first_whichever_topic_is_looked_at_first(ros):
    subscriptions = RawSubscriptions(ros.node)
    publishers = []
    for topic in TOPICS:
        publishers.append(ros.node.create_publisher(UInt32, topic, QoSProfile(depth=COUNT)))
        subscriptions.add(topic, UInt32, QoSProfile(depth=COUNT))
    ros.spin_until(lambda: all(each.get_subscription_count() for each in publishers))

    def publish():
        for k in range(COUNT):
            for each in publishers:
                each.publish(UInt32(data=k))

    publishing = threading.Thread(target=publish)
    publishing.start()
    rounds = []
    while publishing.is_alive():
        rounds.append(subscriptions.take())
    publishing.join()
    rounds += [subscriptions.take(), subscriptions.take(all_=True)]
    taken = [
        (deserialize_message(each.raw, UInt32).data, each.topic)
        for batch in rounds
        for each in batch
    ]
    assert sum(bool(batch) for batch in rounds) > 10
    assert taken == [(k, topic) for k in range(COUNT) for topic in TOPICS]
    assert list(subscriptions.lost()) == []
    subscriptions.close()
