"""Options shared by several commands."""

from __future__ import annotations

from typing import Annotated

import typer

Assignments = Annotated[
    list[str] | None,
    typer.Option('--set', metavar='KEY=VALUE', help='Change a parameter; may be repeated.'),
]
Odom = Annotated[
    str | None, typer.Option(metavar='TOPIC', help='Odometry; <namespace>/odom when absent.')
]
CmdVel = Annotated[
    str | None, typer.Option(metavar='TOPIC', help='Commands; <namespace>/cmd_vel when absent.')
]
Namespace = Annotated[str | None, typer.Option(help='Namespace of the node, as in /r1.')]
ParamsFile = Annotated[
    str | None,
    typer.Option(metavar='FILE', help='Parameters, or a preset, in place of those in the bag.'),
]
