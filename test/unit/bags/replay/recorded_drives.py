"""A guidance law that drives an exact robot in this process and is recorded as its node is."""

import math
from contextlib import suppress

import numpy as np
from bag_messages import (
    EVENT,
    ODOMETRY,
    PATH,
    SECOND,
    TWIST,
    all_parameters,
    odometry,
    parameter_event,
    pose_stamped,
    raw,
    write_bag,
)

from cmpsp_ros.bags import Bag, BagWriter
from cmpsp_ros.bags.decision_record import (
    DECISION,
    command_message,
    decision_message,
    path_message,
    status_of,
)
from cmpsp_ros.guidance import GoalError, GuidanceLaw, Observation
from cmpsp_ros.guidance.messages import Arrival, OdometryError, OdometryGate, goal_of
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file

DECISIONS = '/guidance/decision'
TICK = SECOND // 50
START = (0.0, -9.25, 0.0)


class Drive:
    """A drive at 50 Hz that is recorded message by message; a context manager."""

    def __init__(
        self, folder, prefix='', begin=1_700_000_000 * SECOND + 7, preset='case3', **parameters
    ):
        self.prefix, self.now, self.pose = prefix, begin, np.array(START)
        self.values = TABLE.resolve({**load_parameter_file(preset), **parameters})
        self.settings = guidance_settings(self.values)
        self.law = GuidanceLaw(self.settings, self.settings.world)
        self.held, self.decisions = np.zeros(2), []
        # By how much odometry is behind the recorder's clock.
        self.behind, self.folder, self.records = 0, folder, []
        self.activate()
        self.publish_parameters()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        kinds = {'odom': ODOMETRY, 'cmd_vel': TWIST, 'guidance/decision': DECISION}
        kinds = {f'{self.prefix}/{topic}': kind for topic, kind in kinds.items()}
        kinds |= {'/parameter_events': EVENT, f'{self.prefix}/guidance/predicted_path': PATH}
        write_bag(self.folder, self.records, kinds=kinds)

    def record(self, topic, late, message):
        """Record a message of one of the robot's topics, so long after now [ns]."""
        self.records.append((f'{self.prefix}/{topic}', self.now + late, message))

    def publish_parameters(self):
        keys = TABLE.keys(self.values)
        told = {key: self.values[key] for key, row in keys if 'guidance' in row.nodes}
        said = all_parameters(f'{self.prefix}/guidance', told)
        self.record('guidance/parameters', 0, said)

    def activate(self):
        self.law.reset()
        self.gate, self.commanded_at = OdometryGate(), 0

    def publish(self, decision, late=2_000_000):
        """Messages that a node publishes on a decision, a little after its odometry."""
        self.decisions.append(decision)
        if not decision.late:
            self.held, self.commanded_at = decision.wheel_speeds, self.now
            self.record('cmd_vel', late, command_message(decision))
        self.record('guidance/decision', late + 1000, decision_message(decision, 'decision'))
        if decision.plan is not None:
            path = path_message(decision.plan, self.settings.frame_id, decision.stamp)
            self.record('guidance/predicted_path', late + 2000, path)

    def say(self, message):
        self.record('odom', 1000, message)

    def go(self, seconds, *, heard=True):
        """Drive, odometry being heard or neither heard nor recorded."""
        for _ in range(round(seconds * SECOND / TICK)):
            if heard:
                self.hear(self.now - self.behind)
            self.tick()

    def be_late(self, seconds):
        """Decide on odometry of now, and be done with it so much later."""
        while not self.law.is_due(self.now):
            self.go(TICK / SECOND)
        stamp = self.now
        self.say(odometry(stamp, self.pose))
        self.law.step(Observation(stamp, self.measured()))
        for _ in range(round(seconds * SECOND / TICK)):
            self.tick()
            self.say(odometry(self.now, self.pose))
        self.publish(self.law.after_step(seconds))
        self.tick()

    def skip(self, seconds):
        """Pass odometry over, but for the newest."""
        for _ in range(round(seconds * SECOND / TICK)):
            self.say(odometry(self.now, self.pose))
            self.tick()
        self.say(odometry(self.now, self.pose))
        self.law.step(Observation(self.now, self.measured()))
        self.publish(self.law.after_step()._replace(skipped=True))
        self.tick()

    def hear(self, stamp, pose=None):
        """Hear odometry, of the robot or of another source; a fault stops it as in the node."""
        pose = self.pose if pose is None else pose
        self.say(odometry(stamp, pose))
        pose = self.measured(pose)
        try:
            arrival = self.gate.take(stamp, pose, self.now - self.behind, self.settings)
        except OdometryError as error:
            self.gate.refuse(str(error))
        else:
            if arrival is Arrival.IGNORED:
                return
            if arrival is Arrival.TIME_JUMPED_BACK:
                self.law.reset()
        if self.gate.fault:
            self.brake(self.gate.reason(self.settings))
            return
        decision = self.law.step(Observation(stamp, pose))
        if decision is not None:
            self.publish(self.law.after_step())

    def brake(self, reason, **flags):
        """Stop along the braking path, when the last command has been held for a period."""
        if self.now - self.commanded_at >= self.settings.control_period * SECOND:
            self.gate.note_stop()
            self.publish(self.law.halt(self.now, reason, braking=True, **flags))

    def measured(self, pose=None):
        """The pose as it reads back from a message."""
        x, y, heading = self.pose if pose is None else pose
        z, w = math.sin(heading / 2.0), math.cos(heading / 2.0)
        # As it is read, to the last bit: a power need not be rounded as a product is.
        return np.array([x, y, math.atan2(2.0 * (w * z), w * w - z * z)])

    def tick(self):
        held, seconds = self.held[None], np.array([TICK / SECOND])
        self.pose = self.settings.robot.roll_out(self.pose, held, seconds)[-1]
        self.now += TICK

    def halt(self, reason='No usable odometry.', **flags):
        self.publish(self.law.halt(self.now, reason, **flags))
        self.now += TICK // 4

    def tell(self, x, y, heading, *, frame_id='odom', stamp=0, heard=True):
        """Publish a goal, which the node hears and heeds, or was not active to."""
        message = pose_stamped(stamp, (x, y, heading), frame_id)
        self.record('goal_pose', 500, message)
        if heard:
            with suppress(GoalError):
                self.law.set_goal(*goal_of(message, self.settings.frame_id))

    def change(self, **changes):
        """A live change of parameters, `__` standing for a dot."""
        said = {key.replace('__', '.'): value for key, value in changes.items()}
        self.values = TABLE.reconfigure(self.values, said)
        self.settings = guidance_settings(self.values)
        event = parameter_event(f'{self.prefix}/guidance', said)
        self.records.append(('/parameter_events', self.now, event))
        self.law.reconfigure(self.settings, self.settings.world)


