# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The metadata of pip and ROS agree, and match what the package imports and installs."""

import ast
from importlib import import_module, metadata
import os
from pathlib import Path
import re
import subprocess
import sys

from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.package import parse_package
import p4pfr_ros
import pytest

ROOT = Path(__file__).parent.parent
NODES = {
    'camera_simulator',
    'dashboard_node',
    'detector_node',
    'lifecycle_pose_node',
    'pose_node',
}

# Names on PyPI and in rosdep of the modules that we import. Others have the module's name.
PYPI = {'cv2': 'opencv-python-headless', 'yaml': 'pyyaml', 'catkin_pkg': 'catkin-pkg'}
ROSDEP = {
    'aiohttp': 'python3-aiohttp',
    'cv2': 'python3-opencv',
    'catkin_pkg': 'python3-catkin-pkg-modules',
    'matplotlib': 'python3-matplotlib',
    'numba': 'python3-numba',
    'numpy': 'python3-numpy',
    'rich': 'python3-rich',
    'tf2_ros': 'tf2_ros_py',  # the package tf2_ros has no Python
    'yaml': 'python3-yaml',
}
# Modules that no package may depend on that ROS's build farm releases: they are imported in a
# `try` only, and users install them. rosbags has a rosdep key that installs it by pip.
NOT_RELEASED = {'distributed', 'isaac_ros_apriltag_interfaces', 'rosbags'}


@pytest.fixture(scope='module')
def package():
    """Return package.xml, parsed and validated."""
    return parse_package(str(ROOT))


def requirements(extra=None):
    """Return the PyPI names of the requirements of the package, or of one of its extras."""
    names = set()
    for line in metadata.requires('p4pfr_ros'):
        marker = re.search(r'extra == "(\w+)"', line)
        if extra == (marker and marker.group(1)):
            names.add(re.match(r'[\w.-]+', line).group().lower())
    return names


def third_parties(*folders):
    """Return the top-level third-party modules imported in folders."""
    return set().union(*(tops for _, tops in imports(*folders)))


def guarded(*folders):
    """Return those that are imported in a ``try`` only, which catches ImportError."""
    plain, tried = (
        set().union(*(tops for is_tried, tops in imports(*folders) if is_tried == wanted))
        for wanted in (False, True)
    )
    return tried - plain


def imports(*folders):
    """Yield for each import of third parties whether it is in a ``try``, and the modules."""
    for path in (p for folder in folders for p in (ROOT / folder).rglob('*.py')):
        tree = ast.parse(path.read_text())
        tried = {id(node) for attempt in ast.walk(tree) for node in attempted(attempt)}
        for node in ast.walk(tree):
            if isinstance(node, ast.Import | ast.ImportFrom):
                yield id(node) in tried, third_party_tops(node)


def attempted(node):
    """Yield what a statement does with ImportError caught or suppressed."""
    if isinstance(node, ast.Try):
        catches = ' '.join(ast.unparse(h.type) for h in node.handlers if h.type)
    elif isinstance(node, ast.With):
        catches = ' '.join(ast.unparse(item) for item in node.items)
    else:
        return
    if re.search('ImportError|ModuleNotFoundError', catches):
        yield from (inner for statement in node.body for inner in ast.walk(statement))


def third_party_tops(node):
    """Return the top-level third-party modules that a statement imports."""
    tops = set()
    if isinstance(node, ast.Import):
        tops = {alias.name.split('.')[0] for alias in node.names}
    elif isinstance(node, ast.ImportFrom) and node.level == 0:
        tops = {node.module.split('.')[0]}
    return tops - set(sys.stdlib_module_names) - {'benchmarks', 'p4pfr_ros'}


def keys(modules):
    """Return the rosdep keys of modules."""
    return {ROSDEP.get(module, module) for module in modules}


def test_version_is_the_same_everywhere(package):
    assert package.version == metadata.version('p4pfr_ros') == p4pfr_ros.__version__


def test_name_licence_and_maintainer_are_the_same_everywhere(package):
    about = metadata.metadata('p4pfr_ros')
    assert package.name == about['Name'].replace('-', '_') == 'p4pfr_ros'
    assert package.licenses == [about['License'] or about['License-Expression']] == ['Apache-2.0']
    [maintainer] = package.maintainers
    assert (maintainer.name, maintainer.email) == (about['Maintainer'], about['Maintainer-email'])


@pytest.mark.filterwarnings('ignore::DeprecationWarning')  # from docutils, which catkin_pkg uses
def test_changelog_follows_rep_132():
    changelog = get_changelog_from_path(str(ROOT / 'CHANGELOG.rst'), 'p4pfr_ros')
    assert p4pfr_ros.__version__ in [version for version, _, _ in changelog.foreach_version()]


