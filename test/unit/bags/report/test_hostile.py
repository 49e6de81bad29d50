"""Damaged bags: a report or a refusal, and nothing else."""

from __future__ import annotations

import random
import shutil
import warnings

from cmpsp_ros.bags import BagError
from cmpsp_ros.bags.audit import read_record
from cmpsp_ros.bags.report.charts import controls
from cmpsp_ros.bags.report.page import summary
from cmpsp_ros.bags.report.view import view

BAGS = 60


def damage(chance, path):
    (file,) = path.glob('*.mcap')
    data = bytearray(file.read_bytes())
    for _ in range(chance.choice([1, 3, 20, 200])):
        place = chance.randrange(len(data))
        data[place] = chance.choice([0, 127, 255, chance.randrange(256)])
    file.write_bytes(data)


def test_a_damaged_bag_is_shown_or_refused(drive, tmp_path):
    whole, chance = drive.write(tmp_path / 'whole'), random.Random(3)
    outcomes = {'shown': 0, 'refused': 0}
    for number in range(BAGS):
        path = tmp_path / str(number)
        shutil.copytree(whole, path)
        damage(chance, path)
        with warnings.catch_warnings():
            # Numbers that no drive has may overflow on their way to a finding.
            warnings.simplefilter('ignore', RuntimeWarning)
            try:
                views = [view(path, 'bag', read_record(path))]
                assert summary(views)
                assert controls(views)
                outcomes['shown'] += 1
            except BagError:
                outcomes['refused'] += 1
    assert outcomes['shown'] > 0 < outcomes['refused']
