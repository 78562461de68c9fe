"""The published schema of summary.json against what replay writes, by jsonschema."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import pytest
from result_samples import detections, summary

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import SourceError
from motion_detect_ros.core.types import EgoStatus
from motion_detect_ros.presets import find_config
from motion_detect_ros.results.formats import FORMATS
from motion_detect_ros.results.live_summary import LiveSummary, read_live_summary, write_live_summary
from motion_detect_ros.results.summary import STAGES, Summary, write_summary

jsonschema = pytest.importorskip('jsonschema', reason='pip install jsonschema')
SCHEMA: dict[str, Any] = json.loads(find_config('summary.schema.json').read_text(encoding='utf-8'))
REPLAY = SCHEMA['$defs']['replay']
FULL = summary()
LIVE = {'input': 'a.mcap', 'version': '0.1.0', 'live': True, 'frames': 2, 'source_frames': 2, 'answered': 0,
        'detections': 0, 'objects': 0, 'latency_ms': {'p50': None, 'p95': None, 'p99': None}}


def errors(content: Any) -> list[str]:
    validator = jsonschema.Draft202012Validator(SCHEMA)
    return [error.message for error in validator.iter_errors(json.loads(json.dumps(content)))]


def test_the_schema_is_one() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


def test_it_has_the_fields_of_a_summary_and_their_names() -> None:
    assert list(REPLAY['properties']) == [field.name for field in fields(Summary)] == REPLAY['required']
    assert REPLAY['properties']['formats']['items']['enum'] == list(FORMATS)
    assert REPLAY['properties']['ego_status']['propertyNames']['enum'] == [status.name.lower() for status in EgoStatus]
    assert tuple(REPLAY['properties']['stage_ms']['required']) == STAGES


def test_a_summary_is_valid_as_written(tmp_path: Path) -> None:
    write_summary(tmp_path, FULL)
    assert errors(json.loads((tmp_path / 'summary.json').read_text(), parse_constant=pytest.fail)) == []


@pytest.mark.parametrize(('changed', 'complaint'), [
    ({'frames': -1}, '-1 is less than the minimum of 0'),
    ({'frames': 1.5}, "1.5 is not of type 'integer'"),
    ({'formats': ['xml']}, "'xml' is not one of"),
    ({'image_size': (320,)}, '[320] is too short'),
    ({'ego_status': {'lost': 3}}, "'lost' is not one of"),
    ({'every': 0}, '0 is less than the minimum of 1'),
    ({'settings': {'load.threads': None}}, "None is not of type 'boolean', 'number', 'string'"),
])
def test_a_wrong_value_is_seen(changed: dict[str, Any], complaint: str) -> None:
    found = errors({**asdict(FULL), **changed})
    assert len(found) == 1
    assert complaint in found[0]


@pytest.mark.parametrize('name', [field.name for field in fields(Summary)])
def test_a_missing_field_is_seen(name: str) -> None:
    content = asdict(FULL)
    del content[name]
    assert errors(content) == [f"'{name}' is a required property"]


def test_the_summary_of_a_live_replay_is_valid_too() -> None:
    assert errors(LIVE) == []
    assert errors({**LIVE, 'answered': None}) == ["None is not of type 'integer'"]
    assert errors({**LIVE, 'damaged': 7}) == ["7 is not of type 'string', 'null'"]
    assert set(SCHEMA['$defs']['live']['properties']) == {field.name for field in fields(LiveSummary)}


def test_an_earlier_summary_of_a_live_replay_is_read(tmp_path: Path) -> None:
    (tmp_path / 'summary.json').write_text(json.dumps(LIVE))
    read = read_live_summary(tmp_path)
    assert (read.input, read.answered, read.input_bytes, read.latency_ms) == ('a.mcap', 0, None, LIVE['latency_ms'])
    assert read.damaged is None
    for name, value in (('answered', None), ('latency_ms', {'p50': 1}), ('input', 7), ('damaged', 7)):
        (tmp_path / 'summary.json').write_text(json.dumps({**LIVE, name: value}))
        with pytest.raises(SourceError, match=r'summary\.json: expected the summary of replay --live, got \w+Error: '):
            read_live_summary(tmp_path)


@pytest.mark.parametrize(('answers', 'damaged'), [(0, None), (2, None), (2, 'a.mcap: the end is missing')])
def test_so_it_is_as_written(answers: int, damaged: str | None, tmp_path: Path) -> None:
    """Without answers there is no latency, which JSON cannot say as NaN."""
    pytest.importorskip('rclpy', reason='ROS 2 is not installed')
    from motion_detect_ros.cli.batch.jobs import Job
    from motion_detect_ros.cli.live_replay import Recorded, live_summary
    from motion_detect_ros.cli.planner import Received
    received = tuple(Received(number, detections((7, 1, 2, 3, 4, 0.5)), 20.0) for number in range(answers))
    job = Job('a.mcap', tmp_path, PipelineConfig())
    write_live_summary(tmp_path, live_summary(job, None, Recorded(2, (1, 2), {}, 0, damaged), received))
    content = json.loads((tmp_path / 'summary.json').read_text(), parse_constant=pytest.fail)
    assert errors(content) == []
    assert (content['objects'], content['damaged']) == (min(answers, 1), damaged)
    assert content['latency_ms'] == dict.fromkeys(('p50', 'p95', 'p99'), 20.0 if answers else None)
