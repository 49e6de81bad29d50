"""The page over HTTP: for this machine and its own page alone, and nothing in it from elsewhere."""

import http.client
import json
import re
from functools import partialmethod
from http.server import ThreadingHTTPServer
from importlib.resources import files

import pytest

from cmpsp_ros.view import SharedState, ViewError, ViewServer

ELSEWHERE = '127.1'
"""Leads to loopback, and is no address that is known to."""


@pytest.fixture
def state():
    return SharedState(['path'])


@pytest.fixture
def interface():
    """Address at which the server listens."""
    return '127.0.0.1'


@pytest.fixture
def server(state, interface, monkeypatch):
    # It looks twice a second whether it is to end: too seldom for so many tests.
    often = partialmethod(ThreadingHTTPServer.serve_forever, 0.01)
    monkeypatch.setattr(ThreadingHTTPServer, 'serve_forever', often)
    server = ViewServer(state, interface, 0)
    server.start()
    yield server
    server.close()


@pytest.fixture
def get(server):
    """Ask for a path; the answer and its body."""
    port = int(re.match(r'http://127\.0\.0\.1:(\d+)/', server.address)[1])
    connections = []

    def get(path, method='GET', **headers):
        connections.append(http.client.HTTPConnection('127.0.0.1', port, timeout=100.0))
        connections[-1].request(method, path, headers=headers)
        answer = connections[-1].getresponse()
        return answer, answer.read()

    yield get
    for each in connections:
        each.close()


@pytest.mark.parametrize(
    ('path', 'kind'),
    [('/', 'text/html'), ('/page.css', 'text/css'), ('/page.js', 'text/javascript')],
)
def test_the_page_is_there_and_may_load_nothing_from_elsewhere(get, path, kind):
    answer, body = get(path)
    assert answer.status == 200
    assert answer.headers.get_content_type() == kind
    policy = answer.headers['Content-Security-Policy']
    assert "default-src 'none'" in policy
    assert 'unsafe' not in policy
    assert answer.headers['X-Content-Type-Options'] == 'nosniff'
    assert not re.search(rb'https?://|//[a-z]+\.|data:', body)


def test_the_page_makes_no_markup_of_what_it_is_told():
    script = (files('cmpsp_ros.view') / 'assets' / 'page.js').read_text(encoding='utf-8')
    for way in ('innerHTML', 'outerHTML', 'insertAdjacentHTML', 'document.write', 'eval'):
        assert way not in script
    page = (files('cmpsp_ros.view') / 'assets' / 'page.html').read_text(encoding='utf-8')
    assert re.findall(r'<script[^>]*>', page) == ['<script src="page.js">']
    assert 'style=' not in page
    named = set(re.findall(r"(?:element|say|canvas|drawStrip)\('(\w+)'", script))
    assert named <= set(re.findall(r'id="(\w+)"', page))


def test_updates_are_what_is_new(get, state):
    state.show_course(['<b>road</b>'])
    state.add('path', [1.0, 2.0])
    answer, body = get('/updates')
    assert answer.headers.get_content_type() == 'application/json'
    first = json.loads(body)
    assert first['course'] == ['<b>road</b>']
    _, body = get(f'/updates?course={first["course_number"]}&run={first["run"]}&path=1')
    second = json.loads(body)
    assert 'course' not in second
    assert second['series'] == {'path': []}


@pytest.mark.parametrize('query', ['course=x', 'path=1.5', 'run=-2', 'path=' + '9' * 5000])
def test_nonsense_is_refused(get, query):
    answer, _ = get(f'/updates?{query}')
    assert answer.status == 400


@pytest.mark.parametrize('path', ['/nothing', '/../setup.py', '/assets/page.js', '/%2e'])
def test_nothing_else_is_there(get, path):
    assert get(path)[0].status == 404


def test_nothing_can_be_sent(get):
    assert get('/', 'POST')[0].status == 501


@pytest.mark.parametrize('host', ['evil.example', 'evil.example:80', '127.0.0.1.evil.example', ''])
def test_a_foreign_name_for_this_machine_is_refused(get, host):
    for path in ('/', '/updates'):
        assert get(path, Host=host)[0].status == 403


@pytest.mark.parametrize('host', ['localhost', 'localhost:8765', '127.0.0.1:1'])
def test_names_of_this_machine_are_not(get, host):
    assert get('/updates', Host=host)[0].status == 200


def test_on_loopback_nothing_has_to_be_known(server):
    assert server.address.endswith('/')


@pytest.mark.parametrize('interface', [ELSEWHERE])
def test_elsewhere_nothing_is_told_without_the_token(get, server):
    token = server.address.partition('?token=')[2]
    assert len(token) >= 20
    wrong = (
        {},
        {'Cookie': 'cmpsp_view_token=wrong'},
        {'Cookie': f'token={token}'},
        {'Cookie': ';='},
    )
    for headers in wrong:
        for path in (
            '/',
            '/?token=',
            '/?token=wrong',
            '/page.js',
            f'/updates?token={token}',
            '/none',
        ):
            answer, body = get(path, **headers)
            assert answer.status == 401
            assert b'token' in body
            assert token.encode() not in body
            assert answer.headers['Set-Cookie'] is None


@pytest.mark.parametrize('interface', [ELSEWHERE])
def test_elsewhere_the_address_with_the_token_leads_in(get, server, state):
    state.show('place', [1.0])
    path = server.address.partition('/?')[2]
    answer, _ = get(f'/?{path}')
    assert (answer.status, answer.headers['Location']) == (303, '/')
    cookie, *limits = answer.headers['Set-Cookie'].split('; ')
    assert {'HttpOnly', 'SameSite=Strict'} <= set(limits)
    assert get('/', Cookie=cookie)[0].status == 200
    answer, body = get('/updates', Cookie=f'other=1; {cookie}', Host='robot.local:8765')
    assert answer.status == 200
    assert json.loads(body)['place'] == [1.0]


def test_each_server_has_a_token_of_its_own_unless_told_one(state, monkeypatch):
    def address():
        server = ViewServer(state, ELSEWHERE, 0)
        server.close()
        return server.address

    assert len({address().partition('?token=')[2] for _ in range(3)}) == 3
    monkeypatch.setenv('CMPSP_VIEW_TOKEN', 'of-this_robot-7')
    assert address().endswith('?token=of-this_robot-7')


@pytest.mark.parametrize('token', ['short', 'with a space', 'wörtlich12', 'long-enough;but'])
def test_a_token_that_is_none_is_refused_and_not_told(state, monkeypatch, token):
    monkeypatch.setenv('CMPSP_VIEW_TOKEN', token)
    with pytest.raises(ViewError, match=r'CMPSP_VIEW_TOKEN: found .*, 8 or more letters') as error:
        ViewServer(state, ELSEWHERE, 0)
    assert token not in str(error.value)


def test_a_port_that_is_taken_is_named(state):
    first = ViewServer(state, '127.0.0.1', 0)
    port = int(first.address.rsplit(':', 1)[1].strip('/'))
    try:
        with pytest.raises(ViewError, match=rf'127\.0\.0\.1, port {port}: found Address already'):
            ViewServer(state, '127.0.0.1', port)
    finally:
        first.close()


@pytest.mark.parametrize(('host', 'port'), [('127.0.0.1', 70000), ('no.such.host.invalid', 0)])
def test_an_address_that_is_none_is_named(state, host, port):
    with pytest.raises(ViewError, match=rf'{re.escape(host)}, port {port}: found .*, wanted an'):
        ViewServer(state, host, port)
