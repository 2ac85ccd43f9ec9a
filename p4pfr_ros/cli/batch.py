# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr batch``: many recordings, on many processes or machines."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import hashlib
import json
import logging
from pathlib import Path
import sys
from typing import Any

from p4pfr_ros import EstimateOptions
from p4pfr_ros.cli.arguments import (
    add_estimate_option,
    add_estimate_switch,
    count,
    load_board_with_notes,
)
from p4pfr_ros.cli.terminal import prepare_kernels, print_table, with_progress
from p4pfr_ros.cli.workers import available_cores, without_interrupts
from p4pfr_ros.files.dependencies import require
from p4pfr_ros.files.writing import write_atomically, write_bytes_atomically
from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.report.image_pose import TUM_HEADINGS
from p4pfr_ros.report.number_format import plus_minus
from p4pfr_ros.report.recording import (
    csv_text,
    process_recording,
    RecordingResult,
    RecordingTask,
    SUMMARY_COLUMNS,
)

_EPILOG = """\
A recording is a bag, a video, or a folder of images. Each is calibrated by
itself, and its poses are estimated with its camera (if the camera is not
calibrated, each pose with a camera of its own). Each gets a folder in DIR:

  camera.yaml  the camera, if it is calibrated (--force: in either case)
  poses.csv    what p4pfr estimate --csv prints
  poses.tum    what p4pfr estimate --tum prints
  report.png   what p4pfr calibrate --plot writes
  done.json    that the files are complete, and what they were made from

DIR/summary.csv has a row for each recording. A recording that cannot be read
costs its own row only; the exit status is then 1. If the command is
interrupted, run it again: recordings that are done are skipped, unless they,
the board or the options have changed.

Without --scheduler, dask.distributed starts processes on this machine. With
the address of a scheduler, its workers read the recordings, by the same paths
as here; only this process writes. A recording whose worker ends is given to
another one.
"""
_DONE, _SUMMARY = 'done.json', 'summary.csv'
_HEADINGS = ('recording', 'images', 'views', 'poses', 'f, px', 'rms, px', 'state')
_UNKNOWN, _FAILED = '?', 'failed'
_CONNECTION_TIMEOUT_S = 10
_LOOPBACK = '127.0.0.1'


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A recording: what to do with it, the folder of its results, and a hash of what they need."""

    task: RecordingTask
    folder: Path
    key: str

    @property
    def name(self) -> str:
        """Name of the folder."""
        return self.folder.name


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser."""
    text = 'calibrate and estimate poses in many recordings, on many processes or machines'
    parser = commands.add_parser(
        'batch',
        help=text,
        description=f'{text[0].upper()}{text[1:]}.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run)
    add = parser.add_argument
    add('recordings', nargs='+', type=Path, metavar='RECORDING', help='bag, video, or folder')
    add('--board', required=True, metavar='FILE', help='board file (YAML)')
    add('-o', '--output', required=True, type=Path, metavar='DIR', help='folder to write to')
    add('--topic', help="image topic in the bags (default: each bag's only image topic)")
    add('--every', type=count, default=1, metavar='N', help='use every N-th image only')
    add('--moving', choices=tuple(TUM_HEADINGS), default='camera', help='as of p4pfr estimate')
    add('--force', action='store_true', help='write cameras even if they are not calibrated')
    add_estimate_option(parser, '--threshold', 'threshold_px', 'PX')
    add_estimate_option(parser, '--seed', 'seed', 'N')
    add_estimate_switch(parser, '--two-sided', 'two_sided')
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        '--jobs',
        type=count,
        default=available_cores(),
        metavar='N',
        help='largest number of processes on this machine (default: %(default)s, all cores)',
    )
    where.add_argument(
        '--scheduler', metavar='ADDRESS', help='scheduler of dask.distributed: tcp://HOST:PORT'
    )


def run(arguments: argparse.Namespace) -> int:
    """Process the recordings; return 1 if any failed."""
    _distributed()
    for module in ('matplotlib', 'rich'):
        require(module)
    recordings = _recordings(arguments)
    summaries: dict[str, dict[str, Any]] = {}
    for recording in recordings:
        done = _done_before(recording)
        if done is not None:
            summaries[recording.name] = done
    left = [recording for recording in recordings if recording.name not in summaries]
    if summaries:
        print(f'{len(summaries)} of {len(recordings)} recordings are done: skipped')
    if left:
        prepare_kernels()
        with _client(arguments.scheduler, min(arguments.jobs, len(left))) as client:
            processed = _processed(client, left)
            for name, summary in with_progress(processed, len(left), prints=False):
                summaries[name] = summary
                _write_summary(arguments.output, recordings, summaries)
    _write_summary(arguments.output, recordings, summaries)
    _print(recordings, summaries)
    return int(any('error' in summary for summary in summaries.values()))


def _recordings(arguments: argparse.Namespace) -> list[Recording]:
    """
    Return the recordings with their folders.

    Raises
    ------
    ConfigError
        The board file is wrong, or a recording is given twice.

    """
    board = load_board_with_notes(arguments.board)
    options = EstimateOptions(
        threshold_px=arguments.threshold, seed=arguments.seed, two_sided=arguments.two_sided
    )
    paths = [path.resolve() for path in arguments.recordings]
    recordings = []
    for path, name in zip(paths, _distinct_names(paths), strict=True):
        task = RecordingTask(
            path=path,
            board=board,
            options=options,
            topic=arguments.topic,
            every=arguments.every,
            moving=arguments.moving,
            force=arguments.force,
        )
        recordings.append(Recording(task, arguments.output / name, _key(task)))
    return recordings


