"""Reports of compilations: with progress before a node is active, as an error after that."""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import TYPE_CHECKING

from cmpsp_ros.guidance import prepare
from cmpsp_ros.mpsp.jit import compilations, progress

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger

    from cmpsp_ros.guidance import GuidanceSettings


def prepare_aloud(settings: GuidanceSettings, logger: RcutilsLogger) -> None:
    """Compile or load everything now: later a control step would have to wait for it.

    Raises:
        ValueError: The settings cannot be worked with.
    """
    began, hints = time.monotonic(), ['compiling, once; `cmpsp warmup` does it beforehand']

    def say(text: str) -> None:
        while hints:
            logger.info(hints.pop())
        logger.info(text)

    with progress(say=say) as kernels:
        prepare(settings)
    if kernels:
        logger.info(f'compiled {len(kernels)} kernels in {time.monotonic() - began:.1f} s')


class LateCompilations:
    """Detects kernels that are compiled while a node is active: each delays a control step."""

    def __init__(self) -> None:
        """Notice nothing yet."""
        self._names: list[str] = []
        self._watch = ExitStack()

    def begin(self) -> None:
        """Notice them from now on."""
        self.end()
        self._names = self._watch.enter_context(compilations())

    def end(self) -> None:
        """Stop the detection; `errors` is kept."""
        self._watch.close()

    def errors(self) -> list[str]:
        """What has been compiled, in a sentence; nothing if all was there."""
        if not self._names:
            return []
        return [f'A control step had to wait for a compiler: {", ".join(self._names)}.']
