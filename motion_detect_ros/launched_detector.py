"""The detector as the launch files start it: their arguments, checked before anything starts, and its nodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from motion_detect_ros.bridge.transport import additional_environment
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.launching import (
    STAGES,
    Argument,
    cores,
    existing,
    fail_with,
    flag,
    log_level,
    namespace,
    parameter_file,
    word,
)
from motion_detect_ros.presets import value_for
from motion_detect_ros.sources.address import is_address

#: Parameters of the nodes have no default here, so that the values of ``params_file`` hold where none is given.
ARGUMENTS: tuple[Argument, ...] = (
    ('namespace', '', 'namespace of all nodes'),
    ('use_sim_time', '', 'take time from /clock; empty = as in params_file, else false'),
    ('params_file', 'default', 'preset (default, visdrone, kitti, report) or path of a parameter file'),
    ('autostart', '', 'configure and activate the nodes at start; empty = as in params_file, else true'),
    ('log_level', 'info', 'debug, info, warn, error, fatal'),
    ('use_respawn', 'false', 'start a node again that has ended; false: the launch fails with a camera or stage'),
    ('mode', 'nodes', 'nodes: one process a stage; pipeline: all stages in one process'),
    ('camera', 'true', 'start the camera node; false: another driver publishes the images'),
    ('source', '', 'what the camera node reads: number, device, file, folder or address; the launch ends with a file; '
                   'empty = as in params_file, else 0'),
    ('frame_id', '', 'frame_id that the camera node gives its images; '
                     'empty = as in params_file, else camera_optical_frame'),
    ('image_topic', 'image_raw', 'topic of the images'),
    ('camera_info_topic', 'camera_info', 'topic of the calibration'),
    ('imu_topic', 'imu', 'topic of the angular rates, where imu.use is set'),
    ('image_reliability', '', 'asked of the camera driver; auto: reliable, best effort where it is; '
                              'empty = as in params_file, else auto'),
    ('image_transport', '', 'raw, or compressed: the compressed images of image_topic; '
                            'empty = as in params_file, else raw'),
    ('rectified', '', 'the images are rectified: matrix P of camera_info holds, not K; '
                      'empty = as in params_file, else false'),
    ('overlay', 'true', 'start the overlay node'),
    ('cpus', '', 'cores that the nodes may run on, as taskset takes them (0,1 or 0-3); empty = all'),
)
#: How the text of an argument becomes the parameter of the same name.
Readers = Mapping[str, Callable[[str, str], Any]]
_ALL: Readers = {'autostart': flag, 'use_sim_time': flag}
_IMAGES: Readers = {**_ALL, 'image_reliability': word, 'image_transport': word, 'rectified': flag}
_CAMERA: Readers = {**_ALL, 'source': word, 'frame_id': word}


class Detector:
    """Camera, stages and overlay for values of ``ARGUMENTS``.

    All values are checked when it is made: what is refused once the first node runs would leave that node behind.
    """

    def __init__(self, values: Mapping[str, str]) -> None:
        """Raises: ConfigError or SourceError, one line, for a value that cannot be."""
        self._values = values
        self._namespace = namespace('namespace', values['namespace'])
        self._file = parameter_file(values['params_file'])
        self._options = {'prefix': cores(values['cpus']), 'additional_env': additional_environment()}
        self._log = ['--ros-args', '--log-level', log_level(values['log_level'])]
        self._respawn = flag('use_respawn', values['use_respawn'])
        self._with_overlay = flag('overlay', values['overlay'])
        self._images, self._camera = self.parameters(_IMAGES), self.parameters(_CAMERA)
        self.stages = STAGES[values['mode']]
        self.has_camera = flag('camera', values['camera'])
        self.reads_file = self.has_camera and self._source_is_file()

    def parameters(self, readers: Readers) -> dict[str, Any]:
        """Of the arguments that were given. Raises: ConfigError for a value that cannot be."""
        return {name: read(name, self._values[name]) for name, read in readers.items() if self._values[name]}

    def waiting(self) -> dict[str, Any]:
        """For a node that plays: the stages take their time to warm up, what comes before is lost."""
        return {'wait_for_nodes': word('wait_for_nodes', ','.join(self.stages))}

    def in_file(self, node: str, parameter: str) -> Any:
        """What the parameter file says for one of the nodes; None for nothing. Raises: ConfigError."""
        try:
            return value_for(Path(self._file), f'/{self._namespace}/{node}', parameter)
        except ConfigError as error:
            raise ConfigError(f'launch argument params_file: {self._file}: {error}') from None

    def nodes(self, on_end: Callable[[Any, Any], list[Any]]) -> list[Any]:
        """Actions that start them. on_end: ``on_exit`` of a camera that reads a file."""
        found = [self._lasting(name, self._images) for name in self.stages]
        if self.reads_file:
            found.append(self.node('camera', {**self._camera, **self.waiting()}, self._topics(), on_exit=on_end))
        elif self.has_camera:
            found.append(self._lasting('camera', self._camera))
        if self._with_overlay:  # nobody's safety hangs on pictures: detection goes on without them
            found.append(self.node('overlay', self._images, self._topics(), **self._again()))
        return found

    def node(self, name: str, parameters: Mapping[str, Any], topics: list[tuple[str, str]], **options: Any) -> Any:
        """The action that starts a node. options: of launch's ``ExecuteProcess``."""
        from launch_ros.actions import Node  # launch is not there where nothing is launched
        return Node(
            package='motion_detect_ros', executable=name, name=name, namespace=self._namespace, output='screen',
            parameters=[self._file, dict(parameters)], remappings=topics, arguments=self._log,
            **self._options, **options)

    def _lasting(self, name: str, parameters: Mapping[str, Any]) -> Any:
        """A node that the work needs: it is started again, or the launch fails with it."""
        return self.node(name, parameters, self._topics(), **(self._again() or {'on_exit': fail_with}))

    def _again(self) -> dict[str, Any]:
        return {'respawn': True, 'respawn_delay': 2.0} if self._respawn else {}

    def _topics(self) -> list[tuple[str, str]]:
        image, info, imu = (self._values[name] for name in ('image_topic', 'camera_info_topic', 'imu_topic'))
        return [('image_raw', image), ('image_raw/compressed', f'{image}/compressed'), ('camera_info', info),
                ('imu', imu)]

    def _source_is_file(self) -> bool:
        """A file is over once, and its start would be lost while the stages warm up. Raises: SourceError for none."""
        given, said = self._values['source'], self.in_file('camera', 'source')
        if is_address(given or str(said or '0')):
            return False
        existing(*(('source', given) if given else ('params_file: source', str(said))))
        return True