def altered(source, target, change=lambda topic, index, message: message, parameters=None):
    """A copy of a bag: `change` returns each message as it is to be, or None for none of it."""
    with Bag(source) as bag, BagWriter(target) as new:
        for topic, there in bag.topics.items():
            if parameters is not None and topic.endswith('/parameters'):
                continue
            new.topic(topic, there.msgtype)
            for index, (stamp, message) in enumerate(bag.messages(topic)):
                kept = change(topic, index, message)
                if kept is not None:
                    new.write(topic, stamp, raw(kept))
        for node, values in (parameters or {}).items():
            new.set_parameters(node, values)
    return target


def said(message, key):
    return next(each for each in status_of(message).values if each.key == key)


def setting(number, **facts):
    """A change of one decision's facts."""

    def change(topic, index, message):
        if topic == DECISIONS and index == number:
            for key, value in facts.items():
                said(message, key).value = value
        return message

    return change


def without(*keys):
    """A change that leaves keys of decisions out."""

    def change(topic, _index, message):
        if topic == DECISIONS:
            status = status_of(message)
            status.values = [each for each in status.values if each.key not in keys]
        return message

    return change


def editing(topic, edit, *numbers):
    """A change of one topic's messages by `edit`, which may return None for none of it."""

    def change(name, index, message):
        return edit(message) if name == topic and (not numbers or index in numbers) else message

    return change


def dropping(topic, *numbers):
    """A change that leaves out messages of a topic; all of them where no numbers are given."""
    return editing(topic, lambda _: None, *numbers)


def moving(place, distance):
    """An edit that moves what an attribute's path leads to: `moving('pose.position.x', 0.1)`."""
    *path, last = place.split('.')

    def edit(message):
        owner = message
        for part in path:
            owner = owner[int(part)] if part.lstrip('-').isdecimal() else getattr(owner, part)
        setattr(owner, last, getattr(owner, last) + distance)
        return message

    return edit
