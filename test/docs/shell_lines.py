# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Runs or checks the lines of a shell block.

``p4pfr`` runs in this process, in the current folder. Of other commands, names and options are
compared with what the repository has. Anything else is an error: it needs `not run`.
"""

from __future__ import annotations

from contextlib import redirect_stdout
from glob import glob
from importlib import metadata
import io
from pathlib import Path
import re
import shlex

from blocks import ROOT
from p4pfr_ros import cli
from ros_lines import check_ros2, check_ros_arguments, nodes

# Commands that run until they are stopped, or start other processes: their arguments are checked.
NOT_STARTED = {'batch', 'demo', 'live'}


def run_lines(text):
    """Run a block of shell lines; return what they print."""
    printed = ''
    text = text.replace('$(ros2 pkg prefix --share p4pfr_ros)', str(ROOT))
    for line in text.replace('\\\n', ' ').splitlines():
        words = shlex.split(line, comments=True)
        while words:
            end = words.index('&&') if '&&' in words else len(words)
            printed += _run([word.replace('$PWD', str(Path.cwd())) for word in words[:end]])
            words = words[end + 1 :]
    return printed


def _run(words):
    program, *rest = words
    if program == 'p4pfr':
        return _run_p4pfr(rest)
    if program.startswith('.ci/') and not rest:
        assert (ROOT / program).exists(), program
        return ''
    checks = {
        'ros2': check_ros2,
        'python': _check_python,
        'make': _check_make,
        'pip': _check_pip,
        'export': _check_export,
    }
    assert program in checks, f'cannot run {program}: mark the block with <!-- not run: REASON -->'
    checks[program](rest)
    return ''


def _run_p4pfr(words):
    arguments = [name for word in words for name in (sorted(glob(word)) or [word])]
    if NOT_STARTED & set(arguments[:1]):
        cli._parser().parse_args(arguments)
        return ''
    printed = io.StringIO()
    with redirect_stdout(printed):
        try:
            status = cli.main(arguments)
        except SystemExit as end:  # of argparse, as --version
            status = end.code
    assert not status, f'exit status {status}'
    return printed.getvalue()


def _check_python(words):
    if words[0] == '-m':
        module, rest = words[1], words[2:]
        path = ROOT / (module.replace('.', '/') + '.py')
        assert path.exists(), path
        if module.rpartition('.')[2] in nodes():
            check_ros_arguments(module.rpartition('.')[2], rest)
            return
        sources = ''.join(p.read_text(encoding='utf-8') for p in path.parent.glob('*.py'))
    else:
        path, rest = ROOT / words[0], words[1:]
        sources = path.read_text(encoding='utf-8')
    # Options and, of our example nodes, remaps and parameters.
    for word in rest:
        name = word.partition(':=')[0]
        if (name.startswith('--') or ':=' in word) and name != '--ros-args':
            assert f"'{name}'" in sources, f'{path.name} has no {name}'


def _check_make(words):
    makefile = (ROOT / 'Makefile').read_text(encoding='utf-8')
    for word in words:
        if '=' not in word:
            assert re.search(rf'^{word}:', makefile, re.MULTILINE), f'make has no {word}'


def _check_export(words):
    for word in words:
        name, _, value = word.partition('=')
        assert re.fullmatch('[A-Z_]+', name), name
        assert not value.startswith(str(ROOT)) or Path(value).exists(), value


def _check_pip(words):
    verb, what = words
    assert verb == 'install'
    extras = re.search(r'\[(.*)\]', what)
    known = metadata.metadata('p4pfr_ros').get_all('Provides-Extra')
    assert extras is None or set(extras[1].split(',')) <= set(known), what
