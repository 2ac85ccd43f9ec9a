# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Workflows, forms and pages agree with the repository; `make docs` has their schemas."""

import os
import re
import subprocess

from blocks import PAGES, ROOT
import p4pfr_ros
import pytest
import yaml

WORKFLOW = yaml.safe_load((ROOT / '.github' / 'workflows' / 'ci.yml').read_text())
SCRIPTS = sorted(path for path in (ROOT / '.ci').iterdir() if not path.suffix)
# Numbers with a decimal point, such as 0.041.
NUMBER = re.compile(r'(?<![\w.])\d+\.\d+(?![\w.])')


@pytest.mark.parametrize('script', SCRIPTS, ids=lambda path: path.name)
def test_scripts_are_executable_and_parse(script):
    assert os.access(script, os.X_OK)
    subprocess.run(['bash', '-n', script], check=True)


def test_workflows_run_our_scripts():
    """All of them that are not part of .ci/run; and every script that is called exists."""
    steps = [step for job in WORKFLOW['jobs'].values() for step in job['steps']]
    called = re.findall(r'\.ci/\w+', '\n'.join(step.get('run', '') for step in steps))
    assert {'.ci/run', '.ci/jazzy', '.ci/wheel'} <= set(called)
    assert all((ROOT / script).exists() for script in called)
    assert WORKFLOW['jobs']['jazzy']['container'] == 'ros:jazzy'


def test_ci_says_that_it_has_no_photographs():
    """Otherwise .ci/run fails where CI is set."""
    assert WORKFLOW['jobs']['checks']['env']['P4PFR_DATA'] == 'none'
    assert WORKFLOW['jobs']['checks']['strategy']['matrix']['python'] == ['3.10', '3.12', '3.13']


@pytest.mark.parametrize(
    ('data', 'status', 'said'),
    [('none', 0, 'none'), ('/nowhere', 1, '/nowhere'), ('photographs', 0, 'photographs')],
)
def test_ci_needs_photographs_or_their_refusal(data, status, said, tmp_path):
    """The first part of .ci/run, with the calls of make replaced by a print."""
    folder = tmp_path / 'photographs'
    folder.mkdir()
    (folder / 'left01.jpg').touch()
    (tmp_path / '.ci').mkdir()
    browser = tmp_path / '.ci' / 'browser'
    browser.write_text('#!/bin/sh\n')
    browser.chmod(0o755)
    script = tmp_path / '.ci' / 'run'
    text = (ROOT / '.ci' / 'run').read_text()
    script.write_text(
        re.sub('^make test$', 'echo "data: ${P4PFR_DATA:-none}"; exit', text, flags=re.M)
    )
    value = str(folder) if data == 'photographs' else data
    run = subprocess.run(
        ['bash', script],
        env={**os.environ, 'CI': 'true', 'P4PFR_DATA': value},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == status, run.stderr
    assert said in run.stdout + run.stderr


def test_the_form_for_bugs_asks_for_what_is_needed():
    form = yaml.safe_load((ROOT / '.github' / 'ISSUE_TEMPLATE' / 'bug.yml').read_text())
    required = {
        field['id']: field['attributes']['label']
        for field in form['body']
        if field.get('validations', {}).get('required')
    }
    assert '10 seconds' in required['bag']
    assert {'bag', 'parameters', 'diagnostics', 'board'} <= set(required)


def test_the_citation_names_the_paper():
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text())
    paper = citation['preferred-citation']
    assert paper['authors'][0]['family-names'] == 'Oskarsson'
    assert '1805.10705' in paper['url']


def test_every_public_name_is_in_the_api_reference():
    """Once, and no other."""
    page = (ROOT / 'docs' / 'api' / 'index.rst').read_text()
    listed = re.findall(r'^   (\w+)$', page, re.MULTILINE)
    subpackages = {'boards', 'detection', 'files', 'rendering', 'scenes'}
    assert sorted(set(listed) - subpackages) == sorted(p4pfr_ros.__all__)
    assert len(listed) == len(set(listed))


def test_figures_of_the_comparison_are_those_of_the_benchmarks():
    """Each number in its tables is a rounded number of the page that its section links to."""
    text = (ROOT / 'docs' / 'comparison.md').read_text()
    checked = 0
    for section in text.split('\n## ')[1:]:
        pages = re.findall(r'\((benchmark_\w+\.md)\)', section)
        numbers = [n for page in pages for n in _numbers((ROOT / 'docs' / page).read_text())]
        for row in re.findall(r'^\|.*\|$', section, re.MULTILINE):
            # Versions of programs are in the heads of tables.
            for figure in NUMBER.findall(row) if pages and '3.0,' not in row else ():
                digits = len(figure.partition('.')[2])
                close = (abs(n - float(figure)) <= 0.51 * 10.0**-digits for n in numbers)
                assert any(close), f'{figure} in {row} is not in {pages}'
                checked += 1
    assert checked > 50


def _numbers(text):
    return [float(number) for number in NUMBER.findall(text)]


@pytest.mark.parametrize('path', PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_lead_to_files(path):
    """As GitHub follows them; `make docs` checks headings, too."""
    text = re.sub(r'```.*?```', '', path.read_text(encoding='utf-8'), flags=re.DOTALL)
    for link in re.findall(r'\]\(([^)\s]+)\)', text):
        target = link.partition('#')[0]
        if target and not re.match(r'https?:|\.\./blob/', link):
            assert (path.parent / target).exists(), link
