"""Optical flow by a network in an ONNX file (RAFT and its kin, Teed and Deng 2020), run by ONNX Runtime.

What a model must be:

- Inputs, float32: two images of shape (1, 3, h, w), the current one first; or one input that holds both,
  (1, 6, h, w), (2, 3, h, w) or (1, 2, 3, h, w). Values 0 to 255, RGB; a model that wants another range scales them
  itself.
- The last output is the flow, (1, 2, h, w) of the input's h and w, pixels, from the first image to the second.
- h and w are open, then images are padded to a multiple of 8 by repeating the border, or fixed, then images are
  resized to them and the flow is resized and scaled back.
"""

from __future__ import annotations

import importlib
from typing import Any

import cv2
import numpy as np

from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.threads import threads
from motion_detect_ros.core.types import ByteArray, FloatArray

#: RAFT works on features at an eighth of the resolution.
MULTIPLE_PX = 8
#: Shapes of inputs without height and width: each of two images, or both in one.
ONE_PICTURE, TWO_PICTURES = (1, 3), ((1, 6), (2, 3), (1, 2, 3))

_Shape = tuple[int | None, ...]


class OnnxFlow:
    """A ``FlowFunction`` that runs the model in the file ``path``.

    Raises: BackendError where ONNX Runtime is missing, the file cannot be loaded, or inputs and outputs are not as
    the module's contract says.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._session = self._load()
        self._inputs = [(each.name, _shape(each)) for each in self._session.get_inputs()]
        self._check_inputs()
        self._output = self._session.get_outputs()[-1].name
        height, width = self._inputs[0][1][-2:]
        self._fixed = None if height is None or width is None else (width, height)

    def __call__(self, current: ByteArray, reference: ByteArray, /) -> FloatArray:
        """As ``FlowFunction``. Raises: BackendError where the model fails on the images."""
        height, width = current.shape
        if self._fixed is None:
            padding = (0, -height % MULTIPLE_PX, 0, -width % MULTIPLE_PX)
            pictures = [cv2.copyMakeBorder(each, *padding, cv2.BORDER_REPLICATE) for each in (current, reference)]
            return np.ascontiguousarray(self._run(pictures)[:height, :width])
        flow = self._run([cv2.resize(each, self._fixed, interpolation=cv2.INTER_AREA) for each in (current, reference)])
        back = cv2.resize(flow, (width, height), interpolation=cv2.INTER_LINEAR)
        scaled: FloatArray = back * np.array([width / self._fixed[0], height / self._fixed[1]], np.float32)
        return scaled

    def _load(self) -> Any:
        try:
            runtime = importlib.import_module('onnxruntime')
        except ImportError:
            raise BackendError('optical_flow.method onnx: expected ONNX Runtime, found none; '
                               'install onnxruntime (extra onnx of motion_detect_ros)') from None
        options = runtime.SessionOptions()
        options.intra_op_num_threads = threads()
        options.log_severity_level = 4
        try:
            return runtime.InferenceSession(self._path, options, providers=['CPUExecutionProvider'])
        except Exception as error:  # of many kinds, none of them documented
            raise self._wrong('a model that ONNX Runtime can load', _first_line(error)) from None

    def _check_inputs(self) -> None:
        inputs = self._session.get_inputs()
        kinds = {each.type for each in inputs}
        if kinds != {'tensor(float)'}:
            raise self._wrong('inputs of type tensor(float)', ', '.join(sorted(kinds)))
        heads = [shape[:-2] for _, shape in self._inputs]
        two = len(heads) == 2 and all(_fits(head, ONE_PICTURE) for head in heads)
        if not two and not (len(heads) == 1 and any(_fits(heads[0], shape) for shape in TWO_PICTURES)):
            raise self._wrong('two inputs (1, 3, h, w) or one (1, 6, h, w), (2, 3, h, w) or (1, 2, 3, h, w)',
                              ' and '.join(_text(shape) for _, shape in self._inputs))
        sizes = {shape[-2:] for _, shape in self._inputs}
        if len(sizes) != 1 or sum(side is None for side in next(iter(sizes))) == 1:
            raise self._wrong('inputs of one size, both sides open or both fixed',
                              ' and '.join(_text(shape) for _, shape in self._inputs))

    def _run(self, pictures: list[ByteArray]) -> FloatArray:
        """Flow (h, w, 2) of two grey images (h, w) of a size that the model takes."""
        planes = [np.broadcast_to(each.astype(np.float32), (3, *each.shape)) for each in pictures]
        try:
            found = np.asarray(self._session.run([self._output], self._feed(planes))[0])
        except Exception as error:  # of many kinds, none of them documented
            raise self._wrong(f'a model that takes pictures of {pictures[0].shape[::-1]}', _first_line(error)) from None
        if found.shape != (1, 2, *pictures[0].shape):
            raise self._wrong(f'a last output of shape {(1, 2, *pictures[0].shape)}', str(found.shape))
        flow: FloatArray = np.ascontiguousarray(found[0].transpose(1, 2, 0), np.float32)
        return flow

    def _feed(self, planes: list[FloatArray]) -> dict[str, FloatArray]:
        if len(self._inputs) == 2:
            return {name: np.ascontiguousarray(plane[None])
                    for (name, _), plane in zip(self._inputs, planes, strict=True)}
        name, shape = self._inputs[0]
        head = next(head for head in TWO_PICTURES if _fits(shape[:-2], head))
        return {name: np.stack(planes).reshape(*head, *planes[0].shape[1:])}

    def _wrong(self, expected: str, got: str) -> BackendError:
        return BackendError(f'optical_flow.onnx_model {self._path}: expected {expected}, got {got}')


def _shape(tensor: Any) -> _Shape:
    """Sizes of a model's input; None where the model leaves them open."""
    return tuple(size if isinstance(size, int) else None for size in tensor.shape)


def _fits(head: _Shape, wanted: tuple[int, ...]) -> bool:
    return len(head) == len(wanted) and all(size in (None, want) for size, want in zip(head, wanted, strict=True))


def _text(shape: _Shape) -> str:
    return f'({", ".join("open" if size is None else str(size) for size in shape)})'


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
