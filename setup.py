# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Metadata for pip and colcon; colcon does not read it from pyproject.toml."""

from glob import glob
import os
import subprocess
import sys

from setuptools import find_packages, setup
from setuptools.command.install import install

PACKAGE = 'p4pfr_ros'
SHARE = f'share/{PACKAGE}'

# The linters of ROS 2 Jazzy, with the plugins that their package.xml lists.
AMENT_LINTERS = [
    'flake8-blind-except',
    'flake8-builtins',
    'flake8-class-newline',
    'flake8-comprehensions',
    'flake8-deprecated',
    'flake8-docstrings',
    'flake8-import-order',
    'flake8-quotes',
    'ros-ament-flake8<0.18',
    'ros-ament-pep257<0.18',
]


class InstallWithKernels(install):
    """
    Compiles the kernels beside the installed package: they are found whatever cache is in use.

    colcon runs this command. pip does not: a wheel is for all machines. A packager's ``--root`` is
    for others, too.
    """

    def run(self):
        """Install, then compile; without Numba or OpenCV the nodes do so when they start."""
        super().run()
        if 'install' not in sys.argv or self.root:
            return
        path = [os.path.abspath(self.install_lib), os.environ.get('PYTHONPATH', '')]
        done = subprocess.run(
            [sys.executable, '-m', PACKAGE, 'compile'],
            cwd=os.sep,
            env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, path))},
            check=False,
        )
        if done.returncode:
            print('the kernels are not compiled now but when they are needed', file=sys.stderr)


setup(
    name=PACKAGE,
    cmdclass={'install': InstallWithKernels},
    version='0.1.0',
    description='Pose, focal length and distortion from one view of a flat marker or board',
    maintainer='p4pfr_ros maintainers',
    maintainer_email='maintainers@p4pfr-ros.example.org',
    license='Apache-2.0',
    python_requires='>=3.10',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (SHARE, ['package.xml']),
        (
            f'{SHARE}/config',
            [p for kind in ('yaml', 'rviz', 'json', 'xml') for p in glob(f'config/*.{kind}')],
        ),
        (f'{SHARE}/config/boards', glob('config/boards/*.yaml')),
        (f'{SHARE}/launch', glob('launch/*.launch.py')),
        # `ros2 run` and launch look for executables here; console scripts are in bin/.
        (f'lib/{PACKAGE}', glob('scripts/*')),
    ],
    zip_safe=False,
    entry_points={'console_scripts': [f'p4pfr = {PACKAGE}.cli:main']},
    install_requires=[
        'numba',
        'numpy',
        'opencv-python-headless>=4.7',  # earlier, only the contrib build has ArUco
        'pyyaml',
    ],
    extras_require={
        # Tables and progress bars of the command line, and the demo.
        'cli': ['rich'],
        # `p4pfr board` and the report of `p4pfr calibrate`.
        'plot': ['matplotlib'],
        # ROS 2 Jazzy without a ROS installation; not needed if one is sourced.
        'ros': [
            'ros-jazzy-common-interfaces',
            'ros-jazzy-rclpy',
            'ros-jazzy-rmw-fastrtps-cpp',
        ],
        # `p4pfr calibrate --bag`. Not in package.xml: rosdep installs it by pip, and ROS's build
        # farm releases no package that needs pip.
        'bags': ['rosbags>=0.11'],
        # Without pytest here, colcon runs no tests and reports success.
        'test': [
            'catkin-pkg',
            'hypothesis',
            'matplotlib',
            'pytest',
            'pytest-timeout',
            'pytest-xdist',
            'rich',
            'rosbags>=0.11',
        ],
        'lint': ['mypy', 'ruff', 'types-PyYAML', *AMENT_LINTERS],
    },
)
