"""The local grid: what beams clear and mark, what stays, and that nothing drifts."""

import numpy as np
import pytest

from cmpsp_ros.sensing import Beams, LocalGrid
from cmpsp_ros.world.grids import Cell

FREE, OCCUPIED, UNKNOWN = Cell.FREE, Cell.OCCUPIED, Cell.UNKNOWN
SECOND = 1_000_000_000


def beams(ends, hits=True, start=(0.02, 0.02), stamp=0, *, is_sweep=True):
    ends = np.array(ends, dtype=float).reshape(-1, 2)
    hits = np.broadcast_to(np.array(hits), (len(ends),)).copy()
    starts = np.broadcast_to(start, ends.shape).astype(float)
    return Beams(stamp, np.array(start), starts, ends, hits, is_sweep)


def grid(size=4.0, resolution=0.1, memory=100.0):
    return LocalGrid(size, resolution, memory)


def known(local, points, stamp=0):
    return local.at(stamp).at(np.array(points, dtype=float)).tolist()


def test_a_beam_frees_what_it_passes_and_marks_its_end():
    local = grid()
    local.see(beams([(1.05, 0.02)]))
    assert known(local, [(0.02, 0.02), (0.55, 0.05), (0.95, 0.05)]) == [FREE] * 3
    assert known(local, [(1.05, 0.05)]) == [OCCUPIED]
    assert known(local, [(1.15, 0.05), (0.55, 0.15), (-0.15, 0.05)]) == [UNKNOWN] * 3
    local = grid()
    local.see(beams([(1.05, 0.02)], hits=False))
    assert known(local, [(0.95, 0.05), (1.05, 0.05), (1.15, 0.05)]) == [FREE, FREE, UNKNOWN]


def test_what_was_free_when_it_was_seen_last_is_remembered():
    local = grid()
    local.see(beams([(1.05, 0.02)]))
    local.see(beams([(0.02, 1.05)], stamp=9))
    seen = local.at(10, in_sight=5).at(np.array([(0.55, 0.05), (1.05, 0.05), (0.05, 0.55)]))
    assert seen.tolist() == [Cell.REMEMBERED, OCCUPIED, FREE]


@pytest.mark.parametrize('seed', range(20))
def test_exactly_the_cells_that_a_beam_passes_are_freed(seed):
    random = np.random.default_rng(seed)
    start, end = random.uniform(-3.0, 3.0, (2, 2))
    local = grid()
    local.see(beams([end], hits=False, start=start))
    cells = local.at(0)
    points = start + np.linspace(0.0, 1.0, 200_001)[:, None] * (end - start)
    rows, columns = cells.indices(points)
    inside = cells.contains(rows, columns)
    touched = np.zeros_like(cells.cells, dtype=bool)
    touched[rows[inside], columns[inside]] = True
    freed = cells.cells == FREE
    assert (freed & ~touched).sum() == 0
    # A corner that is cut by less than the points are apart may be missed by them alone.
    assert (touched & ~freed).sum() == 0


def test_in_a_sweep_what_is_between_two_beams_is_seen_as_far_as_the_shorter():
    ends = [(1.5, -0.4), (1.5, 0.4)]
    local = grid()
    local.see(beams(ends))
    assert known(local, [(1.15, 0.05), (1.35, 0.25)]) == [FREE] * 2
    assert known(local, [(1.75, 0.05)]) == [UNKNOWN]
    local = grid()
    local.see(beams(ends, is_sweep=False))
    assert known(local, [(1.15, 0.05)]) == [UNKNOWN]
    # One that knows nothing has no length.
    local = grid()
    local.see(beams([(1.5, -0.4), (0.02, 0.02), (1.5, 0.4)], hits=[True, False, True]))
    assert known(local, [(1.15, 0.05)]) == [UNKNOWN]


@pytest.mark.parametrize('is_sweep', [True, False])
def test_what_a_later_beam_passes_through_is_gone_and_a_cloud_shows_nothing_to_be(is_sweep):
    local = grid()
    local.see(beams([(1.05, 0.02)]))
    local.see(beams([(1.85, 0.02)], stamp=1, is_sweep=is_sweep))
    first = FREE if is_sweep else OCCUPIED
    assert known(local, [(1.05, 0.05), (1.85, 0.05)], 1) == [first, OCCUPIED]


def test_a_late_message_takes_no_newer_mark_away():
    """Messages of one sensor may come later than those of another one."""
    local = grid()
    local.see(beams([(1.05, 0.02), (1.05, 0.45)], stamp=2 * SECOND))
    marks = local.hits(2 * SECOND)
    local.see(beams([(1.85, 0.02), (1.02, 0.42)], hits=[False, True], stamp=SECOND))
    assert local.hits(2 * SECOND).tolist() == marks.tolist()
    assert known(local, [(1.45, 0.05)], 2 * SECOND) == [FREE]


def test_a_late_mark_counts_where_nothing_has_been_hit_since():
    """A scanner sees through below what a camera has seen, whose messages come later."""
    local = grid(memory=5.0)
    local.see(beams([(1.85, 0.02)], stamp=2 * SECOND))
    local.stand_at(0.02, 0.02, 0.25, 2 * SECOND)
    local.see(beams([(1.05, 0.02), (0.02, 0.35)], stamp=SECOND, is_sweep=False))
    assert known(local, [(1.05, 0.05), (0.05, 0.35)], 2 * SECOND) == [OCCUPIED] * 2
    assert known(local, [(1.05, 0.05)], 6 * SECOND + 1) == [UNKNOWN]


