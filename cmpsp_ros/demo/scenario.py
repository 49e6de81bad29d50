"""What a demo is asked to run, checked before anything starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.presets import load_parameter_file, parse_assignment
from cmpsp_ros.parameters.road_files import with_road_file
from cmpsp_ros.parameters.settings import check_pace, check_start, guidance_settings
from cmpsp_ros.parameters.table import Values


@dataclass(frozen=True)
class Scenario:
    """A complete, checked set of parameters.

    Attributes:
        name: Preset, or file without its suffix.
        values: Parameters of all nodes.
        settings: The guidance law's part of them.
    """

    name: str
    values: Values
    settings: GuidanceSettings

    @property
    def lockstep(self) -> bool:
        """Whether the simulator waits for the answer to its odometry."""
        return bool(self.values['lockstep'])

    @property
    def duration(self) -> float:
        """Wall time of the run [s]; in lockstep it is shorter."""
        return float(self.settings.final_time / self.values['real_time_factor'])


def load_scenario(preset: str, assignments: Sequence[str], *, lockstep: bool) -> Scenario:
    """Read a preset or parameter file, change it, and check the whole.

    Args:
        preset: Name of a preset, or path of a parameter file.
        assignments: Changes, each as `key=value`.
        lockstep: Whether to run in lockstep whatever the file says.

    Raises:
        ParameterError: A key or value is wrong; names the key, what was found and what is wanted.
    """
    given = load_parameter_file(preset)
    given.update(parse_assignment(each) for each in assignments)
    given = with_road_file(given)
    # The nodes are activated when the recorder listens, and not before.
    given['autostart'] = False
    if lockstep:
        given['lockstep'] = True
    if given.get('lockstep'):
        # Time then stands still while the simulator waits, and all nodes must know.
        given['publish_clock'] = True
    values = TABLE.resolve(given)
    settings = guidance_settings(values)
    check_start(values)
    check_pace(values)
    return Scenario(Path(preset).stem, values, settings)
