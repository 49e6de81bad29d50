"""`cmpsp view`: a running system in a browser."""

from __future__ import annotations

from typing import Annotated

import typer


def view(
    namespace: Annotated[str, typer.Option(help='Namespace of the nodes, as in /r1.')] = '',
    port: Annotated[int, typer.Option(min=0, max=65535, help='Port of the page; 0: any.')] = 8765,
    host: Annotated[
        str, typer.Option(help='Address to listen on; any other requires a token.')
    ] = '127.0.0.1',
) -> None:
    """Show a running system on a page for a browser.

    The page is live and works offline. Ends with SIGINT or SIGTERM.

    Exit code 2 if the page cannot be served.
    """
    from cmpsp_ros.nodes import viewer  # noqa: PLC0415 (loads ROS)

    if viewer.view(host, port, namespace):
        raise typer.Exit(2)
