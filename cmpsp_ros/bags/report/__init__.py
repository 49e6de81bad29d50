"""The report on one or several bags: an HTML page and a picture."""

from collections.abc import Sequence
from pathlib import Path

from cmpsp_ros.bags.audit import Sources, read_record
from cmpsp_ros.bags.errors import BagError, written
from cmpsp_ros.bags.report.page import page
from cmpsp_ros.bags.report.picture import draw_report
from cmpsp_ros.bags.report.view import View, labels, view


def write_report(
    paths: Sequence[Path], output: Path, sources: Sources | None = None, *, force: bool = False
) -> tuple[Path, Path]:
    """Write the report of some bags side by side, a page and a picture; `force` replaces one."""
    picture = output.with_suffix('.png')
    for each in (output, picture):
        if each.exists() and not force:
            raise BagError(f'{each}: exists already; --force replaces it')
    views = [
        view(path, label, read_record(path, sources))
        for path, label in zip(paths, labels(paths), strict=True)
    ]
    text = page(views)
    with written(output):
        output.write_text(text, encoding='utf-8')
    draw_report(views, picture)
    return output, picture
