"""The package as users get it: one source tree for pip and colcon, and what the manifests promise."""

from __future__ import annotations

import ast
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from importlib.metadata import distribution, distributions
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

import pytest

from motion_detect_ros import __version__

PACKAGE = 'motion_detect_ros'
REPOSITORY = Path(__file__).resolve().parent.parent
NODES = ('camera', 'ego_motion', 'optical_flow', 'art2_clustering', 'pipeline', 'overlay', 'bag_player')
#: Not part of a clone, and large.
_NOT_SOURCE = shutil.ignore_patterns(
    '.venv*', '.git', '__pycache__', '.*_cache', '.hypothesis', 'build', 'install', 'log', 'out', '*.egg-info')
#: What users know a dependency by, where it is not the name that is imported.
_IMPORT_NAMES = {'opencv-python-headless': 'cv2', 'PyYAML': 'yaml', 'scikit-learn': 'sklearn'}


def run(*command: str | Path, cwd: Path, **environment: str) -> str:
    """Output of a command that must succeed."""
    done = subprocess.run(
        [str(word) for word in command], cwd=cwd, env={**os.environ, **environment}, text=True, timeout=600,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    assert done.returncode == 0, done.stdout
    return done.stdout


@pytest.fixture(scope='module')
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the source tree, so that a build leaves nothing behind in the real one."""
    workspace = tmp_path_factory.mktemp('workspace')
    return Path(shutil.copytree(REPOSITORY, workspace / 'src' / PACKAGE, ignore=_NOT_SOURCE))


@pytest.fixture(scope='module')
def pip_prefix(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where `pip install .` put everything."""
    target = tmp_path_factory.mktemp('pip') / 'target'
    run(sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps', '--no-build-isolation', '--no-index',
        '--disable-pip-version-check', '--target', target, '.', cwd=source)
    return target


@pytest.fixture(scope='module')
def colcon_prefix(source: Path) -> Path:
    """Where `colcon build` put everything."""
    colcon = shutil.which('colcon', path=f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}')
    if colcon is None or importlib.util.find_spec('ament_index_python') is None:
        pytest.skip('colcon and ament_index_python are not installed')
    workspace = source.parent.parent
    prefix = os.environ.get('AMENT_PREFIX_PATH') or sys.prefix
    environment = {'AMENT_PREFIX_PATH': prefix, 'CMAKE_PREFIX_PATH': prefix, 'COLCON_LOG_LEVEL': '40',
                   'PATH': f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}'}
    listed = run(colcon, 'list', cwd=workspace, **environment)
    assert re.search(rf'^{PACKAGE}\s.*\(ros\.ament_python\)$', listed, re.MULTILINE), listed
    run(colcon, 'build', '--executor', 'sequential', cwd=workspace, **environment)
    return workspace / 'install' / PACKAGE


def shipped_files() -> set[str]:
    """What every installation must hold under share/, from what lies in the source tree."""
    folders = ((folder, REPOSITORY / folder) for folder in ('config', 'launch', 'examples'))
    files = {f'{name}/{file.name}' for name, folder in folders for file in folder.iterdir() if file.is_file()}
    return files | {'package.xml'}


@pytest.mark.parametrize('prefix', ['pip_prefix', 'colcon_prefix'])
class TestInstalled:
    def test_share_holds_manifest_presets_and_launch_files(self, prefix: str, request: pytest.FixtureRequest) -> None:
        root: Path = request.getfixturevalue(prefix)
        share = root / 'share' / PACKAGE
        assert {'config/default.yaml', 'config/visdrone.yaml', 'config/kitti.yaml'} <= shipped_files()
        assert [name for name in sorted(shipped_files()) if not (share / name).is_file()] == []
        assert (root / 'share/ament_index/resource_index/packages' / PACKAGE).is_file()

    def test_every_node_is_a_program(self, prefix: str, request: pytest.FixtureRequest) -> None:
        root: Path = request.getfixturevalue(prefix)
        scripts = root / 'bin' if prefix == 'pip_prefix' else root / 'lib' / PACKAGE
        assert [node for node in NODES if not os.access(scripts / node, os.X_OK)] == []


@pytest.mark.parametrize('preset', ['default', 'kitti', 'visdrone'])
def test_colcon_build_compiles_the_kernels(preset: str, colcon_prefix: Path, tmp_path: Path) -> None:
    """So the first start needs as long as any other. The cache is the installation's own."""
    (site,) = colcon_prefix.glob('lib/python3*/site-packages')
    code = ('import sys; from motion_detect_ros import kernel_compiler as compiler, presets; '
            'print(compiler.__file__, compiler.from_cache(presets.load_preset(sys.argv[1])))')
    environment = {'PYTHONPATH': str(site), 'AMENT_PREFIX_PATH': str(colcon_prefix)}
    assert run(sys.executable, '-P', '-c', code, preset, cwd=tmp_path, **environment).split() == [
        str(site / PACKAGE / 'kernel_compiler.py'), 'True']


def test_an_installation_without_numba_goes_on_and_says_so(source: Path, tmp_path: Path) -> None:
    (tmp_path / 'numba.py').write_text("raise ImportError('there is none')\n", encoding='ascii')
    printed = run(
        sys.executable, 'setup.py', '-q', 'install', '--prefix', tmp_path, '--single-version-externally-managed',
        '--record', tmp_path / 'install.log', cwd=source, PYTHONPATH=str(tmp_path))
    (line,) = [line for line in printed.splitlines() if line.startswith('motion_detect_ros:')]
    assert line == ('motion_detect_ros: kernels are not compiled, the first start will do it: '
                    'ImportError: there is none')
    assert len([*tmp_path.rglob('kernel_compiler.py')]) == 1


@pytest.mark.parametrize('scheme', ['--target', '--prefix'])
def test_installed_package_finds_its_presets_without_ament(scheme: str, source: Path, tmp_path: Path) -> None:
    """``pip --user`` lays it out as ``--prefix`` does."""
    run(sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps', '--no-build-isolation', '--no-index',
        '--disable-pip-version-check', '--ignore-installed', scheme, tmp_path, '.', cwd=source)
    version = f'python{sys.version_info[0]}.{sys.version_info[1]}'
    site = tmp_path if scheme == '--target' else tmp_path / 'lib' / version / 'site-packages'
    code = 'import motion_detect_ros.presets as presets; print(presets.__file__, presets.preset_names())'
    printed = run(sys.executable, '-c', code, cwd=tmp_path, PYTHONPATH=str(site), AMENT_PREFIX_PATH='')
    assert printed.startswith(str(site))
    assert "['default', 'kitti', 'report', 'visdrone']" in printed


def test_every_installed_entry_point_leads_to_a_function(pip_prefix: Path) -> None:
    pytest.importorskip('rclpy', reason='ROS 2 is not installed')
    (installed,) = [found for found in distributions(path=[str(pip_prefix)]) if found.name == PACKAGE]
    scripts = {entry.name: entry.load() for entry in installed.entry_points.select(group='console_scripts')}
    assert set(scripts) == set(NODES)
    assert all(callable(function) for function in scripts.values())


def manifest() -> ElementTree.Element:
    return ElementTree.parse(REPOSITORY / 'package.xml').getroot()


def test_version_is_the_same_everywhere() -> None:
    setup = re.search(r"version='([^']+)'", (REPOSITORY / 'setup.py').read_text(encoding='utf-8'))
    assert setup is not None
    assert {manifest().findtext('version'), setup.group(1)} == {__version__}


def imported_packages(*folders: str) -> set[str]:
    """Top-level names that modules in ``folders`` import and that come neither from Python nor from the package."""
    names = set()
    for module in (path for folder in folders for path in (REPOSITORY / folder).rglob('*.py')):
        for node in ast.walk(ast.parse(module.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                names |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                names.add(node.module.split('.')[0])
            elif isinstance(node, ast.Call) and getattr(node.func, 'id', '') == 'import_module':
                names |= {str(word.value).split('.')[0] for word in node.args if isinstance(word, ast.Constant)}
    return names - sys.stdlib_module_names - {PACKAGE}


def pip_requirements() -> set[str]:
    """Import names of install_requires and of the extras in setup.py."""
    tree = ast.parse((REPOSITORY / 'setup.py').read_text(encoding='utf-8'))
    words = {word.arg: ast.literal_eval(word.value) for call in ast.walk(tree) if isinstance(call, ast.Call)
             for word in call.keywords if word.arg in ('install_requires', 'extras_require')}
    requirements = [*words['install_requires'], *chain.from_iterable(words['extras_require'].values())]
    names = {re.split('[<>=]', requirement)[0] for requirement in requirements}
    return {_IMPORT_NAMES.get(name, name) for name in names}


def ros_requirements(kind: str = 'exec_depend') -> set[str]:
    """What package.xml says, by the name that is imported."""
    return {str(item.text).removeprefix('python3-').replace('-', '_') for item in manifest().findall(kind)}


def test_every_import_is_a_declared_dependency_and_no_package_of_ros_is_declared_in_vain() -> None:
    imported = imported_packages(PACKAGE, 'launch')
    declared = pip_requirements() | ros_requirements()
    assert sorted(imported - declared) == []
    assert sorted(imported_packages('examples') - declared - {'vision_msgs'}) == []
    libraries = {'numpy', 'opencv', 'rich', 'scipy', 'yaml'}
    assert sorted(ros_requirements() - libraries - imported) == []


def test_what_only_the_tests_import_is_declared_for_them() -> None:
    own = {path.stem for path in (REPOSITORY / 'test').rglob('*.py')}
    declared = pip_requirements() | ros_requirements() | ros_requirements('test_depend')
    assert sorted(imported_packages('test') - own - declared) == []
    assert 'pytest_timeout' in ros_requirements('test_depend'), 'pyproject.toml sets its option'


def test_lock_pins_every_dependency_and_matches_what_is_tested() -> None:
    lines = (REPOSITORY / 'requirements.lock').read_text(encoding='utf-8').splitlines()
    pins = dict(line.split('==') for line in lines if line and not line.startswith('#'))
    for name in ('opencv-python-headless', 'numpy', 'numba', 'scipy', 'rosbags', 'mcap', 'PyYAML', 'rich'):
        assert distribution(name).version == pins[name]
    assert {'ros-jazzy-rclpy', 'ros-jazzy-common-interfaces', 'ros-jazzy-rmw-fastrtps-cpp'} <= set(pins)
    assert 'lark' not in pins, 'lark and lark-parser install the same module'
