"""The recorder as a process."""

import sys

from diagnostic_msgs.msg import DiagnosticStatus
from std_srvs.srv import Trigger

from cmpsp_ros.nodes.common.topics import HEALTH
from cmpsp_ros.nodes.recording.received import from_values

RECORDER = [sys.executable, '-m', 'cmpsp_ros.nodes.recording.recorder', '--ros-args']


def heard(publisher):
    return lambda: publisher.get_subscription_count() > 0


def flushing(ros):
    """Flush, and return the number of messages in the bag by topic."""
    said = []
    ros.node.create_subscription(HEALTH.type, HEALTH.name, said.append, HEALTH.qos)
    ros.spin_until(lambda: ros.node.count_publishers(HEALTH.name))

    def counted():
        statuses = [each for array in said for each in array.status]
        return [each for each in statuses if each.name == '/recorder: recorder']

    def counts():
        said.clear()
        assert ros.call(Trigger, '/recorder/flush').success
        (*_, status) = ros.spin_until(counted)
        values = {each.key: each.value for each in status.values}
        counted_topics = {topic: each.count for topic, each in from_values(values).items()}
        assert status.level == DiagnosticStatus.OK
        assert int(values['messages']) == sum(counted_topics.values())
        assert values['output'].endswith('bag')
        return counted_topics

    return counts
