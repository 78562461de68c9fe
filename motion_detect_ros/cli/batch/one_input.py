"""One input through a fresh pipeline, from its first wanted frame to its last."""

from __future__ import annotations

import sys
import traceback
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from time import thread_time

import motion_detect_ros
from motion_detect_ros.cli.batch.earlier import Found, look
from motion_detect_ros.cli.batch.frame_steps import DoneFrame, frames_done, gyro_of
from motion_detect_ros.cli.batch.inputs import size_of
from motion_detect_ros.cli.batch.jobs import (
    NOTHING,
    OK,
    PARTIAL,
    UNREADABLE,
    Job,
    Outcome,
    StoppedError,
    UnfinishedError,
    Watch,
)
from motion_detect_ros.core.errors import MotionDetectError, SourceError
from motion_detect_ros.core.pipeline import MotionPipeline
from motion_detect_ros.core.settings import settings
from motion_detect_ros.core.threads import use
from motion_detect_ros.report.make import report_after_replay
from motion_detect_ros.results.formats import clear, output_names
from motion_detect_ros.results.outputs import ReplayOutputs
from motion_detect_ros.results.ownership import BusyError, owned
from motion_detect_ros.results.summary import Percentiles, Summary, read_summary, write_summary
from motion_detect_ros.results.tally import Tally
from motion_detect_ros.sources.frames import FrameSource, first_reason
from motion_detect_ros.sources.opening import open_source


def run_job(job: Job, watch: Watch = lambda done, total: None) -> Outcome:
    """Replay one input; whatever goes wrong becomes the outcome, so that the other inputs still run."""
    try:
        outcome = outcome_of(job, replay(job, watch))
        trouble = report_after_replay(job.folder) if job.report else ''
        return replace(outcome, line=f'{outcome.line}; {trouble}') if trouble else outcome
    except UnfinishedError as error:
        return Outcome(PARTIAL, f'error: {error}')
    except MotionDetectError as error:
        return Outcome(UNREADABLE, f'error: {error}')
    except StoppedError:
        return Outcome(PARTIAL, f'{job.folder}: stopped')
    except Exception as error:  # of a defect in here the others shall not suffer either
        traceback.print_exc(file=sys.stderr)
        return Outcome(NOTHING, f'error: {job.path}: {type(error).__name__}: {error}')


def outcome_of(job: Job, summary: Summary) -> Outcome:
    """What a summary says, in one line."""
    line = (f'{job.folder}: {summary.frames} frames, {summary.detections} detections of {summary.objects} objects, '
            f'{summary.stage_ms["total"].p50:.1f} ms of processor time a frame')
    if summary.bad_frames:
        line += f', {summary.bad_frames} bad frames left out'
    if summary.misstamped_frames:
        line += f', {summary.misstamped_frames} left out, their stamps were seen already, late or out of range'
    line += ''.join(f'; {warning}' for warning in summary.warnings)
    if summary.damaged:
        line += f'; {summary.damaged}'
    if not summary.frames:
        asked = job.start_s is not None or job.duration_s is not None
        return Outcome(NOTHING, line + (f'; nothing {job.window}' if asked else ''))
    most_left_out = summary.misstamped_frames > summary.frames  # more than pictures that come twice
    return Outcome(PARTIAL if summary.bad_frames or summary.damaged or most_left_out else OK, line)


def replay(job: Job, watch: Watch = lambda done, total: None) -> Summary:
    """Run one input through a fresh pipeline and write its outputs.

    What another process finished meanwhile is taken as it is.
    Raises: SourceError for an input that cannot be read, a folder that cannot be written or by now holds something
    else, BusyError where another process writes it; UnfinishedError where that comes to be after the first frame; what
    ``watch`` raises. Whatever ends the run, outputs and summary hold what was done.
    """
    input_bytes = size_of(job.path)  # before it is read: what grows meanwhile is another input next time
    source = open_source(job.path, job.fps, job.topic, job.window, job.rectified)
    pipeline = MotionPipeline(job.config, clock=thread_time)
    gyro = gyro_of(source, job.config)
    use(job.config.load.threads)
    tally = Tally()

    def summary_now(complete: bool) -> Summary:
        return _summarize(job, input_bytes, source, pipeline, tally, complete)

    _make_folder(job.folder)
    with owned(job.folder) as owner:
        if look(job) is Found.FINISHED:
            return read_summary(job.folder)
        try:
            _begin(job, summary_now(complete=False))
            with ReplayOutputs(job.folder, str(job.path), job.formats) as outputs:
                with frames_done(job, source, pipeline, gyro, tally) as frames:
                    for done in frames:
                        _write(done, outputs, tally)
                        watch(done.frame.index + 1, source.frame_count)
                owner.check()
            summary = summary_now(complete=True)
            write_summary(job.folder, summary)
        except BaseException as error:
            if owner.holds():
                with suppress(OSError):
                    write_summary(job.folder, summary_now(complete=False))
            if isinstance(error, OSError):
                error = SourceError(f'{job.folder}: cannot be written: {error.strerror or error}')
            if isinstance(error, SourceError) and tally.frames and not isinstance(error, BusyError):
                error = UnfinishedError(f'{error}; {tally.frames} frames are kept in the .part files')
            raise error from None
    return summary


def _write(done: DoneFrame, outputs: ReplayOutputs, tally: Tally) -> None:
    frame = done.frame
    tally.calibrated |= frame.calibrated
    if done.result is None:
        tally.bad_frames += 1
        tally.bad_reason = first_reason(tally.bad_reason, frame.index, done.refused)
    else:
        outputs.write(frame.index, frame.decode_ms, done.result, frame.image, frame.frame_id)
        tally.add(done.result, done.tuned)


def _begin(job: Job, summary: Summary) -> None:
    """Empty the folder of earlier results, and leave a summary that says for what they were begun. Raises: OSError."""
    clear(job.folder, output_names(job.formats))
    write_summary(job.folder, summary)


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SourceError(f'{folder}: cannot be made a folder for the outputs: {error.strerror}') from None


def _summarize(
    job: Job, input_bytes: int | None, source: FrameSource, pipeline: MotionPipeline, tally: Tally, complete: bool,
) -> Summary:
    reason = source.bad_reason or tally.bad_reason
    return Summary(
        input=str(job.path), input_bytes=input_bytes, fps=job.fps, topic=job.topic, start_s=job.start_s,
        duration_s=job.duration_s, every=job.every, rectified=job.rectified, formats=list(job.formats),
        overlay=job.overlay, version=motion_detect_ros.__version__, complete=complete, damaged=source.damaged,
        announced_frames=source.frame_count, frames=tally.frames, bad_frames=tally.bad_frames + source.bad_frames,
        misstamped_frames=tally.misstamped_frames, source_frames=source.frames_passed, detections=tally.detections,
        objects=len(tally.ids), ego_status=dict(tally.ego_status), image_size=tally.image_size,
        calibrated=tally.calibrated, first_stamp_ns=tally.first_stamp_ns, last_stamp_ns=tally.last_stamp_ns,
        stage_ms=tally.stage_ms(), decode_ms=Percentiles.of(tally.decode_ms),
        settings={name: value for name, value, _ in settings(job.config)}, tuned=tally.tuned,
        warnings=[*([f'the first bad one, {reason}'] if reason else ()), *source.complaints, *pipeline.complaints])
