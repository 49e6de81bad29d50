"""Pictures and the table of presets for the pages, from runs that are driven again.

The examples and the benchmark write their pictures with their own pages: `python -m examples` and
`make bench`.
"""

import json
import shutil
import signal
import subprocess
import sys
import time
from http.client import HTTPConnection
from pathlib import Path
from typing import Any, Final

from PIL import Image
from presets import CMPSP, ROOT, RUNS, drive, drive_table

IMAGES: Final = ROOT / 'doc' / 'images'
BROWSERS: Final = ('chromium', 'chromium-browser', 'google-chrome')
WIDTH: Final = 1600
PORT, STEPS = 8794, 37  # of the live page, and decisions on it when it is photographed


def cmpsp(*arguments: str | Path) -> None:
    """Run a verb of `cmpsp`; CalledProcessError if it fails."""
    subprocess.run([*CMPSP, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def keep(picture: Path, name: str) -> None:
    """Store a picture for the pages, in 256 colours and at most `WIDTH` pixels wide."""
    with Image.open(picture) as image:
        image.thumbnail((WIDTH, WIDTH))
        image.convert('RGB').quantize(256).save(IMAGES / f'{name}.png', optimize=True)


def photograph(page: str, name: str, width: int, height: int, wait: int) -> None:
    """Take a picture of a page in a browser without a window, after `wait` ms of its time."""
    browser = next(filter(None, map(shutil.which, BROWSERS)), None)
    if browser is None:
        raise SystemExit(f'pictures: found no browser, wanted one of {", ".join(BROWSERS)}')
    options = ['--headless=new', '--no-sandbox', '--disable-gpu', '--hide-scrollbars']
    options += [f'--user-data-dir={RUNS / "browser"}', f'--window-size={width},{height}']
    options += [f'--virtual-time-budget={wait}', f'--screenshot={RUNS / name}.png', page]
    subprocess.run([browser, *options], check=True, capture_output=True, timeout=120)
    keep(RUNS / f'{name}.png', name)


def live_page() -> None:
    """Draw the live page of a run at a quarter of real time."""
    options = f'--view --port {PORT} --set real_time_factor=0.25 --set odom_timeout=3.0'
    command = [*CMPSP, 'demo', 'case3', *options.split(), '--output', str(RUNS / 'view')]
    driving = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    try:
        while decisions() < STEPS:
            if driving.poll() is not None:
                raise SystemExit(f'pictures: the run ended before it had {STEPS} decisions')
            time.sleep(0.3)
        photograph(f'http://127.0.0.1:{PORT}/', 'view', 1200, 760, 2500)
    finally:
        driving.send_signal(signal.SIGINT)
        driving.wait()


def decisions() -> int:
    """Number of decisions that the live page has; 0 before it is there."""
    connection = HTTPConnection('127.0.0.1', PORT, timeout=2.0)
    try:
        connection.request('GET', '/updates')
        state: dict[str, Any] = json.load(connection.getresponse())
    except OSError:
        return 0
    finally:
        connection.close()
    return len(state['series']['steps'])


def identified() -> None:
    """Draw what is measured of the robot in doc/user/robots.md, which shares no code with ours."""
    robot = [sys.executable, str(ROOT / 'test/integration/foreign_robot.py'), '0.0', '-9.25', '0.0']
    driving = subprocess.Popen([*robot, str(RUNS / 'path.txt')])
    limits = ['--max-speed', '0.3', '--max-turn', '1.5']
    try:
        cmpsp('identify', '--drive', '--yes', *limits, '--output', RUNS / 'identify')
    finally:
        driving.send_signal(signal.SIGINT)
        driving.wait()
    keep(RUNS / 'identify' / 'identify.png', 'identify')


def main() -> None:
    """Draw them all; a run that fails ends it."""
    shutil.rmtree(RUNS, ignore_errors=True)
    RUNS.mkdir(parents=True)
    drive_table()
    for preset in ('case3', 'clutter', 'corridor', 'course', 'parallel_parking', 'warehouse'):
        keep(RUNS / preset / 'trajectory.png', preset)
    physics = drive('case3', '--set', 'plant=mujoco', name='film')
    # at the start, at the first obstacle, past it, before the goal; people at the door
    for folder, times in ((physics, (0.5, 5.5, 6.0, 9.0)), (RUNS / 'doorway', (3, 14, 19, 22))):
        frames = [each for second in times for each in ('--at', str(second))]
        cmpsp('film', folder / 'bag', '--output', folder / 'film.png', *frames)
        keep(folder / 'film.png', folder.name)
    cmpsp('report', RUNS / 'case3' / 'bag', '--output', RUNS / 'report.html')
    photograph((RUNS / 'report.html').as_uri(), 'report', 1280, 1290, 6000)
    live_page()
    identified()


if __name__ == '__main__':
    main()
