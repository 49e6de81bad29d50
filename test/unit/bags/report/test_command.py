"""`cmpsp report`: exit codes and words."""

from commands import command


def test_it_says_what_it_wrote(drive, tmp_path):
    bag, output = drive.write(tmp_path / 'bag'), tmp_path / 'drive.html'
    done = command('report', bag, bag, '--output', output)
    assert done.exit_code == 0, done.output
    assert f'{output}: written' in done.output
    assert f'{output.with_suffix(".png")}: written' in done.output
    again = command('report', bag, '--output', output)
    assert again.exit_code == 2
    assert '--force replaces it' in again.stderr
    assert command('report', bag, '--output', output, '--force').exit_code == 0
