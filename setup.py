"""Build of cmpsp_ros, by colcon (ament_python) and by pip alike."""

from pathlib import Path

from setuptools import find_packages, setup

NAME = 'cmpsp_ros'
SHARE = Path('share') / NAME

# Lower bounds are what `make test-oldest` tests: requirements/oldest.txt. The nodes themselves need
# numpy, scipy, numba and pyyaml only.
INSTALL_REQUIRES = [
    'numpy>=1.26.4',
    'scipy>=1.11.4',
    'numba>=0.62.0',
    'llvmlite>=0.45.0',  # which numba is made of
    'pyyaml>=6.0.1',
    # bags
    'rosbags>=0.11.9',  # whose storage classes bags reads and writes with
    'ruamel.yaml.clib>=0.2.8',  # rosbags reads QoS profiles with it several times as fast
    'lz4>=4.0.2',
    'backports.zstd>=1.0.0; python_version < "3.14"',
    # `cmpsp` and its pictures
    'typer>=0.9.0',
    'rich>=13.7.1',
    'matplotlib>=3.6.3',
    'pillow>=10.2.0',
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
    'solvers': ['daqp>=0.11.0', 'qpsolvers>=4.3.3', 'clarabel>=0.11.0'],  # other QP back ends
    'dask': ['distributed>=2024.5.0'],
    'casadi': ['casadi>=3.6.7'],
    'mujoco': ['mujoco>=3.5.0'],
    'parquet': ['pyarrow>=15.0.0'],
    'report': ['plotly>=5.15.0'],  # its plotly.min.js goes into the page
    'test': [
        'pytest>=7.4.4,<9.2',  # with 9.2 pytest-xdist 3.8 ignores `xdist_group` (its issue 1386)
        'pytest-cov',
        'pytest-timeout',
        'pytest-xdist>=3.6.1',  # earlier ones may run a test outside of the main thread
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
    version='1.0.0',
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
        *shared_files('doc'),
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
    long_description=Path('README.md').read_text(encoding='utf-8'),
    long_description_content_type='text/markdown',
    # The owner's to give: an address of the maintainer (twice above, and in package.xml), and the
    # repository in project_urls.
    license='Apache-2.0',
    keywords='robotics ROS 2 MPC MPSP optimal control guidance trajectory',
    classifiers=[
        'Development Status :: 5 - Production/Stable',
        'Intended Audience :: Science/Research',
        'License :: OSI Approved :: Apache Software License',
        'Operating System :: POSIX :: Linux',
        'Programming Language :: Python :: 3',
        *(f'Programming Language :: Python :: 3.{minor}' for minor in range(11, 15)),
        'Topic :: Scientific/Engineering',
        'Typing :: Typed',
    ],
    entry_points={
        'console_scripts': [
            'cmpsp = cmpsp_ros.programs:cmpsp',
            'guidance_node = cmpsp_ros.programs:guidance_node',
            'sim_node = cmpsp_ros.programs:sim_node',
            'recorder = cmpsp_ros.programs:recorder',
            'viewer = cmpsp_ros.programs:viewer',
        ]
    },
)
