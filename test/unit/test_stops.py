"""doc/user/stops.md has every sentence that the guidance law and its node can say."""

import ast
import re
from pathlib import Path

import pytest

from cmpsp_ros.mpsp.qp import QPStatus

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / 'doc' / 'user' / 'stops.md').read_text(encoding='utf-8')

# Descriptions of settings and warnings before a run are on other pages; these answer no odometry.
ELSEWHERE = {'feasibility_precheck.py', 'solver_settings.py'}
ANSWERS = {'Time 0 is the next odometry.', '… The node goes on without.', 'A rehearsal.'}

SENTENCE = re.compile(r'[A-Z… ].* [a-z].*([.?]|: …)')


def said(path):
    """Sentences in a module, `…` for what varies; docstrings are none."""
    tree = ast.parse(path.read_text(encoding='utf-8'))
    apart = {id(each.value) for each in ast.walk(tree) if isinstance(each, ast.Expr)}
    for each in ast.walk(tree):
        if isinstance(each, ast.JoinedStr):
            apart |= {id(part) for part in each.values}
    for each in ast.walk(tree):
        if id(each) in apart:
            continue
        text = ''
        if isinstance(each, ast.JoinedStr):
            parts = (part.value if isinstance(part, ast.Constant) else '…' for part in each.values)
            text = ''.join(parts)
        elif isinstance(each, ast.Constant) and isinstance(each.value, str):
            text = each.value.replace('{}', '…')
        if SENTENCE.fullmatch(text) and text not in ANSWERS:
            yield re.sub(r': … ?…$', ': …', re.sub('…: …$', '…', text)).strip()


SOURCES = [
    *(each for each in (ROOT / 'cmpsp_ros/guidance').rglob('*.py') if each.name not in ELSEWHERE),
    *(ROOT / 'cmpsp_ros/nodes/guidance').rglob('*.py'),
    ROOT / 'cmpsp_ros/sensing/surroundings.py',
    ROOT / 'cmpsp_ros/nodes/common/health.py',
    ROOT / 'cmpsp_ros/robots/robot.py',
]
# Of the checks before a run one is an answer: that the robot is too far away.
PRECHECK = ROOT / 'cmpsp_ros/guidance/mission/feasibility_precheck.py'


@pytest.fixture(scope='module')
def sentences():
    """All sentences that answer odometry."""
    answers = {text for path in SOURCES for text in said(path)}
    return answers | {text for text in said(PRECHECK) if 'start.tolerance' in text}


def on_page(sentence):
    parts = (re.escape(part) for part in sentence.split('…'))
    return re.search(r'[^|`\n]*'.join(parts), PAGE) is not None


def test_the_page_has_every_sentence(sentences):
    assert {'Waiting for odometry.', 'The plan meets every constraint.'} <= sentences
    assert [each for each in sorted(sentences) if not on_page(each)] == []
    assert QPStatus.FAILED.value in ' '.join(PAGE.split())


def test_every_sentence_of_the_page_is_one_of_them(sentences):
    listed = {
        row.split('|')[1].strip()
        for row in PAGE.splitlines()
        if row.startswith('| ') and not row.startswith('| It says')
    }
    assert len(listed) > 40
    known = [re.compile('.*'.join(map(re.escape, text.split('…')))) for text in sentences]
    unknown = {each for each in listed if not any(form.fullmatch(each) for form in known)}
    # Put together from two parts.
    assert unknown == {'The constraints contradict each other: … m of slack at ….'}