def _distinct_names(paths: Sequence[Path]) -> list[str]:
    """Return short names of paths: their last parts, as many as tell them apart."""
    for path in paths:
        if paths.count(path) > 1:
            raise ConfigError(f'{path}: expected each recording once')
    names = [path.name for path in paths]
    parts = 1
    while len(set(names)) < len(names):
        parts += 1
        names = [
            '_'.join(path.parts[-parts:]).strip('/') if names.count(name) > 1 else name
            for name, path in zip(names, paths, strict=True)
        ]
    return names


def _key(task: RecordingTask) -> str:
    """Return a hash of the recording, the board and the options, which the results depend on."""
    files = sorted(task.path.rglob('*')) if task.path.is_dir() else [task.path]
    stats = [(str(path), path.stat()) for path in files if path.is_file()]
    content = [(name, stat.st_size, stat.st_mtime_ns) for name, stat in stats]
    how = (task.board, task.options, task.topic, task.every, task.max_megapixels, task.moving)
    text = repr((content, how, task.force, task.version))
    return hashlib.sha256(text.encode()).hexdigest()


def _done_before(recording: Recording) -> dict[str, Any] | None:
    """Return the summary of a recording that is done; None if it has to be processed."""
    try:
        done = json.loads((recording.folder / _DONE).read_text())
        is_complete = all((recording.folder / name).is_file() for name in done['files'])
        summary: dict[str, Any] = done['summary']
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return summary if is_complete and done.get('key') == recording.key else None


def _distributed() -> Any:
    """Import the library: slow, and an optional dependency."""
    try:
        import distributed
    except ImportError:
        require('distributed')
        raise
    return distributed


@contextmanager
def _client(address: str | None, jobs: int) -> Iterator[Any]:
    """
    Connect to a scheduler: at an address, or of processes on this machine.

    Raises
    ------
    ConfigError
        There is no scheduler, or its workers have another version of this package.

    """
    distributed = _distributed()
    # What it logs about workers that end, each becomes a row of the summary if it matters.
    logging.getLogger('distributed').setLevel(logging.CRITICAL)
    if address is None:
        # Its threads start the processes, which ignore Ctrl-C like them.
        with without_interrupts():
            cluster = distributed.LocalCluster(
                n_workers=jobs,
                threads_per_worker=1,
                host=_LOOPBACK,
                # Of their web servers, which would listen everywhere: any free port.
                dashboard_address=f'{_LOOPBACK}:0',
                worker_dashboard_address=f'{_LOOPBACK}:0',
                scheduler_kwargs={'dashboard': False},
                memory_limit=None,
                silence_logs=logging.CRITICAL,
            )
        with cluster, distributed.Client(cluster) as client:
            yield client
        return
    try:
        client = distributed.Client(address, timeout=_CONNECTION_TIMEOUT_S)
    except (OSError, ValueError) as error:
        raise ConfigError(f'--scheduler {address}: expected a scheduler: {error}') from None
    with client:
        if not client.scheduler_info()['workers']:
            print(f'p4pfr: {address}: waiting for workers', file=sys.stderr)
        yield client


def _processed(
    client: Any, recordings: Sequence[Recording]
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield the name and the summary of each recording when it is done and its files written."""
    futures = {
        client.submit(
            process_recording, each.task, key=f'{each.name}-{each.key}', pure=False
        ): each
        for each in recordings
    }
    for future in _distributed().as_completed(list(futures)):
        recording = futures.pop(future)
        yield recording.name, _finished(future, recording)
        future.release()


def _finished(future: Any, recording: Recording) -> dict[str, Any]:
    """Write the results of a recording; return its summary, or what went wrong."""
    error = future.exception()
    if isinstance(error, _distributed().KilledWorker):
        return {'error': 'its worker processes ended, maybe for lack of memory'}
    if error is not None:
        kind = '' if isinstance(error, ConfigError) else f'{type(error).__name__}: '
        text = ' '.join(str(error).split()).removeprefix(f'{recording.task.path}: ')
        return {'error': kind + text}
    result: RecordingResult = future.result()
    (recording.folder / _DONE).unlink(missing_ok=True)
    for name, content in result.files.items():
        write_bytes_atomically(recording.folder / name, content)
    # Last: it says that all others are there.
    done = {'key': recording.key, 'files': sorted(result.files), 'summary': result.summary}
    write_atomically(recording.folder / _DONE, json.dumps(done, indent=1) + '\n')
    return result.summary


def _write_summary(
    folder: Path, recordings: Sequence[Recording], summaries: dict[str, dict[str, Any]]
) -> None:
    rows = [
        [str(each.task.path), *(summaries[each.name].get(column) for column in SUMMARY_COLUMNS)]
        for each in recordings
        if each.name in summaries
    ]
    write_atomically(folder / _SUMMARY, csv_text(('recording', *SUMMARY_COLUMNS), rows))


def _print(recordings: Sequence[Recording], summaries: dict[str, dict[str, Any]]) -> None:
    """Print a row for each recording, and to stderr why some have failed."""
    rows = (_cells(recording.name, summaries[recording.name]) for recording in recordings)
    print_table(_HEADINGS, rows, left=('recording', 'state'), optional=('views', 'images'))
    for recording in recordings:
        error = summaries[recording.name].get('error')
        if error:
            print(f'p4pfr: {recording.task.path}: {error}', file=sys.stderr)


def _cells(name: str, summary: dict[str, Any]) -> Iterator[str]:
    yield name
    for column in ('images', 'views', 'poses'):
        yield str(summary.get(column, _UNKNOWN))
    focal_px = summary.get('focal_px')
    yield _UNKNOWN if focal_px is None else plus_minus(focal_px, summary['sigma_focal_px'])
    yield f'{summary["rms_px"]:.3f}' if 'rms_px' in summary else _UNKNOWN
    yield summary.get('state', _FAILED)
