# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The kernel cache must not outlive the sources that it was compiled from."""

from p4pfr_ros.core.jit import sources_digest
import pytest


@pytest.fixture
def sources(tmp_path):
    """Make a package with one module at its top and one in a folder."""
    (tmp_path / 'folder').mkdir()
    (tmp_path / 'top.py').write_text('A = 1\n')
    (tmp_path / 'folder' / 'inner.py').write_text('B = 1\n')
    return tmp_path


@pytest.mark.parametrize('changed', ['top.py', 'folder/inner.py'])
def test_the_digest_changes_with_every_source(sources, changed):
    before = sources_digest(sources)
    (sources / changed).write_text('C = 2\n')
    assert sources_digest(sources) != before


def test_the_digest_changes_if_a_source_moves(sources):
    before = sources_digest(sources)
    (sources / 'folder' / 'inner.py').rename(sources / 'inner.py')
    assert sources_digest(sources) != before


def test_the_digest_is_reproducible(sources):
    assert sources_digest(sources) == sources_digest(sources)
