"""`cmpsp identify`: exit codes, words and files."""

from commands import command
from hidden_robots import Hidden, write_bag


def test_a_bag_gives_a_table_a_file_and_a_picture(tmp_path):
    bag = write_bag(tmp_path / 'bag', Hidden())
    done = command('identify', bag)
    assert done.exit_code == 0, done.output
    for words in ('wheel lag', 'command_delay', 'linear speed limit: not identifiable: not'):
        assert words in done.output
    folder = tmp_path / 'bag_identified'
    assert (folder / 'identify.png').read_bytes()[:4] == b'\x89PNG'
    assert 'command_delay: 0.2' in (folder / 'robot.yaml').read_text(encoding='utf-8')
    again = command('identify', bag)
    assert again.exit_code == 2
    assert 'exists already; --force replaces it' in again.output
    assert command('identify', bag, '--force').exit_code == 0


def test_nothing_to_identify_is_exit_code_2(tmp_path):
    for arguments, words in (
        ((), 'found none, wanted a bag, or --drive'),
        ((tmp_path / 'no', '--output', tmp_path / 'out'), 'no such bag'),
        (('--drive', '--max-speed', '3.0', '--output', tmp_path / 'fast'), 'found a way of'),
    ):
        done = command('identify', *arguments)
        assert (done.exit_code, words in done.output) == (2, True), done.output


def test_nobody_is_driven_without_a_yes(tmp_path):
    done = command('identify', '--drive', '--output', tmp_path / 'out')
    assert done.exit_code != 0
    assert 'Is it clear for 1 m around it? [y/N]' in done.output
    assert not (tmp_path / 'out' / 'bag').exists()
