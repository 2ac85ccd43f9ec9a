# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The kernel cache must not outlive the sources that it was compiled from."""

from p4pfr_ros.core.jit import sources_digest
import pytest


@pytest.fixture
def sources(tmp_path):
    """Make a package with a module at the top and one in a subfolder."""
    (tmp_path / 'room').mkdir()
    (tmp_path / 'top.py').write_text('A = 1\n')
    (tmp_path / 'room' / 'inner.py').write_text('B = 1\n')
    return tmp_path


@pytest.mark.parametrize('changed', ['top.py', 'room/inner.py'])
def test_digest_follows_every_source(sources, changed):
    before = sources_digest(sources)
    (sources / changed).write_text('C = 2\n')
    assert sources_digest(sources) != before


def test_digest_follows_moved_sources(sources):
    before = sources_digest(sources)
    (sources / 'room' / 'inner.py').rename(sources / 'inner.py')
    assert sources_digest(sources) != before


def test_digest_of_the_same_sources_is_the_same(sources):
    assert sources_digest(sources) == sources_digest(sources)
