"""One source tree for `colcon build` (ament_python) and `pip install`."""

import os
import subprocess
import sys
from glob import glob
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.install import install

PACKAGE = 'motion_detect_ros'
NODES = ('camera', 'ego_motion', 'optical_flow', 'art2_clustering', 'pipeline', 'overlay', 'bag_player')


class InstallAndCompile(install):
    """`colcon build` compiles the kernels too, so that no first start has to.

    Not where files are gathered under a root of their own, as for wheels and Debian packages.
    """

    def run(self):
        """As of the base class, then the kernels. A build goes on without them, and says so."""
        super().run()
        if self.root is None:
            path = os.pathsep.join(filter(None, [str(Path(self.install_lib).absolute()), os.environ.get('PYTHONPATH')]))
            try:
                subprocess.run([sys.executable, '-P', '-m', f'{PACKAGE}.kernel_compiler'], check=True, timeout=600,
                               env={**os.environ, 'PYTHONPATH': path}, stdin=subprocess.DEVNULL,
                               capture_output=True, text=True)
            except (OSError, subprocess.SubprocessError) as error:
                said = error.stderr if isinstance(error, subprocess.CalledProcessError) and error.stderr else str(error)
                print(f'{PACKAGE}: kernels are not compiled, the first start will do it: {said.splitlines()[-1]}',
                      file=sys.stderr)


setup(
    name=PACKAGE,
    version='0.1.0',
    description='Moving-object detection from a single moving camera: ROS 2 nodes and offline tools',
    license='Apache-2.0',
    maintainer='motion_detect_ros maintainers',
    maintainer_email='maintainers@motion-detect-ros.example.org',
    packages=find_packages(include=[PACKAGE, f'{PACKAGE}.*']),
    package_data={PACKAGE: ['kernels.json'], f'{PACKAGE}.report': ['templates/*']},
    python_requires='>=3.11',
    install_requires=[
        'setuptools',
        'apsw>=3.40',
        'mcap>=1.2.1',
        'numba>=0.59',
        'numpy>=1.26',
        'opencv-python-headless>=4.6',
        'PyYAML>=6.0',
        'rich>=13.0',
        'rosbags>=0.11',
        'scipy>=1.11',
    ],
    extras_require={
        'cluster': ['dask>=2024.1', 'distributed>=2024.1'],
        'compare': ['artlib>=0.1.7', 'scikit-learn>=1.6'],
        'contrib': ['opencv-contrib-python-headless>=4.6'],
        'evaluation': ['trackeval>=1.3'],  # brings opencv-python: docs/accuracy.md says how to keep the headless one
        'onnx': ['onnxruntime>=1.16'],
        'parquet': ['pyarrow>=14'],
        'plots': ['matplotlib>=3.8'],
        'report': ['av>=12', 'jinja2>=3.1', 'plotly>=5.18'],
        'ros': ['ros-jazzy-rclpy', 'ros-jazzy-common-interfaces', 'ros-jazzy-rmw-fastrtps-cpp'],
        'test': ['hypothesis', 'jsonschema', 'mypy', 'pandas', 'pycocotools', 'pytest', 'pytest-cov', 'pytest-timeout',
                 'pytest-xdist', 'ruff', 'selenium', 'types-PyYAML'],
        'test-extras': ['onnx>=1.15'],
        'tune': ['optuna>=3.5'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{PACKAGE}']),
        (f'share/{PACKAGE}', ['package.xml']),
        (f'share/{PACKAGE}/config', sorted(glob('config/*.*'))),
        (f'share/{PACKAGE}/launch', sorted(glob('launch/*.launch.py'))),
        (f'share/{PACKAGE}/examples', [*sorted(glob('examples/*.*')), 'examples/Dockerfile']),
    ],
    zip_safe=True,
    cmdclass={'install': InstallAndCompile},
    entry_points={'console_scripts': [f'{node} = {PACKAGE}.nodes.{node}:main' for node in NODES]},
)
