"""Runs of presets in lockstep, and the table of doc/user/presets.md that is made from them."""

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).parents[1]
CMPSP: Final = [sys.executable, '-m', 'cmpsp_ros.cli']
PAGE: Final = ROOT / 'doc' / 'user' / 'presets.md'
RUNS: Final = ROOT / '.cache' / 'runs'
ROW: Final = re.compile(r'^\| `(\w+)` \|.* rad/s \|.*\|$', re.MULTILINE)


def drive(preset: str, *more: str, name: str = '') -> Path:
    """Drive a preset in lockstep; return the folder of the run. SystemExit if it fails."""
    folder = RUNS / (name or preset)
    command = [*CMPSP, 'demo', preset, '--lockstep', '--force', '--output', str(folder), *more]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f'{preset}: {done.stderr}')
    return folder


def row(preset: str) -> str:
    """Row of a preset in the table, from a run."""
    run = json.loads((drive(preset) / 'summary.json').read_text(encoding='utf-8'))
    levels = ', '.join(f'{n} {name.replace("_", " ")}' for name, n in run['levels'].items() if n)
    clearance, speed = f'{run["clearance_m"]:+.4f} m', f'{run["max_wheel_speed_rad_s"]:.2f} rad/s'
    return f'| `{preset}` | {end(run)} | {clearance} | {speed} | {levels} |'


def end(run: dict[str, Any]) -> str:
    """Miss at the goals, or the mean speed of a run without a goal."""
    if run.get('speed_m_s') is not None:
        return f'mean speed {run["speed_m_s"]:.4f} m/s'
    goals = run.get('goals', [])
    miss = max((each['miss_m'] for each in goals), default=run['miss_m'])
    return f'{round(miss, 4):g} m' + (f' at {len(goals)} goals' if len(goals) > 1 else '')


def drive_table() -> None:
    """Drive all presets of the table, and write it anew."""
    text = PAGE.read_text(encoding='utf-8')
    PAGE.write_text(ROW.sub(lambda found: row(found[1]), text), encoding='utf-8')
