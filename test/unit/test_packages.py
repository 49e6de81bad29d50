"""Every folder of modules is a package, or an installation would lack it."""

from importlib import import_module
from pathlib import Path

from setuptools import find_packages

ROOT = Path(__file__).parents[2]


def test_every_folder_of_modules_is_installed():
    modules = (ROOT / 'cmpsp_ros').rglob('*.py')
    folders = {'.'.join(each.parent.relative_to(ROOT).parts) for each in modules}
    assert folders == set(find_packages(str(ROOT), include=['cmpsp_ros', 'cmpsp_ros.*']))


def test_no_name_that_a_package_offers_is_one_of_its_modules():
    """Whoever imports the module first would find it in place of what it defines."""
    for front in (ROOT / 'cmpsp_ros').rglob('__init__.py'):
        if 'lazy_exports' in front.read_text(encoding='utf-8'):
            package = import_module('.'.join(front.parent.relative_to(ROOT).parts))
            modules = {each.stem for each in front.parent.iterdir()}
            assert not modules & set(package.__all__), package