@pytest.mark.parametrize('is_sweep', [True, False])
def test_a_table_above_the_beams_of_a_scanner_stays_as_long_as_it_is_remembered(is_sweep):
    local = grid(memory=5.0)
    table, behind = [(1.05, 0.05)], [(1.85, 0.05)]
    local.see(beams(table, is_sweep=False))
    for second in range(1, 6):
        local.see(beams(behind, stamp=second * SECOND))
        assert known(local, table, second * SECOND) == [OCCUPIED]
    local.see(beams(behind, stamp=5 * SECOND + 1, is_sweep=is_sweep))
    assert known(local, table, 5 * SECOND + 1) == [FREE]


def test_all_that_sensors_have_marked_of_one_who_moves_is_freed():
    local = grid()
    for is_sweep, hit in ((True, (1.05, 0.02)), (False, (1.15, 0.02))):
        local.see(beams([hit], is_sweep=is_sweep), np.array([7]))
    assert known(local, [(1.05, 0.05), (1.15, 0.05)]) == [OCCUPIED] * 2
    local.release(7)
    assert known(local, [(1.05, 0.05), (1.15, 0.05)]) == [FREE] * 2


def test_beams_that_graze_a_wall_do_not_open_it():
    """Along a wall, with few beams and noise: where it has been seen once it stays."""
    random = np.random.default_rng(1)
    local = LocalGrid(12.0, 0.05, 1e3)
    angles = np.radians(np.arange(-180.0, 180.0))
    wall = np.column_stack([np.arange(-5.0, 5.0, 0.05) + 0.025, np.full(200, 0.54)])
    seen = np.zeros(200, dtype=bool)
    for k in range(150):
        start = np.array([-1.0 + 0.01 * k, 0.0])
        with np.errstate(divide='ignore'):
            lengths = np.where(angles > 0.0, 0.54 / np.sin(angles), np.inf)
        lengths = np.minimum(lengths + 0.005 * random.standard_normal(360), 4.0)
        ends = start + lengths[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
        local.see(beams(ends, lengths < 4.0, start, k))
        occupied = local.at(k).at(wall) == OCCUPIED
        assert not (seen & ~occupied).any()
        seen |= occupied
    assert seen.sum() > 150


def test_what_is_out_of_sight_stays_for_its_time():
    local = grid(memory=5.0)
    local.see(beams([(1.05, 0.02)]))
    points = [(0.55, 0.05), (1.05, 0.05)]
    assert known(local, points, 5 * SECOND) == [FREE, OCCUPIED]
    assert known(local, points, 5 * SECOND + 1) == [UNKNOWN] * 2
    local.see(beams([(1.05, 0.02)], stamp=4 * SECOND))
    assert known(local, points, 5 * SECOND + 1) == [FREE, OCCUPIED]


def test_it_goes_along_by_whole_cells_and_forgets_what_it_leaves():
    local = grid()
    local.see(beams([(1.05, 0.02), (-1.55, 0.02)]))
    before = local.at(0)
    local.center_on(0.73, -0.31)
    after = local.at(0)
    assert after.origin == pytest.approx((before.origin[0] + 0.7, before.origin[1] - 0.4, 0.0))
    assert np.array_equal(after.cells[4:, :-7], before.cells[:-4, 7:])
    assert (after.cells[:4] == UNKNOWN).all()
    assert (after.cells[:, -7:] == UNKNOWN).all()
    local.center_on(0.0, 0.0)
    # Behind it the wall was left.
    assert known(local, [(1.05, 0.05), (-1.55, 0.05)]) == [OCCUPIED, UNKNOWN]
    local.center_on(100.0, 0.0)
    local.center_on(0.0, 0.0)
    assert (local.at(0).cells == UNKNOWN).all()


def test_nothing_drifts_however_long_it_goes():
    random = np.random.default_rng(2)
    walked, fresh = grid(), grid()
    for x, y in random.uniform(-0.3, 0.3, (500, 2)):
        walked.center_on(x, y)
    place = 12_345.678, -9_876.543
    for x, y in np.cumsum(random.uniform(-1.0, 1.0, (500, 2)), axis=0):
        walked.center_on(x, y)
    for local in (walked, fresh):
        local.center_on(*place)
        local.see(beams([(place[0] + 1.03, place[1] + 0.77)], start=place))
    one, other = walked.at(0), fresh.at(0)
    assert one.origin == other.origin
    assert np.array_equal(one.cells, other.cells)
    assert known(walked, [(place[0] + 1.03, place[1] + 0.77)]) == [OCCUPIED]


def test_nothing_is_where_the_robot_stands():
    local = grid()
    local.see(beams([(0.12, 0.02)]))
    local.stand_at(0.02, 0.02, 0.25, 0)
    places = [(0.12, 0.05), (-0.15, 0.05), (0.02, 0.35), (0.02, 0.65)]
    assert known(local, places) == [FREE, FREE, FREE, UNKNOWN]


def test_what_was_seen_beside_the_robot_stays():
    # A scanner that does not see behind never sees it again.
    local = grid()
    local.see(beams([(0.35, 0.05)]))
    local.stand_at(0.02, 0.02, 0.25, 0)
    assert known(local, [(0.35, 0.05), (0.02, 0.35)]) == [OCCUPIED, FREE]


def test_beams_from_and_to_beyond_the_grid():
    local = grid(size=1.0)
    local.see(beams([(30.0, 0.02)], start=(-30.0, 0.02)))
    local.see(beams([(0.35, 30.0)], start=(0.35, 20.0)))
    cells = local.at(0).cells
    assert (cells[5] == FREE).all()
    assert (np.delete(cells, 5, axis=0) == UNKNOWN).all()
