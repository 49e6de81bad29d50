"""A run of a custom model: it ends with wheels that stay steered, replays, and is audited."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import pytest
from demo_folder import LIMIT

ROOT = Path(__file__).parents[3]

pytestmark = pytest.mark.integration


def test_the_fork_lift_of_the_page_in_lockstep(start_demo, judge, tmp_path, monkeypatch):
    page = (ROOT / 'doc' / 'user' / 'your_model.md').read_text(encoding='utf-8')
    code = re.search(r'^```python\n(.*?)^```$', page, re.MULTILINE | re.DOTALL)[1]
    (tmp_path / 'forklift.py').write_text(code)
    given = re.search(r'cmpsp demo (case3_wide .*?)\n```', page, re.DOTALL)[1]
    monkeypatch.setenv('PYTHONPATH', f'{tmp_path}{os.pathsep}{os.environ.get("PYTHONPATH", "")}')
    folder = tmp_path / 'run'
    running = start_demo(*given.replace('\\', '').split(), '--output', folder)
    assert running.wait(LIMIT) == 0, running.stdout + running.stderr
    summary = json.loads((folder / 'summary.json').read_text())
    assert summary['miss_m'] < 1e-3
    assert summary['clearance_m'] > 0.0
    judge(folder / 'bag')
