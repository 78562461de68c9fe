"""Base of the nodes that run a stage: settings, joined inputs, a worker thread, errors that cost only their frame."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from motion_detect_ros.allocator import give_back
from motion_detect_ros.bridge import transport
from motion_detect_ros.bridge.calibration import StageCamera
from motion_detect_ros.bridge.console import ImageLog
from motion_detect_ros.bridge.diagnostics import Condition
from motion_detect_ros.bridge.gyro import GyroInput, Sink
from motion_detect_ros.bridge.image_input import ImageInput
from motion_detect_ros.bridge.image_stream import ImageStream
from motion_detect_ros.bridge.images import image_from_msg, stamp_ns
from motion_detect_ros.bridge.left_out import LeftOut
from motion_detect_ros.bridge.managed_node import WARNING_PERIOD_S, ManagedNode
from motion_detect_ros.bridge.params import declare_config, declare_simple
from motion_detect_ros.bridge.qos import image_qos, overridable
from motion_detect_ros.bridge.sync import ExactJoin, size_of
from motion_detect_ros.bridge.topics import CAMERA_INFO, EGO_MOTION, NO_CAMERA, Topic
from motion_detect_ros.bridge.worker import Worker
from motion_detect_ros.core.errors import MessageError, MotionDetectError
from motion_detect_ros.core.frame_decimation import FrameDecimation
from motion_detect_ros.core.reconfiguration import structural_changes
from motion_detect_ros.core.settings import Scalar, settings, with_settings
from motion_detect_ros.core.stamp_order import REORDER_S, Verdict
from motion_detect_ros.core.threads import use
from motion_detect_ros.core.types import CameraModel
from motion_detect_ros.kernel_compiler import warm_up_ahead
from motion_detect_ros.sources.encoding import ImageDecoder
from motion_detect_ros.sources.secrets import reason_of

#: Subscriptions hold this many messages while the executor is busy; what waits longer is dropped by the mailbox.
SUBSCRIPTION_DEPTH = 5
#: More images than this in the mailbox are a backlog, not jitter.
WAITING_IMAGES = 2


class StageNode(ManagedNode):
    """Joins the messages of one image and hands them to ``work`` in a thread of its own."""

    #: Topics joined besides the image.
    inputs: tuple[Topic, ...] = ()
    #: Whether the stage has a use for the calibration.
    uses_camera = True
    #: Whether it needs the kernels behind the flow, which take long to compile.
    detects = True
    #: Beginnings of the names of the settings that the stage uses.
    used: tuple[str, ...] = ('',)

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.config = declare_config(self, self.used)
        self._new_config = self.config
        self.live.add([name for name, _, _ in settings(self.config)], self._take_settings, self._check_settings)
        self._image_input = ImageInput.declared(self)
        self._queue_size = int(declare_simple(
            self, 'queue_size', 2, 'images that may wait for this stage; more are dropped, oldest first', 1, 1000))
        reorder_s = float(declare_simple(
            self, 'reorder_s', REORDER_S, 'an image that is late by less is left out, by more starts anew', 0.0, 10.0))
        self._restamps = declare_simple(
            self, 'stamp_missing', 'refuse',
            'images without a stamp: leave them out, or use the time of arrival (`pipeline` only)',
            choices=('refuse', 'arrival')) == 'arrival' and not self.inputs
        names = 'image', *(topic.name for topic in self.inputs)
        self._join = ExactJoin(names, 2 * self._queue_size + 8, reorder_s, size_of)
        self._stream = ImageStream(self._image_input.compressed)
        self._camera = StageCamera(self._image_input.rectified, self.use_camera, self._warn_of_camera)
        self.latest: tuple[tuple[str, str], ...] = ()
        self.decimate()
        self._worker: Worker[tuple[int, tuple[Any, ...]]] | None = None
        self._clock_run = 0
        self._gyro: GyroInput | None = None
        self._decoder = ImageDecoder()
        self._busy = threading.Lock()

    def make_stage(self) -> None:
        """Make publishers and the stage. Overridden."""

    def work(self, header: Header, image: npt.NDArray[np.uint8], *values: Any) -> str:
        """Process one image and what the ``inputs`` hold of it, and publish with its header. Overridden.

        Returns why the image could not be used for what the stage is there for, empty where it could.
        """
        raise NotImplementedError

    def use_camera(self, camera: CameraModel | None) -> None:
        """Another calibration is that of the images, or none any more. Overridden where a stage uses it."""

    def use_config(self, restart: bool) -> None:
        """``config`` has changed. restart: also what needs a stage without history. Overridden."""
        raise NotImplementedError

    def forget(self) -> None:
        """Clear the history of the stage; not while it works. Overridden."""

    def clock_jumped(self) -> None:
        """The next image is of another run of the clock. Overridden by the first stage, which tells the others."""

    def gyro_sink(self) -> Sink | None:
        """Where angular rates go, for a stage that uses them. Overridden."""
        return None

    def open(self) -> None:
        """Warm kernels, publishers, stage."""
        use(self.config.load.threads)
        warm_up_ahead(self.config, self.detects, self._tell_compilation)
        give_back()
        self.make_stage()
        self._camera.forget()

    def _tell_compilation(self, count: int) -> None:
        self.get_logger().info(f'compiling kernel {count}; this takes up to a minute, once after an installation',
                               throttle_duration_sec=WARNING_PERIOD_S)

    def begin(self) -> None:
        """Subscribe."""
        self._decimation.reset()
        self._left_out = LeftOut()
        self._decoder = ImageDecoder()
        self._stream = ImageStream(self._image_input.compressed)
        self.stats.expect_nothing()
        # A stage that joins what another made of each image needs neighbours; the first one may jump.
        self._worker = Worker(self._guarded, self._queue_size, self.stats.count_dropped, jumps=not self.inputs)
        quality = image_qos(self._image_input.reliability, SUBSCRIPTION_DEPTH)
        self._images = ImageLog(self, self._image_input.topic.name, [topic.name for topic in NO_CAMERA])
        for topic in self.inputs:
            self._subscribe_input(topic, topic.name, image_qos('reliable', SUBSCRIPTION_DEPTH))
        sink = self.gyro_sink() if self.config.imu.use else None
        self._gyro = GyroInput(self, sink, self.config.imu.time_offset_s) if sink else None
        if self.uses_camera:
            self.subscribe(CAMERA_INFO.kind, CAMERA_INFO.name, self._camera.note,
                           image_qos(self._image_input.reliability, SUBSCRIPTION_DEPTH), self._image_input.relaxes,
                           qos_overriding_options=overridable())
        # Last, as endpoints are announced in this order: who waits for a subscriber of the images finds the others too.
        self._subscribe_input(self._image_input.topic, 'image', quality, self._image_input.relaxes)

    def end(self) -> None:
        """Stop the thread."""
        if self._worker:
            self._worker.stop()
            self._worker = None
        self._join.clear()

    def condition(self) -> Condition:
        """Images pile up, are lost on the way, or are stamped wrongly; nothing is received on imu though it is used."""
        self._images.check()
        waiting = self._worker.waiting if self._worker else 0
        absent = self._join.absent()
        gone = self.gone([self._image_input.topic.name, *(topic.name for topic in self.inputs)])
        return Condition(
            concern=', '.join(filter(None, (
                f'lags, {waiting} images wait' if waiting > WAITING_IMAGES else '',
                self._stream.trouble(time.monotonic_ns()),
                '' if self._decimation.active and self.inputs else self._stream.loss(),
                'nothing received on imu yet' if self._gyro and not self._gyro.received else ''))),
            unheard='; '.join(filter(None, (*self.incompatible.values(), gone))),
            waits=f'nothing of the same stamp from {", ".join(absent)}' if absent else '')

    def extra_diagnostics(self) -> tuple[tuple[str, str], ...]:
        """What the stage says of the latest image, how images arrive, and whether the calibration is used."""
        stamps = ((f'stamps_{verdict.name.lower()}', str(self._join.count('image', verdict)))
                  for verdict in Verdict if verdict != Verdict.NEXT)
        calibration = (('calibration', self._camera.state),) if self.uses_camera else ()
        return (*self.latest, *self._stream.values(), *stamps, *calibration)

    def _check_settings(self, values: dict[str, Scalar]) -> None:
        """All of them together; new kernels are compiled here, not when the next image comes. Raises: ConfigError."""
        self._new_config = with_settings(self.config, values)
        if structural_changes(self.config, self._new_config):
            warm_up_ahead(self._new_config, self.detects, self._tell_compilation)

    def _take_settings(self, _: dict[str, Scalar]) -> None:
        self.locked(self._change_config)

    def _change_config(self) -> None:
        structural = structural_changes(self.config, self._new_config)
        self.config = self._new_config
        self.decimate()
        if self.configured:
            self.use_config(bool(structural))
            if structural:
                self.get_logger().info(f'{", ".join(structural)} changed: history is cleared')
                self._camera.tell_nothing()

    def decimate(self, of: int = 1) -> None:
        """Use one of so many of the images that the settings do not leave out."""
        self._decimation = FrameDecimation.by(self.config.load, of)

    def reset(self) -> None:
        """Forget history, of the images' depth too."""
        self.locked(self._forget)

    def _forget(self) -> None:
        self._decoder = ImageDecoder()
        self.forget()

    def locked(self, action: Callable[[], None]) -> None:
        """Run something between two frames."""
        with self._busy:
            action()

    def _subscribe_input(self, topic: Topic, name: str, quality: QoSProfile, relax: bool = False) -> None:
        self.subscribe(topic.kind, topic.name, lambda msg: self._on_input(name, msg), quality, relax,
                       qos_overriding_options=overridable())

    def _on_input(self, name: str, msg: Any) -> None:
        stamped = not self._stamp(msg)
        messages = self._join.add(name, stamp_ns(msg.header), msg)
        if name == 'image':
            self._note_image(msg, stamped)
        if self.inputs:
            ego = messages[1 + self.inputs.index(EGO_MOTION)] if messages else None
            left_out, missing = self._left_out.judge(self._join.given_up, ego, self.config.load)
            self.stats.count_left_out(left_out)
            self.stats.count_dropped(missing)
        elif messages and not self._decimation.keep_next():
            self.stats.count_left_out()
            return
        if messages and self._worker:
            if self._decimation.active:
                self.stats.expect_use(time.monotonic_ns())
            self._worker.submit((self._join.count('image', Verdict.JUMP), messages))

    def _stamp(self, msg: Any) -> bool:
        """Give an image without a stamp its time of arrival, where the user wants that; whether it got one."""
        if not self._restamps or stamp_ns(msg.header):
            return False
        msg.header.stamp = self.get_clock().now().to_msg()
        return True

    def _note_image(self, msg: Any, stamped: bool) -> None:
        now_ns, verdict = time.monotonic_ns(), self._join.verdict
        self.stats.count_received(now_ns)
        self._images.arrived(msg)
        if lost := transport.big_image_trouble(len(msg.data)):
            self.get_logger().warning(lost, once=True)
        self._stream.add(verdict, stamp_ns(msg.header), now_ns, stamped=stamped)
        if not self._decimation.active or not verdict.usable:
            self.stats.expect_use(now_ns)
        if not verdict.usable:
            self.stats.count_dropped()
            self.stats.count_unused(f'stamps {verdict.value}')

    def _guarded(self, item: tuple[int, tuple[Any, ...]]) -> None:
        start = time.perf_counter()
        clock_run, messages = item
        try:
            with self._busy:
                if clock_run != self._clock_run:  # the image that told may have been left out
                    self._clock_run = clock_run
                    self.clock_jumped()
                values = self._values(messages)
                self._camera.update(stamp_ns(messages[0].header), *values[0].shape[1::-1])
                if self._gyro:
                    self._gyro.feed(stamp_ns(messages[0].header))
                unused = self.work(messages[0].header, *values)
        except MotionDetectError as error:
            self.bad_input(error)
            return
        except Exception as error:  # a bug must not stop the stream: it costs the frame and is reported
            if self.context.ok():
                self.get_logger().error(reason_of(error), throttle_duration_sec=WARNING_PERIOD_S)
                self.stats.count_error(reason_of(error))
            return
        latency_ms = 1e3 * (time.perf_counter() - start)
        age_ms = (self.now_ns() - stamp_ns(messages[0].header)) / 1e6
        self.stats.count_processed(time.monotonic_ns(), latency_ms, age_ms)
        if unused:
            self.stats.count_unused(unused)
        else:
            self.stats.count_used()

    def _values(self, messages: tuple[Any, ...]) -> list[Any]:
        image, *others = messages
        return [self._read(self._image_input.topic, lambda msg: image_from_msg(msg, self._decoder), image),
                *(self._read(topic, topic.from_msg, message)
                  for topic, message in zip(self.inputs, others, strict=True))]

    def _read(self, topic: Topic, convert: Callable[[Any], Any], msg: Any) -> Any:
        """Raises: MessageError that names the topic."""
        try:
            return convert(msg)
        except MessageError as error:
            raise MessageError(f'{self.resolve_topic_name(topic.name)}: {error}') from None

    def _warn_of_camera(self, words: str) -> None:
        if self.uses_camera:
            self.get_logger().warning(words)
