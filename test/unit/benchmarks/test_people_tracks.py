"""Quality of tracks, on a short run among people and in a room without any."""

from itertools import islice

import numpy as np

from benchmarks.people_tracks import COLUMNS, crowd, judged, row, static_room


def test_people_are_tracked_where_they_walk():
    score = judged(islice(crowd('hall', 4, (0.0, 0.0), 0.0), 200))
    assert score.visible > 300
    assert score.covered > 0.9 * score.visible
    place, velocity, *_ = np.median(score.errors, axis=0)
    assert place < 0.03
    assert velocity < 0.15
    assert score.false == 0
    assert len(row(score)) == len(COLUMNS) - 4


def test_nobody_is_tracked_in_a_room_without_people():
    score = judged(islice(static_room(0, 0.3), 200))
    assert score.scans == 200
    assert score.identities == 0
