# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The kernel cache must not outlive the sources that it was compiled from."""

import threading

from p4pfr_ros.core import jit, kernel_cache
import pytest


def make(folder):
    """Make a package: ``top`` calls ``inner`` calls ``deep``; nobody calls ``other``."""
    (folder / 'room').mkdir()
    (folder / 'top.py').write_text(
        'from .room.inner import (\n    A,\n)\n\n\ndef f():\n    pass\n'
    )
    (folder / 'room/inner.py').write_text('import math\n\nfrom . import deep\n')
    (folder / 'room/deep.py').write_text(f'from {folder.name}.constants import B\n')
    (folder / 'constants.py').write_text('B = 1\n')
    (folder / 'other.py').write_text('from .top import f\n')
    return folder


@pytest.fixture
def package(tmp_path):
    """Make the package in a folder."""
    return make(tmp_path)


def digest_of_top(package):
    for each in (
        kernel_cache.sources_digest,
        kernel_cache._file_digest,
        kernel_cache._imports_of,
    ):
        each.cache_clear()
    return kernel_cache.sources_digest(package / 'top.py', package)


@pytest.mark.parametrize('changed', ['top.py', 'room/inner.py', 'room/deep.py', 'constants.py'])
def test_the_digest_changes_with_every_source_that_is_called(package, changed):
    before = digest_of_top(package)
    (package / changed).write_text((package / changed).read_text() + '# changed\n')
    assert digest_of_top(package) != before


def test_the_digest_stays_if_another_source_changes(package):
    before = digest_of_top(package)
    (package / 'other.py').write_text('C = 2\n')
    assert digest_of_top(package) == before


def test_the_digest_is_that_of_a_copy(tmp_path):
    """Files that colcon or pip copies have other places and times."""
    folders = [tmp_path / name / 'package' for name in ('first', 'second')]
    for folder in folders:
        folder.mkdir(parents=True)
        make(folder)
    assert digest_of_top(folders[0]) == digest_of_top(folders[1])


@jit.jit
def twice(x):
    return 2.0 * x


@jit.jit
def four_times(x):
    return twice(twice(x))


def test_kernels_call_each_other_and_can_be_called():
    assert four_times(3.0) == 12.0
    assert twice(3.0) == 6.0


@pytest.mark.skipif(not jit.COMPILED, reason='nothing is compiled')
def test_other_threads_interpret_meanwhile():
    """A thread that compiles does not make the others wait."""

    @jit.jit
    def plus_one(x):
        return x + 1.0

    answers = []
    with jit.others_interpret():
        other = threading.Thread(target=lambda: answers.append(plus_one(1.0)))
        other.start()
        other.join()
        assert not plus_one.signatures
        answers.append(plus_one(1.0))
    assert answers == [2.0, 2.0]
    assert len(plus_one.signatures) == 1
