"""Among many random bags no flawed one is called clean, and no clean one fails."""

import math
from collections import Counter
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from courses import PATH, SIGHTING, drive, moved_into, narrowed, random_course, seen_course

from cmpsp_ros.bags.audit import CheckOutcome, audit, overall

CLEAN, FAILED, NOT_JUDGED = (CheckOutcome[key] for key in ('PASSED', 'FAILED', 'NOT_JUDGED'))
NOT_CLEAN, NOT_FAILED = {FAILED, NOT_JUDGED}, {CLEAN, NOT_JUDGED}

TOUCHES = -1e-3
CERTAIN = -0.1
"""Depth from which on a contact is certain by sensors alone [m]."""


def truly(course):
    """Properties of a drive without holes."""
    return {CLEAN if course.clearance().min() > 0.0 and course.arrived else FAILED}


def with_hole(course, begin, end, topics=None):
    """A recording that lacks some topics, or all, for a time; and what may be said of it."""
    lacking = course.without(
        lambda topic, s: begin < s < end and topics in (None, topics_of(topic))
    )
    # By as much as the next samples may lie apart the hole is longer.
    outside = replace(course, holes=((begin - 0.05, end + 0.05),))
    if outside.clearance().min() < TOUCHES:
        return lacking, {FAILED}
    return lacking, NOT_CLEAN if course.clearance().min() < TOUCHES else {NOT_JUDGED}


def topics_of(topic):
    return PATH if topic in PATH else topic


def damaged(course, random):
    """A good drive, and what may become of its bag: kind, course and what may be said of it."""
    final = course.guidance['final_time']
    moved, narrow = moved_into(course, random), narrowed(course, random)
    yield 'clean', course, truly(course)
    yield 'touches', moved, {FAILED}
    yield 'leaves the road', narrow, {FAILED}
    for name, each in (('clean', course), ('touching', moved), ('off the road', narrow)):
        length = random.uniform(0.5, 3.0)
        begin = random.uniform(0.3, final - length - 0.3)
        yield f'{name}, path lost', *with_hole(each, begin, begin + length, PATH)
        yield f'{name}, all lost', *with_hole(each, begin, begin + length)
        end = random.uniform(0.1, 0.95) * final
        yield f'{name}, cut off', *with_hole(each, end, math.inf)
        yield f'{name}, begun late', *with_hole(each, -math.inf, random.uniform(0.3, 0.7) * final)
    for topic in PATH:
        lost = course.without(lambda at, s, topic=topic: at == topic and begin < s < begin + length)
        yield f'clean, {topic} lost', lost, NOT_FAILED
        lost = moved.without(lambda at, s, topic=topic: at == topic and begin < s < begin + length)
        yield f'touching, {topic} lost', lost, {FAILED}


def with_sensors(number, random):
    """Drives past what only a scanner shows."""
    course = drive(seen_course(number, 2))
    yield 'clean', course, truly(course)
    yield from damaged(course, random)
    biased = drive(seen_course(number, 2, **{'noise.bias': [0.0, 0.1, 0.0], 'goal.tolerance': 0.2}))
    yield 'biased odometry', biased, truly(biased)
    unknown = replace(course, sim=None)
    yield 'sensors alone', unknown, truly(course)
    yield 'scans alone', without(unknown, SIGHTING), truly(course)
    yield 'sightings alone', without(unknown, '/scan'), truly(course)
    yield 'nothing seen', without(unknown, SIGHTING, '/scan'), {NOT_JUDGED}
    blind = drive(seen_course(number, 2, **{'sim.scan.missed_return': 1.0}))
    yield 'blind', blind, truly(blind)
    yield 'blind, no simulator', replace(blind, sim=None), {NOT_JUDGED}
    heedless = drive(seen_course(number, 2), sees=False)
    least = heedless.clearance().min()
    said = {FAILED} if least < CERTAIN else NOT_CLEAN if least < TOUCHES else NOT_FAILED
    yield 'heedless', heedless, truly(heedless)
    unknown = replace(heedless, sim=None)
    for name, missing in (
        ('', ()),
        (', scans alone', (SIGHTING,)),
        (', sightings alone', ('/scan',)),
    ):
        yield f'heedless, no simulator{name}', without(unknown, *missing), said


def without(course, *topics):
    return course.without(lambda topic, _: topic in topics)


def bags(rings, corridors):
    """All kinds of bags, of some drives on rings and down corridors."""
    number = 0
    while rings:
        noise = {'noise.position_stddev': 0.003} if number % 3 == 2 else {}
        course = drive(random_course(number, **noise))
        if course.clearance().min() > 0.02 and course.arrived:
            yield from damaged(course, np.random.default_rng([1, number]))
            rings -= 1
        number += 1
    for number in range(corridors):
        yield from with_sensors(number, np.random.default_rng([2, number]))


def judged(chosen, folder):
    """Audit bags: how many there are of each kind and outcome, and those judged wrongly."""
    counts, wrong = Counter(), []
    for number, (kind, course, allowed) in enumerate(chosen):
        findings = audit(course.write(folder / str(number)))
        said = overall(findings)
        counts[kind, said.value] += 1
        if said not in allowed:
            words = [f'{each.outcome.value} {each.title}: {each.sentence}' for each in findings]
            least = f'{course.clearance().min():.4f} m'
            wrong.append('\n'.join([f'{number} {kind}: {said.value}, {least}', *words]))
    return counts, wrong


def test_a_bag_of_each_kind_is_judged_as_it_is(tmp_path):
    counts, wrong = judged(bags(1, 0), tmp_path)
    assert not wrong, '\n\n'.join(wrong)
    outcomes = {said for _, said in counts}
    assert outcomes == {each.value for each in (CLEAN, FAILED, NOT_JUDGED)}


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_of_a_thousand_bags_none_is_judged_wrongly(tmp_path):
    counts, wrong = judged(islice(bags(29, 17), 1000), tmp_path)
    for (kind, said), count in sorted(counts.items()):
        print(f'{count:4d} {kind}: {said}')
    assert sum(counts.values()) == 1000
    assert not wrong, '\n\n'.join(wrong)
