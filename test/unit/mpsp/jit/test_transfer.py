"""Kernels go from one computer to an equal one, and to no other."""

import io
import tarfile

import pytest

from cmpsp_ros.mpsp.jit import TransferError, allocation_free, export_kernels, import_kernels


@pytest.fixture
def exported(folder, tmp_path):
    """A file with the one kernel of this folder."""

    @allocation_free
    def successor(x):
        return x + 1

    assert successor(1) == 2
    assert export_kernels(tmp_path / 'kernels.tar') == 1
    return tmp_path / 'kernels.tar'


def changed(path, change):
    """A copy of a file whose contents are changed by name."""
    copy = path.with_name('changed.tar')
    with tarfile.open(path) as archive, tarfile.open(copy, 'w') as other:
        for member in archive.getmembers():
            content = change(member.name, archive.extractfile(member).read())
            info = tarfile.TarInfo(member.name)
            info.size = len(content)
            other.addfile(info, io.BytesIO(content))
    return copy


def test_what_was_exported_comes_back(folder, exported):
    (kernel,) = folder.glob('*.kernel')
    content = kernel.read_bytes()
    kernel.unlink()
    assert import_kernels(exported) == 1
    assert kernel.read_bytes() == content


@pytest.mark.parametrize(
    ('name', 'old', 'new'),
    [
        ('versions', b'numba ', b'numba 7.'),
        ('processor', b'"processor": "', b'"processor": "other '),
        ('code of cmpsp_ros', b'"code of cmpsp_ros": "', b'"code of cmpsp_ros": "0'),
    ],
)
def test_a_difference_is_refused_and_named(folder, exported, name, old, new):
    other = changed(exported, lambda _, content: content.replace(old, new, 1))
    (kernel,) = folder.glob('*.kernel')
    kernel.unlink()
    with pytest.raises(TransferError, match=f'changed.tar: {name}: found .*, wanted '):
        import_kernels(other)
    assert [*folder.glob('*.kernel')] == []


def test_damage_is_refused(exported):
    def cut(name, content):
        return content[:-1] if name.endswith('.kernel') else content

    with pytest.raises(TransferError, match=r'successor.*found a damaged kernel'):
        import_kernels(changed(exported, cut))


@pytest.mark.parametrize('content', [b'', b'text', None])
def test_what_is_no_such_file_is_refused(folder, tmp_path, content):
    path = tmp_path / 'wrong.tar'
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(TransferError, match=r'wrong\.tar: '):
        import_kernels(path)
