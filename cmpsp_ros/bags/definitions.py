"""Message types of a bag: those of ROS 2 Jazzy, and those that the bag defines."""

import re
from functools import cache

from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat, Nodetype
from rosbags.rosbag2 import ReaderError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from cmpsp_ros.bags.storage.limits import MAX_SEQUENCE

_MAX_TEXT = 1 << 15
# Elements of all arrays of messages and strings: rosbags writes a line of code for each.
_MAX_ELEMENTS = 10_000
_TYPE_NAME = re.compile(r'[A-Za-z][A-Za-z0-9_]*/(msg|srv|action)/[A-Za-z][A-Za-z0-9_]*')


@cache
def jazzy() -> Typestore:
    """The messages of ROS 2 Jazzy."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.max_sequence_length = MAX_SEQUENCE
    return store


def types_of(connection: Connection) -> Typestore:
    """Deserialiser for the messages of a topic; a definition that is known here is not parsed.

    Raises ReaderError without a usable definition, or any error of rosbags' parser.
    """
    if _is_known(connection):
        return jazzy()
    name, (kind, text) = connection.msgtype, connection.msgdef
    if kind != MessageDefinitionFormat.MSG or not _TYPE_NAME.fullmatch(name):
        msg = f'no definition of its type {name!r} that can be read, wanted one in .msg format'
        raise ReaderError(msg)
    if len(text) > _MAX_TEXT:
        msg = f'definition of its type {name} has {len(text)} bytes, at most {_MAX_TEXT} are read'
        raise ReaderError(msg)
    types = get_types_from_msg(text, name)
    arrays = (
        each
        for _, fields in types.values()
        for _, each in fields
        if each[0] == Nodetype.ARRAY
        and (each[1][0][0] == Nodetype.NAME or each[1][0][1][0] == 'string')
    )
    if sum(each[1][1] for each in arrays) > _MAX_ELEMENTS:
        msg = f'definition of its type {name} has arrays of more than {_MAX_ELEMENTS} messages'
        raise ReaderError(msg)
    store = get_typestore(Stores.EMPTY)
    store.max_sequence_length = MAX_SEQUENCE
    store.register(types)
    return store


def known_definition(msgtype: str) -> MessageDefinition | None:
    """Definition of a type of ROS 2 Jazzy; None for any other."""
    if msgtype not in jazzy().fielddefs:
        return None
    text, _ = jazzy().generate_msgdef(msgtype, ros_version=2)
    return MessageDefinition(MessageDefinitionFormat.MSG, text)


def _is_known(connection: Connection) -> bool:
    name, text = connection.msgtype, connection.msgdef.data
    if name not in jazzy().fielddefs:
        return False
    if connection.digest:
        return connection.digest == jazzy().hash_rihs01(name)
    return not text or connection.msgdef == known_definition(name)
