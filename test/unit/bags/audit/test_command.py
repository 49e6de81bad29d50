"""`cmpsp audit`: exit codes and words."""

from commands import command


def test_a_clean_drive_is_exit_code_0(drive, tmp_path):
    done = command('audit', drive.write(tmp_path / 'bag'), '--junit', tmp_path / 'audit.xml')
    assert done.exit_code == 0, done.output
    assert 'Path: clear of obstacles' in done.output
    assert 'No margin was asked for' in done.output
    assert (tmp_path / 'audit.xml').exists()


def test_a_wrong_command_is_exit_code_1(drive, tmp_path):
    drive.commands[drive.at(4.0)].twist += [0.0, 0.01]
    done = command('audit', drive.write(tmp_path / 'bag'))
    assert done.exit_code == 1
    assert 'failed Commands: as decided: 1 of 53 commands' in done.output


def test_a_bag_that_lacks_data_is_exit_code_3(drive, tmp_path):
    done = command('audit', drive.until(4.1).write(tmp_path / 'bag'))
    assert done.exit_code == 3
    assert 'not judged Path: goal at the final time: The recording ends 5.9 s' in done.output


def test_a_bag_of_another_robot_is_audited_by_a_file(drive, tmp_path):
    drive = drive.without_node()
    drive.odom = 'wheels/odom'
    bag = drive.write(tmp_path / 'bag')
    done = command('audit', bag, '--odom', '/wheels/odom', '--params-file', 'case3')
    assert done.exit_code == 0, done.output