def test_package_xml_lists_the_imports(package):
    """Plain and guarded ones, of the package and of the launch files."""
    used = third_parties('p4pfr_ros', 'launch')
    assert guarded('p4pfr_ros', 'launch') >= NOT_RELEASED
    assert {d.name for d in package.exec_depends} == keys(used - NOT_RELEASED)


def test_an_import_is_guarded_if_each_of_its_places_is(tmp_path):
    """In functions, too; in a ``try`` for other errors it is not."""
    (tmp_path / 'a.py').write_text(
        'try:\n    import one, two\nexcept (ImportError, OSError):\n    import three\n'
        'def f():\n    try:\n        from four.inner import x\n    except ValueError: ...\n'
        'with suppress(ImportError):\n    if True:\n        import five\n'
    )
    (tmp_path / 'b.py').write_text('from two import y\nimport os\n')
    assert third_parties(tmp_path) == {'one', 'two', 'three', 'four', 'five'}
    assert guarded(tmp_path) == {'one', 'five'}


def test_setup_py_lists_the_imports():
    used = third_parties('p4pfr_ros')
    from_pypi = {top for top in used if ROSDEP.get(top, '').startswith('python3-')}
    optional = requirements('cli') | requirements('live') | requirements('plot')
    assert requirements() | optional == {PYPI.get(top, top) for top in from_pypi}
    assert not requirements() & optional


@pytest.mark.parametrize(
    ('extra', 'names'),
    [
        ('bags', {'rosbags'}),
        ('cli', {'rich'}),
        ('distributed', {'distributed'}),
        ('live', {'aiohttp'}),
        ('plot', {'matplotlib'}),
    ],
)
def test_optional_dependencies_have_an_extra_and_are_tested(extra, names):
    assert requirements(extra) == names
    assert requirements(extra) <= requirements('test')


def test_extra_and_package_xml_list_the_imports_of_the_tests(package):
    local = {path.stem for folder in ('docs', 'test') for path in (ROOT / folder).rglob('*.py')}
    local.add('node_pages')
    used = third_parties('test') - third_parties('p4pfr_ros') - local - guarded('test')
    from_ros = {'ament_index_python', 'lifecycle_msgs'}  # pip's rclpy requires them
    assert {PYPI.get(top, top) for top in used - from_ros} <= requirements('test')
    rosdep = {ROSDEP.get(t, t if t in from_ros else f'python3-{t}') for t in used}
    assert rosdep <= {depend.name for depend in package.test_depends}


def test_console_script_is_importable():
    [script] = [e for e in metadata.entry_points(group='console_scripts') if e.name == 'p4pfr']
    assert callable(script.load())


@pytest.mark.parametrize('path', sorted((ROOT / 'scripts').iterdir()), ids=lambda p: p.name)
def test_launcher_starts_a_main_that_exists(path):
    assert os.access(path, os.X_OK)
    [module] = re.findall(r'from (\S+) import main', path.read_text())
    assert module == ('p4pfr_ros.cli' if path.name == 'p4pfr' else f'p4pfr_ros.ros.{path.name}')
    assert callable(import_module(module).main)


def test_every_node_and_the_command_have_a_launcher():
    assert {path.name for path in (ROOT / 'scripts').iterdir()} == NODES | {'p4pfr'}


def test_the_launcher_of_the_command_passes_its_arguments():
    """As ``ros2 run p4pfr_ros p4pfr`` does."""
    environment = os.environ | {'PATH': f'{Path(sys.executable).parent}:{os.environ["PATH"]}'}
    out = subprocess.run(
        [ROOT / 'scripts/p4pfr', '--version'],
        env=environment,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert out == f'p4pfr_ros {p4pfr_ros.__version__}\n'


def test_data_files_are_installed():
    from ament_index_python.packages import get_package_share_directory

    share = Path(get_package_share_directory('p4pfr_ros'))
    for pattern in ('package.xml', 'config/*.*', 'config/boards/*.yaml', 'launch/*.launch.py'):
        ours = {str(path.relative_to(ROOT)) for path in ROOT.glob(pattern)}
        assert ours, pattern
        assert ours == {str(path.relative_to(share)) for path in share.glob(pattern)}


def test_the_files_of_the_web_page_are_in_the_package():
    """In a wheel and in a colcon workspace, not only in the sources."""
    web = Path(p4pfr_ros.__file__).parent / 'live' / 'web'
    ours = {path.name for path in (ROOT / 'p4pfr_ros' / 'live' / 'web').iterdir()}
    assert ours == {path.name for path in web.iterdir()}
    assert {'index.html', 'live.css', 'live.js'} <= ours


def test_python_m_runs_the_command():
    out = subprocess.run(
        [sys.executable, '-m', 'p4pfr_ros', '--version'],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert out == f'p4pfr_ros {p4pfr_ros.__version__}\n'
