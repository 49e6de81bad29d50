"""`cmpsp replay`: the decisions of a bag again, or those of a changed law."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cmpsp_ros.bags import BagError
from cmpsp_ros.cli.options import Assignments, CmdVel, Namespace, Odom, ParamsFile
from cmpsp_ros.cli.terminal import console, errors, exit_on, say
from cmpsp_ros.parameters import ParameterError

if TYPE_CHECKING:
    from cmpsp_ros.bags import Names


def replay(
    bag: Annotated[Path, typer.Argument(help='Bag of a guidance node.')],
    tolerance: Annotated[
        float | None,
        typer.Option(
            min=0.0, metavar='REL', help='Tolerance of floats, for bags of another machine.'
        ),
    ] = None,
    assignments: Assignments = None,
    params_file: ParamsFile = None,
    output: Annotated[
        Path | None, typer.Option(help='What if: new folder; <BAG>_what_if when absent.')
    ] = None,
    namespace: Namespace = None,
    odom: Odom = None,
    cmd_vel: CmdVel = None,
) -> None:
    """Decide again on recorded odometry, and compare the decisions.

    Exit code 0 if all are identical, 1 if any differs, 2 if the bag cannot be used. With --set or
    --params-file it shows what a changed guidance law decides instead.
    """
    from cmpsp_ros.bags import Names  # noqa: PLC0415 (starts faster without)

    names = Names.under(namespace or '', odom or '', cmd_vel or '')
    with exit_on(BagError, ParameterError, code=2):
        if assignments or params_file:
            _what_if(bag, names, assignments or [], params_file, output)
            return
        from cmpsp_ros.bags.replay import replay as again  # noqa: PLC0415 (loads kernels)

        outcome = again.replay(bag, names, tolerance)
    say(outcome)
    if outcome.first is not None:
        raise typer.Exit(1)


def _what_if(
    bag: Path, names: Names, assignments: list[str], params_file: str | None, output: Path | None
) -> None:
    """Show what a changed guidance law decides."""
    from cmpsp_ros.bags.replay import Change, draw_what_if, what_if  # noqa: PLC0415 (loads kernels)
    from cmpsp_ros.parameters import load_parameter_file  # noqa: PLC0415 (starts faster without)
    from cmpsp_ros.parameters.files import parse_assignment  # noqa: PLC0415 (starts faster without)

    base = None if params_file is None else load_parameter_file(params_file)
    change = Change(base, dict(parse_assignment(each) for each in assignments))
    folder = output or bag.with_name(f'{bag.name}_what_if')
    result = what_if(bag, names, change, folder / 'bag')
    title = ', '.join([params_file or 'recorded parameters', *assignments])
    draw_what_if(result, f'What if: {title}', folder / 'what_if.png')
    console().print(str(result), markup=False, highlight=False)
    say(f'{folder}: bag, what_if.png')
    console().print('open loop: the robot followed the recorded commands, not the changed ones')
    for each in result.left_out:
        errors().print(f'left out: {each}: its type is not known here', markup=False)
