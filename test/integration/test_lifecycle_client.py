"""The observer of a run, alone on its domain."""

import pytest

from cmpsp_ros.nodes import LifecycleClient


def test_a_node_that_does_not_answer_may_be_compiling(ros_domain):
    with (
        LifecycleClient(ros_domain) as observer,
        pytest.raises(TimeoutError, match='within 1 s; if it was compiling, run `cmpsp warmup`'),
    ):
        observer.configure(1.0)
