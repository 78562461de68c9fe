"""Settings that change while frames come, against pipelines that had them from the start."""

from __future__ import annotations

from dataclasses import replace

import pytest
from test_pipeline import PERIOD_NS, scene

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import BackendError, ConfigError
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.reconfiguration import is_fixed, structural_changes
from motion_detect_ros.core.settings import settings, with_settings
from motion_detect_ros.core.types import EgoStatus

FRAMES = 8
SCENES = [scene(index) for index in range(2 * FRAMES)]


def show(pipeline: MotionPipeline, first: int, count: int = FRAMES) -> list[bytes]:
    results = [pipeline.process(SCENES[index], (index + 1) * PERIOD_NS) for index in range(first, first + count)]
    return [result.ego.matrix.tobytes() + result.flow.flow.tobytes() + result.detections.tobytes()
            for result in results]


def other(name: str) -> PipelineConfig:
    """The default with another value of one setting, as far from its own as others allow."""
    default = PipelineConfig()
    value, metadata = {each: (value, metadata) for each, value, metadata in settings(default)}[name]
    candidates = [choice for choice in metadata['choices'] if choice != value] or [
        kind for limit in ('high', 'low') if metadata[limit] is not None
        and (kind := type(value)(metadata[limit])) != value] or [not value]
    for candidate in candidates:
        try:
            return with_settings(default, {name: candidate})
        except ConfigError:
            continue
    pytest.fail(f'{name}: no other value')


AT_ONCE = [name for name, value, metadata in settings(PipelineConfig())
           if type(value) is not str or metadata['choices']
           if not name.startswith('load.') and not is_fixed(name)
           and not structural_changes(PipelineConfig(), other(name))]


def test_thresholds_apply_at_once():
    assert {'objects.min_side_px', 'art2.vigilance', 'tracks.confirm_s', 'ego_motion.max_corners'} <= set(AT_ONCE)


@pytest.mark.parametrize('name', AT_ONCE)
def test_what_applies_at_once_applies_everywhere(name: str):
    """Nothing holds on to the old value: after a reset the pipeline is as one that never had it."""
    late, early = MotionPipeline(), MotionPipeline(other(name))
    show(late, 0, 2)
    late.use_config(other(name))
    late.reset()
    assert show(late, 0, 5) == show(early, 0, 5)


def test_history_stays_where_it_can():
    pipeline = MotionPipeline()
    show(pipeline, 0)
    before = pipeline.process(SCENES[FRAMES], (FRAMES + 1) * PERIOD_NS)
    pipeline.use_config(with_settings(pipeline.config, {'tracks.coast_s': 0.5, 'objects.min_side_px': 8.0}))
    after = pipeline.process(SCENES[FRAMES + 1], (FRAMES + 2) * PERIOD_NS)
    assert len(before.detections) == 1
    assert list(after.detections['id']) == list(before.detections['id'])
    assert after.ego.status == EgoStatus.OK


def test_a_structural_change_starts_anew_and_ids_go_on():
    pipeline = MotionPipeline()
    show(pipeline, 0)
    config = with_settings(pipeline.config, {'optical_flow.baseline_s': 0.08, 'preprocessing.max_width_px': 400})
    assert structural_changes(pipeline.config, config) == ['preprocessing.max_width_px', 'optical_flow.baseline_s']
    pipeline.use_config(config)
    first = pipeline.process(SCENES[FRAMES], (FRAMES + 1) * PERIOD_NS)
    assert (first.ego.status, len(first.detections)) == (EgoStatus.FIRST_FRAME, 0)
    fresh = MotionPipeline(config)
    fresh.process(SCENES[FRAMES], (FRAMES + 1) * PERIOD_NS)
    for index in range(FRAMES + 1, 2 * FRAMES):
        found, wanted = (each.process(SCENES[index], (index + 1) * PERIOD_NS) for each in (pipeline, fresh))
        assert found.flow.flow.tobytes() == wanted.flow.flow.tobytes()
        assert len(found.detections) == len(wanted.detections)
    assert min(found.detections['id']) == 2


def test_a_method_that_is_not_here_changes_nothing():
    pipeline, other_one = MotionPipeline(), MotionPipeline()
    onnx = replace(pipeline.config.optical_flow, method='onnx', onnx_model='/nowhere.onnx')
    with pytest.raises(BackendError):
        pipeline.use_config(replace(pipeline.config, optical_flow=onnx, load=replace(pipeline.config.load)))
    assert pipeline.config == PipelineConfig()
    assert show(pipeline, 0) == show(other_one, 0)
