"""Tells the user of a node why its start takes so long, and how it need not."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from cmpsp_ros.guidance.preparation import prepare
from cmpsp_ros.mpsp.jit.watch import compilations

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger

    from cmpsp_ros.guidance.settings import GuidanceSettings


def prepare_aloud(settings: GuidanceSettings, logger: RcutilsLogger) -> None:
    """Compile or load everything now: later a control step would have to wait for it.

    Raises:
        ValueError: The settings cannot be worked with.
    """
    began = time.monotonic()

    def announce() -> None:
        logger.info('compiling, once; `cmpsp warmup` does it beforehand')

    with compilations(announce) as kernels:
        prepare(settings)
    if kernels:
        logger.info(f'compiled {len(kernels)} kernels in {time.monotonic() - began:.1f} s')
