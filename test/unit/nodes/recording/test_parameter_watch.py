"""Asking nodes for their parameters, with a graph and a time that a test decides on."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import ListParameters
from rclpy.serialization import serialize_message
from rclpy.task import Future

from cmpsp_ros.nodes.recording import parameter_watch
from cmpsp_ros.nodes.recording.parameter_watch import ANSWER_TIMEOUT, SETTLING_TIME, ParameterWatch

NAME = '/robot/guidance'


def double(value):
    return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=float(value))


class Client:
    def __init__(self, kind):
        self.kind, self.calls = kind, []

    def service_is_ready(self):
        return True

    def call_async(self, request):
        self.calls.append((request, Future()))
        return self.calls[-1][1]

    def remove_pending_request(self, future):
        self.calls = [each for each in self.calls if each[1] is not future]


class Graph:
    """The node that asks, and those that it sees."""

    def __init__(self):
        self.names, self.clients, self.now = [], [], 0

    def get_node_names_and_namespaces(self):
        return self.names

    def get_fully_qualified_name(self):
        return '/recorder'

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=self.now))

    def create_client(self, kind, name):
        self.clients.append(Client(kind))
        return self.clients[-1]

    def destroy_client(self, client):
        self.clients.remove(client)

    def answer(self, **values):
        """Answer what is being asked, first for names and then for values."""
        lister, getter = self.clients
        (_, future) = lister.calls.pop()
        names = ListParameters.Response()
        names.result.names = list(values)
        future.set_result(names)
        self.answer_values(getter, values)

    def answer_values(self, getter, values):
        request, future = getter.calls.pop()
        future.set_result(SimpleNamespace(values=[double(values[each]) for each in request.names]))


class Watched:
    def __init__(self, monkeypatch):
        self.graph, self.told, self.seconds = Graph(), {}, 100.0
        monkeypatch.setattr(parameter_watch.time, 'monotonic', lambda: self.seconds)
        self.watch = ParameterWatch(self.graph, self._tell)

    def _tell(self, node, values, since):
        self.told[node, since] = dict(values)

    def appear(self, count=1):
        self.graph.names = [('guidance', '/robot')] * count
        self.watch.poll()

    def vanish(self, now):
        self.graph.names, self.graph.now = [], now
        self.watch.poll()

    def hear(self, kind='changed', **values):
        parameters = [Parameter(name=key, value=double(each)) for key, each in values.items()]
        event = ParameterEvent(node=NAME, **{f'{kind}_parameters': parameters})
        self.watch.hear(serialize_message(event))

    def settle(self):
        self.seconds += SETTLING_TIME + 0.1
        self.watch.caught_up()


@pytest.fixture
def watched(monkeypatch):
    return Watched(monkeypatch)


def test_a_node_is_asked_and_told_once_its_events_have_been_heard(watched):
    watched.appear()
    watched.graph.answer(gain=1.5, other=2.0)
    watched.watch.caught_up()
    watched.watch.poll()
    assert watched.told == {}
    watched.settle()
    assert watched.told == {(NAME, 0): {'gain': 1.5, 'other': 2.0}}
    assert watched.graph.clients == []


def test_a_change_that_its_late_answer_knows_is_not_taken_for_the_beginning(watched):
    watched.appear()
    watched.graph.answer(gain=9.0, other=2.0)
    watched.hear(gain=9.0)
    watched.settle()
    assert watched.told == {(NAME, 0): {'other': 2.0}}


def test_a_change_after_the_answer_is_not_taken_for_the_beginning(watched):
    watched.appear()
    watched.graph.answer(gain=1.5)
    watched.hear(gain=9.0)
    watched.settle()
    watched.hear(gain=10.0)
    assert watched.told == {(NAME, 0): {'gain': 1.5}}


def test_nothing_settles_while_events_wait_to_be_heard(watched):
    watched.appear()
    watched.graph.answer(gain=9.0, other=2.0)
    watched.seconds += 10.0
    watched.watch.poll()
    watched.hear(gain=9.0)
    watched.watch.caught_up()
    assert watched.told == {(NAME, 0): {'other': 2.0}}


def test_a_node_that_is_silent_is_asked_again(watched):
    watched.appear()
    first = watched.graph.clients[0].calls[0][1]
    watched.seconds += ANSWER_TIMEOUT + 0.1
    watched.watch.poll()
    watched.watch.poll()
    ((_, second),) = watched.graph.clients[0].calls
    assert second is not first
    watched.graph.answer(gain=1.5)
    watched.settle()
    assert watched.told == {(NAME, 0): {'gain': 1.5}}


def test_a_change_before_it_is_asked_again_makes_the_value_unknown(watched):
    watched.appear()
    lister, getter = watched.graph.clients
    names = ListParameters.Response()
    names.result.names = ['gain', 'other']
    lister.calls.pop()[1].set_result(names)
    watched.hear(gain=9.0)
    watched.seconds += ANSWER_TIMEOUT + 0.1
    watched.watch.poll()
    watched.watch.poll()
    watched.graph.answer_values(getter, {'gain': 3.0, 'other': 2.0})
    watched.settle()
    assert watched.told == {(NAME, 0): {'other': 2.0}}


def test_a_parameter_that_goes_meanwhile_has_all_asked_anew(watched):
    watched.appear()
    lister, getter = watched.graph.clients
    names = ListParameters.Response()
    names.result.names = ['gain', 'gone']
    lister.calls.pop()[1].set_result(names)
    getter.calls.pop()[1].set_result(SimpleNamespace(values=[]))
    watched.watch.poll()
    watched.graph.answer(gain=1.5)
    watched.settle()
    assert watched.told == {(NAME, 0): {'gain': 1.5}}


def test_late_declarations_are_told_at_once(watched):
    watched.hear('new', late=2.5)
    watched.hear(late=9.0)
    assert watched.told == {(NAME, 0): {'late': 2.5}}


def test_the_end_does_not_wait(watched):
    watched.appear()
    watched.graph.answer(gain=1.5)
    watched.watch.finish()
    assert watched.told == {(NAME, 0): {'gain': 1.5}}


@pytest.fixture
def lived(watched):
    """A node with `gain` 1.5, later 9.0, and `other` 2.0, that has ended at 70 ns."""
    watched.appear()
    watched.graph.answer(gain=1.5, other=2.0)
    watched.settle()
    watched.hear(gain=9.0)
    watched.vanish(70)
    watched.graph.now = 90
    watched.appear()
    return watched


def test_a_node_started_anew_with_other_values_is_told_with_its_time(lived):
    lived.graph.answer(gain=1.5, other=2.0)
    assert set(lived.told) == {(NAME, 0)}
    lived.settle()
    assert lived.told == {
        (NAME, 0): {'gain': 1.5, 'other': 2.0},
        (NAME, 70): {'gain': 1.5, 'other': 2.0},
    }


def test_a_node_started_anew_with_the_same_values_is_not_told(lived):
    lived.graph.answer(gain=9.0, other=2.0)
    lived.settle()
    lived.hear(other=3.0)
    assert set(lived.told) == {(NAME, 0)}


def test_what_a_node_started_anew_changes_at_once_is_unknown(lived):
    lived.hear(gain=4.0)
    lived.graph.answer(gain=4.0, other=2.0)
    lived.settle()
    assert lived.told[NAME, 70] == {'other': 2.0}


def test_a_node_that_was_killed_is_still_seen_beside_its_successor(watched):
    watched.appear()
    watched.graph.answer(gain=1.5)
    watched.settle()
    watched.graph.now = 50
    watched.appear(2)
    watched.graph.answer(gain=2.0)
    watched.settle()
    watched.appear(1)
    assert watched.graph.clients == []
    assert watched.told == {(NAME, 0): {'gain': 1.5}, (NAME, 50): {'gain': 2.0}}


@pytest.mark.parametrize('again', [False, True])
def test_a_node_that_ends_right_after_its_answer_has_given_it(watched, again):
    watched.appear()
    watched.graph.answer(gain=1.5)
    watched.vanish(70)
    if again:
        watched.appear()
        watched.graph.answer(gain=2.5)
    watched.settle()
    told = {(NAME, 0): {'gain': 1.5}}
    assert watched.told == (told | {(NAME, 70): {'gain': 2.5}} if again else told)
    assert watched.graph.clients == []


def test_a_node_that_ends_before_it_answers_is_asked_when_it_comes_back(watched):
    watched.appear()
    watched.vanish(70)
    assert watched.graph.clients == []
    watched.appear()
    watched.graph.answer(gain=1.5)
    watched.settle()
    assert watched.told == {(NAME, 0): {'gain': 1.5}}
