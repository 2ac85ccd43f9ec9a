# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Settings of Sphinx, which builds docs/ into a site: `make docs`, or rosdoc2 on docs.ros.org.

The pages are Markdown that GitHub renders as well. Links that leave docs/ (to source files,
folders, the README) work there; on the site they become links to the repository if package.xml
names it, else plain text.
"""

from __future__ import annotations

from fnmatch import fnmatch
from importlib.util import find_spec
from pathlib import Path
import re
import sys
from typing import Any
import xml.etree.ElementTree

from docutils import nodes
from sphinx import addnodes


def _package_root() -> Path:
    """Return the folder of package.xml; rosdoc2 executes this file from a copy that names it."""
    here = Path(__file__).resolve()
    original = re.search(r'exec\(open\("(.+?)"\)', here.read_text(encoding='utf-8'))
    return (Path(original[1]) if original else here).parents[1]


ROOT = _package_root()
_PACKAGE_XML = xml.etree.ElementTree.parse(ROOT / 'package.xml').getroot()
_REPOSITORY = _PACKAGE_XML.findtext('url[@type="repository"]', '').removesuffix('.git')
sys.path.insert(0, str(ROOT))

STANDARD_DOCUMENTS = ('CONTRIBUTING.md', 'SECURITY.md', 'CHANGELOG.rst')

project = 'p4pfr_ros'
author = 'p4pfr_ros maintainers'
project_copyright = f'2026, {author}'
release = version = _PACKAGE_XML.findtext('version', '')

extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.autosummary',
    'sphinx.ext.mathjax',
    'sphinx.ext.napoleon',
]
templates_path = ['_templates']
# What rosdoc2 adds: pages of all modules, and copies of the README.
exclude_patterns = ['__*', 'modules.rst', 'p4pfr_ros*.rst', 'standard*', 'user_docs*']
# Anchors of headings down to this level, made as GitHub makes them.
myst_heading_anchors = 4
myst_enable_extensions = ['dollarmath']

autodoc_member_order = 'bysource'
autodoc_typehints = 'signature'
autodoc_default_options = {'members': True}
autodoc_preserve_defaults = True
autodoc_type_aliases = {name: name for name in ('Array', 'ArrayLike', 'Board', 'Ints', 'Mask')}
napoleon_google_docstring = False
# Our `Returns` sections are sentences; the type is in the signature.
napoleon_custom_sections = ['Returns', 'Yields']
python_use_unqualified_type_names = True

html_theme = 'furo' if find_spec('furo') else 'alabaster'
html_title = f'{project} {release}'
html_static_path = ['_static']
html_css_files = ['site.css']
html_show_sphinx = False

# rosdoc2 mocks modules that are not installed; all others are left as above.
rosdoc2_settings = {'enable_intersphinx': False, 'automatically_extend_intersphinx_mapping': False}


def _list_other_pages(app: Any, docname: str, source: list[str]) -> None:
    """Append the pages that no table of contents of the index names, so that new ones join."""
    if docname != 'index':
        return
    named = re.findall(r'^   ([\w/*]+)$', source[0], re.MULTILINE)
    pages = sorted(path.stem for path in Path(app.srcdir).glob('*.md'))
    others = [p for p in pages if not any(fnmatch(p, pattern) for pattern in named)]
    if others:
        head = ['', '.. toctree::', '   :hidden:', '   :caption: More', '', '']
        source[0] += '\n'.join(head) + '\n'.join(f'   {page}' for page in others) + '\n'


def _link_to_repository(app: Any, doctree: nodes.document) -> None:
    """Replace the links of a page that leave docs/: the site has no such pages."""
    page = ROOT / 'docs' / app.env.docname
    for link in list(doctree.findall(addnodes.pending_xref)):
        target, _, anchor = link.get('reftarget', '').partition('#')
        path = (page.parent / target).resolve()
        leaves = path.is_relative_to(ROOT) and not path.is_relative_to(ROOT / 'docs')
        if link.get('reftype') != 'myst' or not (target and leaves and path.exists()):
            continue
        link.replace_self(_linked(link.children, path, anchor))
    for link in list(doctree.findall(addnodes.download_reference)):
        path = (page.parent / link['reftarget']).resolve()
        if path.is_relative_to(ROOT):
            link.replace_self(_linked(link.children, path, ''))


def _linked(text: list[nodes.Node], path: Path, anchor: str) -> list[nodes.Node]:
    """Return a link to a file or folder of the repository, or its text alone."""
    if not _REPOSITORY:
        return text
    url = f'{_REPOSITORY}/blob/HEAD/{path.relative_to(ROOT)}' + (f'#{anchor}' if anchor else '')
    return [nodes.reference('', '', *text, refuri=url, internal=False)]


# Bars around formulas such as |d|², which reStructuredText would take for substitutions.
_BARS = re.compile(r'(``[^`]*``)|\|')


def _prepare_for_napoleon(
    app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]
) -> None:
    if what == 'property' and lines:
        # Napoleon takes what is before a colon for a type.
        lines[0] = lines[0].replace(': ', ' – ')
    text = '\n'.join(lines)
    lines[:] = _BARS.sub(lambda m: m[1] or '\\|', text).split('\n')


def _copy_standard_documents(app: Any) -> None:
    """Put the documents of the root folder below docs/project, with links that lead there."""
    folder = Path(app.srcdir) / 'project'
    folder.mkdir(exist_ok=True)
    for name in STANDARD_DOCUMENTS:
        text = (ROOT / name).read_text(encoding='utf-8')
        text = re.sub(r'\]\((?!https?:|#)', '](../../', text).replace('](../../docs/', '](../')
        page = folder / name.lower()
        if not page.exists() or page.read_text(encoding='utf-8') != text:
            page.write_text(text, encoding='utf-8')


def setup(app: Any) -> None:
    """Connect the functions above to Sphinx."""
    app.connect('builder-inited', _copy_standard_documents)
    app.connect('source-read', _list_other_pages)
    app.connect('env-get-outdated', lambda *_: ['index'])
    app.connect('doctree-read', _link_to_repository)
    app.connect('autodoc-process-docstring', _prepare_for_napoleon, priority=100)
