"""Networks of a few nodes, made here, whose answer is known: what goes in, what comes out, what is refused."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from motion_detect_ros.core.config import OpticalFlowConfig
from motion_detect_ros.core.errors import BackendError
from motion_detect_ros.core.flow_methods.flow_function import FlowFunction
from motion_detect_ros.core.flow_methods.forward_backward import forward_backward_flow
from motion_detect_ros.core.flow_methods.registry import make_flow

CONSTANTS = '<int64[1] zero = {0}, int64[1] one = {1}, int64[1] two = {2}, int64[1] three = {3}, int64[1] four = {4}>'
#: The flow such a network gives is what it was given: red of the first picture, green of the second.
ECHO = 'x = Slice(a, zero, one, one) y = Slice(b, one, two, one) flow = Concat<axis=1>(x, y)'
TWO_INPUTS, FLOW = 'float[1,3,h,w] a, float[1,3,h,w] b', 'float[1,2,h,w] flow'


def test_missing_runtime_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'onnxruntime', None)
    with pytest.raises(BackendError, match=r'expected ONNX Runtime, found none; install onnxruntime \(extra onnx'):
        make_flow(OpticalFlowConfig(method='onnx', onnx_model='raft.onnx'))


def pictures(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(5)
    return random.integers(0, 256, (height, width), np.uint8), random.integers(0, 256, (height, width), np.uint8)


class TestModels:
    @pytest.fixture(autouse=True)
    def extras(self, tmp_path: Path) -> None:
        self.onnx = pytest.importorskip('onnx', reason='onnx is not installed (make test-extras)')
        pytest.importorskip('onnxruntime', reason='onnxruntime is not installed (make test-extras)')
        self.file = tmp_path / 'net.onnx'

    def load(self, inputs: str, body: str, output: str = FLOW) -> FlowFunction:
        """The flow of a network in ONNX's text form."""
        text = f'<ir_version: 8, opset_import: ["" : 13]> net ({inputs}) => ({output}) {CONSTANTS} {{ {body} }}'
        self.onnx.save(self.onnx.parser.parse_model(text), str(self.file))
        return make_flow(OpticalFlowConfig(method='onnx', onnx_model=str(self.file)))

    @pytest.mark.parametrize('size', [(32, 40), (27, 45)])
    def test_pictures_go_in_as_they_are_and_padding_is_cut_off(self, size: tuple[int, int]) -> None:
        current, earlier = pictures(*size)
        flow = self.load(TWO_INPUTS, ECHO)(current, earlier)
        assert flow.dtype == np.float32
        np.testing.assert_array_equal(flow, np.stack([current, earlier], axis=-1))

    def test_what_an_open_model_sees_is_a_multiple_of_eight(self) -> None:
        # flow = (height, width) that the network saw, at every pixel
        body = ('s = Shape(a) f = Cast<to=1>(s) hw = Slice(f, two, four, zero) e = Sub(a, a) '
                'c = Slice(e, zero, two, one) o = Constant<value_ints = [1, 2, 1, 1]>() r = Reshape(hw, o) '
                'flow = Add(c, r)')
        np.testing.assert_array_equal(self.load(TWO_INPUTS, body)(*pictures(27, 45))[5, 7], [32, 48])

    @pytest.mark.parametrize(('inputs', 'split'), [
        ('float[1,6,h,w] p', 'a = Slice(p, zero, three, one) b = Slice(p, three, six, one)'),
        ('float[2,3,h,w] p', 'a = Slice(p, zero, one, zero) b = Slice(p, one, two, zero)'),
        ('float[1,2,3,h,w] p', 'c = Slice(p, zero, one, one) a = Squeeze(c, one) '
                               'd = Slice(p, one, two, one) b = Squeeze(d, one)')])
    def test_both_pictures_in_one_input(self, inputs: str, split: str) -> None:
        current, earlier = pictures(24, 32)
        flow = self.load(inputs, f'six = Constant<value_ints = [6]>() {split} {ECHO}')(current, earlier)
        np.testing.assert_array_equal(flow, np.stack([current, earlier], axis=-1))

    def test_flow_of_a_fixed_size_is_scaled_back(self) -> None:
        body = ('e = Sub(a, a) z = Slice(e, zero, two, one) v = Constant<value_floats = [3.0, -2.0]>() '
                'o = Constant<value_ints = [1, 2, 1, 1]>() r = Reshape(v, o) flow = Add(z, r)')
        flow = self.load('float[1,3,48,64] a, float[1,3,48,64] b', body, 'float[1,2,48,64] flow')(*pictures(96, 256))
        np.testing.assert_allclose(flow, np.full((96, 256, 2), (12.0, -4.0)), rtol=1e-6)

    def test_a_network_that_compares_shifted_pictures(self) -> None:
        """Of -4, 0 and 4 px along x, the shift under which the windows around a pixel are most alike."""
        body = (
            'i = Slice(a, zero, one, one) j = Slice(b, zero, one, one) '
            'p = Constant<value_ints = [0, 0, 0, 4, 0, 0, 0, 4]>() k = Pad<mode="edge">(j, p) '
            'eight = Constant<value_ints = [8]>() minus_eight = Constant<value_ints = [-8]>() '
            'minus_four = Constant<value_ints = [-4]>() end = Constant<value_ints = [99999]>() '
            'l = Slice(k, zero, minus_eight, three) m = Slice(k, four, minus_four, three) '
            'n = Slice(k, eight, end, three) s = Concat<axis=1>(l, m, n) d = Sub(s, i) q = Abs(d) '
            'c = AveragePool<kernel_shape=[9,9], pads=[4,4,4,4]>(q) '
            'best = ArgMin<axis=1, keepdims=1>(c) f = Cast<to=1>(best) mid = Constant<value_float = 1.0>() '
            't = Constant<value_float = 4.0>() g = Sub(f, mid) x = Mul(g, t) y = Sub(x, x) flow = Concat<axis=1>(x, y)')
        ground = cv2.GaussianBlur(pictures(80, 128)[0], (0, 0), 1.0)
        current, earlier = ground[:, 8:120].copy(), ground[:, 8:120].copy()
        earlier[20:60, 34:74] = current[20:60, 30:70] = cv2.GaussianBlur(pictures(40, 40)[1], (0, 0), 1.0)
        flow = forward_backward_flow(self.load(TWO_INPUTS, body), current, earlier, 20, 28, 0.7)
        np.testing.assert_array_equal(flow[7:13, 10:16], np.full((6, 6, 2), (4.0, 0.0)))
        np.testing.assert_array_equal(flow[:, 22:], np.zeros((20, 6, 2)))

    def test_missing_file_and_nonsense_are_refused(self) -> None:
        for make in (lambda: None, lambda: self.file.write_text('no network')):
            make()
            with pytest.raises(BackendError, match=rf'onnx_model {self.file}: expected a model that ONNX Runtime can'):
                make_flow(OpticalFlowConfig(method='onnx', onnx_model=str(self.file)))

    @pytest.mark.parametrize(('inputs', 'complaint'), [
        ('float[1,3,h,w] a', r'expected two inputs \(1, 3, h, w\) or one .* got \(1, 3, open, open\)'),
        ('float[1,1,h,w] a, float[1,1,h,w] b', r'got \(1, 1, open, open\) and \(1, 1, open, open\)'),
        ('float[1,3,h,w] a, float[1,3,h,w] b, float[1] c', 'expected two inputs'),
        ('float[1,3,64,w] a, float[1,3,64,w] b', 'both sides open or both fixed, got .1, 3, 64, open.'),
        ('float[1,3,64,64] a, float[1,3,32,32] b', 'expected inputs of one size'),
        ('uint8[1,3,h,w] a, uint8[1,3,h,w] b', r'expected inputs of type tensor\(float\), got tensor\(uint8\)')])
    def test_wrong_inputs_are_refused(self, inputs: str, complaint: str) -> None:
        kind = inputs.split('[', maxsplit=1)[0]
        with pytest.raises(BackendError, match=complaint):
            self.load(inputs, 'flow = Identity(a)', f'{kind}[x,y,z,v] flow')

    def test_wrong_output_is_refused(self) -> None:
        flow = self.load(TWO_INPUTS, f'{ECHO} small = Slice(flow, zero, one, one)',
                         'float[1,2,h,w] flow, float[1,1,h,w] small')
        with pytest.raises(BackendError, match=r'expected a last output of shape \(1, 2, 24, 32\), got \(1, 1, 24, 32'):
            flow(*pictures(24, 32))

    def test_a_model_that_fails_on_the_pictures_is_refused(self) -> None:
        body = f'o = Constant<value_ints = [1, 3, 8, 8]>() r = Reshape(a, o) u = Add(r, a) {ECHO.replace("(a,", "(u,")}'
        with pytest.raises(BackendError, match=r'expected a model that takes pictures of \(32, 24\), got'):
            self.load(TWO_INPUTS, body)(*pictures(24, 32))
