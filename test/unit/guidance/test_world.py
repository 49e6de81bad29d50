"""The world as one value: what is handed to another process."""

import pickle

import numpy as np
from scenarios import CASES


def test_a_copy_for_another_process_has_no_addresses_of_compiled_code():
    settings = CASES['case 3']
    world, pose = settings.world, np.array([[0.0, -9.25, 0.0]])
    before = world.free_space(settings).at(pose)
    copy = pickle.loads(pickle.dumps(world))
    assert not copy.__dict__.get('_spaces')
    np.testing.assert_array_equal(copy.free_space(settings).at(pose), before)
