"""Build of cmpsp_ros, by colcon (ament_python) and by pip alike."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = 'cmpsp_ros'
SHARE = Path('share') / NAME

# The solvers and rosbags are not in apt: rosdep cannot install them, pip does.
INSTALL_REQUIRES = [
    'numpy>=1.26',
    'scipy>=1.11',
    'numba>=0.59',  # with numpy 1.26; test_numba_versions.py
    'llvmlite>=0.42',  # which numba is made of
    'daqp>=0.11',
    'qpsolvers>=4.3',
    'clarabel>=0.11',
    'rosbags>=0.11',
    'ruamel.yaml.clib>=0.2.8',  # rosbags reads QoS profiles with it several times as fast
    'lz4>=4.0',
    'backports.zstd>=1.0; python_version < "3.14"',
    'pyyaml>=6.0',
    'typer>=0.12',
    'rich>=13.0',
    'matplotlib>=3.6',
]

# ROS stays out of INSTALL_REQUIRES: on a robot it comes from apt or from source.
# The wheels are asked for in one go, by their `ros-jazzy-*` names and with an RMW;
# anything less mixes ROS distributions or leaves rclpy without middleware.
EXTRAS_REQUIRE = {
    'ros': [
        'ros-jazzy-rclpy',
        'ros-jazzy-rmw-fastrtps-cpp',
        'ros-jazzy-common-interfaces',
        'ros-jazzy-lifecycle-msgs',
        'ros-jazzy-rosgraph-msgs',
    ],
    'dask': ['distributed>=2024.5'],
    'casadi': ['casadi>=3.6'],
    'mujoco': ['mujoco>=3.1'],
    'parquet': ['pyarrow>=15.0'],
    'report': ['plotly>=5.0'],  # its plotly.min.js goes into the page
    'test': [
        'pytest>=8.0,<9.2',  # with 9.2 pytest-xdist 3.8 ignores `xdist_group` (its issue 1386)
        'pytest-cov',
        'pytest-timeout',
        'pytest-xdist',
        'hypothesis',
        'casadi',
        'mujoco',
        'pyarrow',
        'distributed',
        'plotly',
        'psutil',
        'colcon-common-extensions',
        'setuptools<80',  # colcon-core drives `setup.py` in ways that 80 took away
        'wheel',
    ],
    'lint': ['ruff', 'mypy', 'types-PyYAML', 'import-linter'],
}


def shared_files(folder: str) -> list[tuple[str, list[str]]]:
    """Lists the files of a folder for `data_files`, keeping its sub-folders.

    Args:
        folder: Folder beside this file; it may be empty or missing.

    Returns:
        Pairs of a destination under `share/` and the files that go there.
    """
    by_destination: dict[str, list[str]] = {}
    for path in sorted(Path(folder).rglob('*')):
        hidden = any(part.startswith(('.', '__pycache__')) for part in path.parts)
        if path.is_file() and not hidden:
            by_destination.setdefault(str(SHARE / path.parent), []).append(str(path))
    return sorted(by_destination.items())


setup(
    name=NAME,
    version='0.1.0',
    packages=find_packages(include=[NAME, f'{NAME}.*'], exclude=['test*']),
    package_data={
        NAME: [
            'py.typed',
            'bags/report/assets/*',
            'demo/*.xml',
            'studies/paper/*.toml',
            'view/assets/*',
        ]
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (str(SHARE), ['package.xml']),
        *shared_files('config'),
        *shared_files('launch'),
    ],
    python_requires='>=3.11',
    install_requires=INSTALL_REQUIRES,
    extras_require=EXTRAS_REQUIRE,
    zip_safe=False,
    author='cmpsp_ros maintainers',
    author_email='maintainers@cmpsp-ros.example.org',
    maintainer='cmpsp_ros maintainers',
    maintainer_email='maintainers@cmpsp-ros.example.org',
    description=(
        'Guidance of a two-wheeled robot through a point at a given time, between road '
        'edges and obstacles, by warm-started constrained model predictive static programming.'
    ),
    license='Apache-2.0',
    entry_points={
        'console_scripts': [
            'cmpsp = cmpsp_ros.cli:main',
            'guidance_node = cmpsp_ros.nodes.guidance.node:main',
            'sim_node = cmpsp_ros.nodes.sim.node:main',
            'recorder = cmpsp_ros.nodes.recording.recorder:main',
            'viewer = cmpsp_ros.nodes.viewer:main',
        ]
    },
)
