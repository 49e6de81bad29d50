"""Every folder of modules is a package, or an installation would lack it."""

from pathlib import Path

from setuptools import find_packages

ROOT = Path(__file__).parents[2]


def test_every_folder_of_modules_is_installed():
    modules = (ROOT / 'cmpsp_ros').rglob('*.py')
    folders = {'.'.join(each.parent.relative_to(ROOT).parts) for each in modules}
    assert folders == set(find_packages(str(ROOT), include=['cmpsp_ros', 'cmpsp_ros.*']))
