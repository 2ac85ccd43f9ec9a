# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Reads files, YAML in particular, from anywhere: whatever they hold, in bounded time and memory.

A path may name a pipe that never ends, and a small YAML file may stand for a huge tree (aliases of
aliases), a deep one, or a number of a million digits. Such files get an error in one line.
"""

from __future__ import annotations

from collections.abc import Hashable
import os
import re
import stat
from typing import Any, TYPE_CHECKING

from p4pfr_ros.files.printable import printable, printable_path
from p4pfr_ros.files.yaml_fields import ConfigError
import yaml
from yaml.composer import Composer, ComposerError
from yaml.constructor import ConstructorError, SafeConstructor
from yaml.resolver import Resolver

if TYPE_CHECKING:
    from yaml import SafeLoader as _SafeLoader
else:
    try:
        from yaml.cyaml import CParser
    except ImportError:
        from yaml import SafeLoader as _SafeLoader
    else:

        class _SafeLoader(Composer, CParser, SafeConstructor, Resolver):
            """PyYAML's SafeLoader with the parser of libyaml, which is ten times faster."""

            def __init__(self, stream: str) -> None:
                CParser.__init__(self, stream)
                for base in (Composer, SafeConstructor, Resolver):
                    base.__init__(self)


_MAX_BYTES = 10_000_000
_MAX_VALUES = 50_000
_MAX_LEVELS = 20
_MAX_DIGITS = 100
_MAX_DIRECTIVES = _MAX_DOCUMENTS = 10
_MAX_PROBLEM = 60

# The first section of an .ini file follows a few comments.
_HEAD = 200

_MERGE = 'tag:yaml.org,2002:merge'
_TIMESTAMP = 'tag:yaml.org,2002:timestamp'
_OPENCV = 'tag:yaml.org,2002:opencv-'

