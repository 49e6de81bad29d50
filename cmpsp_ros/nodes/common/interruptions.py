"""Interruptions at a time when Python can act on them."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def interruptions_held() -> Iterator[None]:
    """Defer interruptions in the main thread.

    One that comes while Python forks is printed and lost; one that comes inside of rclpy turns
    into a RuntimeError about arguments.
    """
    held: list[int] = []
    before = {each: signal.signal(each, lambda number, _: held.append(number)) for each in SIGNALS}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for each in held[:1]:
            signal.raise_signal(each)
