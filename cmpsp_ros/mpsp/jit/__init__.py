"""Compiled kernels and where they are kept; the one place that knows numba."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.mpsp.jit.cache import kernel_folder, prune, wanted_place
    from cmpsp_ros.mpsp.jit.compiled import (
        address_of,
        allocation_free,
        call,
        entry_for,
        inlined,
        inner,
    )
    from cmpsp_ros.mpsp.jit.stage_code import StageCode
    from cmpsp_ros.mpsp.jit.transfer import TransferError, export_kernels, import_kernels
    from cmpsp_ros.mpsp.jit.watch import ProgressLine, compilations, progress

__getattr__, __all__ = lazy_exports(__name__, __file__)