# %YAML:1.0 is how OpenCV begins its files; YAML has %YAML 1.1.
_DIRECTIVE = re.compile(r'^%YAML.*$', re.MULTILINE)


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """
    Return the content of a regular file of at most 10 MB; pipes and devices do not block.

    Raises
    ------
    ConfigError
        The file is unreadable, too large, or not a regular file.

    """
    try:
        # Opening alone acts on some devices, so that the path is looked at first.
        _check_regular(path, os.stat(path).st_mode)
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
        with open(descriptor, 'rb') as file:
            _check_regular(path, os.fstat(descriptor).st_mode)
            data = file.read(_MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        raise ConfigError(
            f'{printable_path(path)}: expected a readable file: {reason_of(error)}'
        ) from None
    if len(data) > _MAX_BYTES:
        raise ConfigError(
            f'{printable_path(path)}: expected a file of at most {_MAX_BYTES // 1_000_000} MB'
        )
    return data


def _check_regular(path: str | os.PathLike[str], mode: int) -> None:
    if not stat.S_ISREG(mode):
        raise ConfigError(
            f'{printable_path(path)}: expected a regular file, got {kind_of_file(mode)}'
        )


def reason_of(error: OSError | ValueError) -> str:
    """Return why a path cannot be opened; a ValueError is Python's for a null character in it."""
    if isinstance(error, OSError):
        return error.strerror or type(error).__name__
    return 'its path has a null character'


def kind_of_file(mode: int) -> str:
    """Return what a file is, by its mode, for an error."""
    kinds = {
        stat.S_IFDIR: 'a directory',
        stat.S_IFIFO: 'a pipe',
        stat.S_IFSOCK: 'a socket',
        stat.S_IFLNK: 'a link that leads nowhere',
    }
    return kinds.get(stat.S_IFMT(mode), 'a device')


def read_yaml(path: str | os.PathLike[str]) -> object:
    """
    Parse a YAML file, or one that OpenCV wrote; a repeated key is an error.

    Dates stay text. Empty documents are skipped, such as the end of ``ros2 topic echo``.

    Raises
    ------
    ConfigError
        The file is unreadable or not valid YAML.

    """
    where = printable_path(path)
    try:
        text = read_bytes(path).decode('utf-8-sig')
    except UnicodeDecodeError:
        raise ConfigError(f'{where}: expected text in UTF-8') from None
    # Formats in which programs write calibrations, too, and the way out.
    if text.lstrip().startswith('<'):
        raise ConfigError(f'{where}: expected YAML, got XML: save it as .yaml (cv::FileStorage)')
    if '[image]' in text[:_HEAD]:
        raise ConfigError(f'{where}: expected YAML, got .ini: use ost.yaml of camera_calibration')
    try:
        return _parsed(text)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f', line {mark.line + 1}' if mark else ''
        problem = printable(error.problem or '', _MAX_PROBLEM)
        raise ConfigError(f'{where}{line}: expected YAML: {problem}') from None
    except yaml.YAMLError as error:
        problem = printable(' '.join(str(error).split()), _MAX_PROBLEM)
        raise ConfigError(f'{where}: expected YAML: {problem}') from None
    except (ArithmeticError, AttributeError, LookupError, ValueError):
        # PyYAML lets them escape for values such as !!bool x.
        raise ConfigError(f'{where}: expected YAML: a value does not fit its !! tag') from None


def _parsed(text: str) -> object:
    """Return the only document that is not empty; None without one."""
    if text.lstrip().startswith('%YAML'):
        text = _DIRECTIVE.sub('', text, count=1)
    if len(re.findall(r'^%', text, re.MULTILINE)) > _MAX_DIRECTIVES:
        raise yaml.YAMLError(f'more than {_MAX_DIRECTIVES} directives')
    loader, trees, documents = _Loader(text), [], 0
    try:
        while loader.check_data():  # type: ignore[no-untyped-call]
            tree = loader.get_data()
            documents += 1
            if tree is not None:
                trees.append(tree)
            if len(trees) > 1 or documents > _MAX_DOCUMENTS:
                raise yaml.YAMLError('one document, got several')
    finally:
        loader.dispose()
    return trees[0] if trees else None


class _Loader(_SafeLoader):
    """
    A safe loader of trees of limited depth and size, where an alias counts as what it repeats.

    It rejects repeated keys; YAML keeps the last value silently.
    """

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._level = self._values = 0
        self._sizes: dict[Any, int] = {}

    def compose_node(self, parent: Any, index: Any) -> Any:
        mark = self.peek_event().start_mark  # type: ignore[no-untyped-call]
        is_alias = self.check_event(yaml.AliasEvent)
        self._level += 1
        before = self._values
        if self._level > _MAX_LEVELS:
            raise ComposerError(None, None, f'more than {_MAX_LEVELS} levels', mark)
        node = super().compose_node(parent, index)
        self._values += 1
        if is_alias:
            if node not in self._sizes:
                raise ComposerError(None, None, 'an alias of itself', mark)
            self._values += self._sizes[node]
        if self._values > _MAX_VALUES:
            raise ComposerError(None, None, f'more than {_MAX_VALUES} values', mark)
        self._sizes.setdefault(node, self._values - before)
        self._level -= 1
        return node

    def resolve(self, kind: Any, value: Any, implicit: Any) -> Any:
        # No number is so long; the time to read one grows with the square of its digits.
        if kind is yaml.ScalarNode and len(value) > _MAX_DIGITS:
            return self.DEFAULT_SCALAR_TAG
        return super().resolve(kind, value, implicit)  # type: ignore[no-untyped-call]

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Hashable, Any]:
        seen: set[Hashable] = set()
        for key_node, _ in node.value:
            if key_node.tag == _MERGE:
                continue  # merged values may be overridden
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                continue  # super() rejects it
            if key in seen:
                raise ConstructorError(None, None, f'duplicate key {key!r}', key_node.start_mark)
            seen.add(key)
        return super().construct_mapping(node, deep)

    def construct_number(self, node: yaml.ScalarNode) -> float:
        """Return an integer or a float, which may have its tag written beside it."""
        if len(node.value) > _MAX_DIGITS:
            raise ConstructorError(
                None, None, f'a number of more than {_MAX_DIGITS} digits', node.start_mark
            )
        if node.tag.endswith(':int'):
            return self.construct_yaml_int(node)
        return self.construct_yaml_float(node)

    def construct_opencv(self, _: str, node: yaml.Node) -> Any:
        """Return a matrix of OpenCV as the mapping that it is."""
        if isinstance(node, yaml.MappingNode):
            return self.construct_mapping(node, deep=True)
        raise ConstructorError(None, None, 'a matrix of OpenCV without keys', node.start_mark)


_Loader.add_constructor('tag:yaml.org,2002:int', _Loader.construct_number)
_Loader.add_constructor('tag:yaml.org,2002:float', _Loader.construct_number)
_Loader.add_multi_constructor(_OPENCV, _Loader.construct_opencv)
# Dates stay text: none is needed, and an impossible one would be an error.
_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag != _TIMESTAMP]
    for first, resolvers in Resolver.yaml_implicit_resolvers.items()
}
