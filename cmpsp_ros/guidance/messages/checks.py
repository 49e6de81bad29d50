"""What is the same in the checks of all messages."""

from __future__ import annotations

from typing import Any, Final

from cmpsp_ros.guidance.horizon import NANOSECONDS

FARTHEST: Final = 1e8
"""Coordinates beyond which squares and differences mean nothing [m]; no place on Earth."""


def check_frame(what: str, message: Any, frame_id: str, error: type[ValueError]) -> None:
    """Refuse a message in another frame.

    Args:
        what: What it is about, and the verb.
        message: With a header.
        frame_id: The frame wanted.
        error: To raise.
    """
    found = message.header.frame_id
    if found != frame_id:
        raise error(f'{what} in frame {found!r}, wanted {frame_id!r} (frame_id).')


def check_age(
    what: str, key: str, stamp: int, now: int, timeout: float, error: type[ValueError]
) -> None:
    """Refuse a message that does not fit the clock.

    Args:
        what: What it is about, and the verb.
        key: Name of the parameter that is the time-out.
        stamp: Its time stamp [ns].
        now: Present time [ns]; 0 in simulated time until the first /clock comes.
        timeout: Largest age, and how far it may be ahead [s].
        error: To raise.
    """
    age = (now - stamp) / NANOSECONDS
    if age > timeout:
        raise error(f'{what} {age:.3f} s old ({key} {timeout} s); is use_sim_time right?')
    if now > 0 and -age > timeout:
        raise error(
            f'{what} {-age:.3f} s ahead of the clock ({key} {timeout} s); is use_sim_time right?'
        )


def is_place(x: float, y: float) -> bool:
    """Whether coordinates [m] are those of a place on Earth; NaN is not."""
    return abs(x) <= FARTHEST and abs(y) <= FARTHEST
