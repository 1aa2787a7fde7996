# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Bags as a data set for learning: LeRobotDataset v3.0, written by pyarrow alone.

`tactile export --help` says what a frame holds. A window has as many tactile frames as come
between two frames at most; older ones fill it up, at the beginning the first one. The format is
that of huggingface/lerobot, docs/source/lerobot-dataset-v3.mdx and src/lerobot/datasets.
"""

from __future__ import annotations

import io
import json
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import IO, Any, TypeAlias

import numpy as np

from tactile_ros.errors import RecordingError
from tactile_ros.evaluation import export
from tactile_ros.evaluation.bag import Taker
from tactile_ros.evaluation.cdr_columns import read_columns, stamps_of
from tactile_ros.evaluation.export import Arrow, Column
from tactile_ros.evaluation.recording_files import MessageBuffer
from tactile_ros.files import temporary_folder, write_atomically
from tactile_ros.hands.drivers import JOINT_STATE, NUMBERS, TRAJECTORY
from tactile_ros.pipeline import Pipeline
from tactile_ros.types import Columns, Integers, Layout

Feature: TypeAlias = dict[str, Any]  # as json has it: dtype, shape, names
Statistics: TypeAlias = dict[str, Any]  # lists, nested for images
IMAGE = 'sensor_msgs/msg/CompressedImage'
NS_PER_S = 1_000_000_000
QUANTILES = {'q01': 0.01, 'q10': 0.1, 'q50': 0.5, 'q90': 0.9, 'q99': 0.99}
LOWER = ('min', 'q01', 'q10', 'q50')  # bounds of quantiles, where episodes are pooled
MOST_SAMPLED, MOST_IMAGES, PIXELS = 20_000, 100, 150  # of an episode, for quantiles and colours
ROWS, IMAGE_ROWS = 1 << 16, 256  # written at a time; with images
UNEVEN = 50  # times the usual number of frames: stamps that jump, or stand still
FILE_BYTES, FILES = 100_000_000, 1000  # of a file; in a folder
PLACE = '{}/chunk-{:03d}/file-{:03d}.parquet'


@dataclass
class Series:
    """Values (s, ...) of one feature in the order of their stamps (ns)."""

    stamp_ns: Integers
    values: Column
    names: tuple[str, ...] = ()
    layout: Layout | None = None

    @classmethod
    def join(cls, parts: Sequence[Series]) -> Series:
        """All parts, by their stamps."""
        stamps = np.concatenate([part.stamp_ns for part in parts])
        order = np.argsort(stamps, kind='stable')
        values = np.concatenate([part.values for part in parts])[order]
        return cls(stamps[order], values, parts[0].names, parts[0].layout)

    def held(self, times: Integers) -> Column:
        """Latest values until each time; before the first one the first."""
        return np.asarray(self.values[np.maximum(self.ends(times) - 1, 0)])

    def ends(self, times: Integers) -> Integers:
        """Number of samples until each time."""
        return np.searchsorted(self.stamp_ns, times, side='right').astype(np.int64)


class Images:
    """Compressed images of one topic, at the end of a file until they are written."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._stamps: list[int] = []
        self._places: list[tuple[int, int]] = []
        self.shape: tuple[int, ...] = ()
        self.left_out: Counter[str] = Counter()

    def take(self, log_ns: int, data: bytes) -> None:
        """Keep an image of the size of the first one, if it can be opened."""
        groups, _ = read_columns([data], IMAGE)
        try:
            image = groups[0].columns['data'].tobytes()
            opened = import_module('PIL.Image').open(io.BytesIO(image))
            shape = opened.height, opened.width, 3
        except ImportError:
            self.left_out['are left out, they need pillow: pip install pillow'] += 1
            return
        except Exception:  # whatever the library makes of it
            self.left_out['are left out, they cannot be opened'] += 1
            return
        self.shape = self.shape or shape
        if shape != self.shape:
            self.left_out['are left out, their size is not that of the first'] += 1
            return
        stamp = int(stamps_of(groups[0].columns)[0])
        self._stamps.append(stamp if stamp > 0 else log_ns)
        self._places.append((self._file.seek(0, io.SEEK_END), len(image)))
        self._file.write(image)

    @cached_property
    def numbers(self) -> Series:
        """Numbers of the images."""
        stamps = np.array(self._stamps, np.int64)
        return Series.join([Series(stamps, np.arange(len(stamps)))])

    def read(self, number: int) -> bytes:
        """Read an image as it was sent."""
        at, size = self._places[number]
        self._file.seek(at)
        return self._file.read(size)

    def column(self, times: Integers) -> Arrow:
        """Images of some times as the format keeps them."""
        pa, held = export.arrow(), self.numbers.held(times).tolist()
        data = pa.array([self.read(number) for number in held], pa.binary())
        names = pa.array([f'frame-{number:06d}' for number in held])
        return pa.StructArray.from_arrays([data, names], ['bytes', 'path'])

    def statistics(self, count: int) -> Statistics:
        """Statistics of red, green and blue, 0 to 1, of some pixels of some images."""
        some = np.linspace(0, len(self._places) - 1, MOST_IMAGES).astype(int)
        opened, found = import_module('PIL.Image').open, [np.zeros((0, 3))]
        for number in np.unique(some).tolist():
            try:
                image = np.asarray(opened(io.BytesIO(self.read(number))).convert('RGB'))
            except Exception:  # its end is missing
                continue
            step = max(1, min(image.shape[:2]) // PIXELS)
            found.append(image[::step, ::step].reshape(-1, 3) / 255.0)
        made = statistics(np.concatenate(found), count)
        return {k: v if k == 'count' else [[[one]] for one in v] for k, v in made.items()}


def hand_feature(topic: str, kind: str) -> str:
    """Feature that a topic of a hand gives; '': none."""
    leaf = topic.rpartition('/')[2]
    if kind == JOINT_STATE:
        return 'observation.state' if leaf == 'joint_states' else 'action'
    commands = kind == TRAJECTORY or (kind == NUMBERS and leaf == 'commands')
    return 'action' if commands else ''


class HandBag(export.ExportBag):
    """Bag that also gives joint states, commands and images."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        super().__init__(path)
        self._file = file
        self.messages: dict[tuple[str, str], MessageBuffer] = {}
        self.images: dict[str, Images] = {}

    def handler(self, topic: str, kind: str) -> Taker | None:
        """Find the function that takes the messages of a topic."""
        feature = hand_feature(topic, kind)
        if not feature and kind != IMAGE:
            return super().handler(topic, kind)
        self.exported.add(topic)
        if feature:
            return self.messages.setdefault((topic, kind), MessageBuffer()).append
        return self.images.setdefault(topic, Images(self._file)).take

    def finish(self) -> None:
        """Say what was not exported."""
        super().finish()
        for topic, images in self.images.items():
            lost = images.left_out.items()
            self.sentences += [f'{count} images of {topic} {why}' for why, count in lost]

    def joints(self, feature: str) -> Series | None:
        """Values of all topics and joints that give a feature; None: the bag has none.

        Where joints come in messages of their own, the others hold their last values.
        """
        parts: dict[tuple[str, ...], list[Series]] = {}
        for (topic, kind), buffer in sorted(self.messages.items()):
            if hand_feature(topic, kind) != feature:
                continue
            lost = len(buffer.data)
            for group in read_columns(buffer.data, kind)[0]:
                logs = np.array(buffer.logs, np.int64)[group.rows]
                for one in _by_names(topic, group.columns, logs):
                    parts.setdefault((topic, *one.names), []).append(one)
                    lost -= len(one.stamp_ns)
            if lost:
                self.sentences.append(f'{lost} messages of {topic} without positions left out')
        if not parts:
            return None
        series = [Series.join(part) for _, part in sorted(parts.items())]
        times = np.unique(np.concatenate([one.stamp_ns for one in series]))
        values = np.concatenate([one.held(times) for one in series], axis=1)
        return Series(times, values, tuple(name for one in series for name in one.names))


def _by_names(topic: str, columns: Columns, logs: Integers) -> Iterator[Series]:
    points = sum(key.endswith('.positions') for key in columns)
    keys = ('position', 'data', f'points.{points - 1}.positions')
    values = next((columns[k] for k in keys if k in columns), logs[:, None][:, :0])
    stamps = stamps_of(columns) if 'header.stamp.sec' in columns else np.zeros_like(logs)
    stamps = np.where(stamps > 0, stamps, logs)
    texts = [columns[k] for k in columns if k.partition('.')[0] in ('name', 'joint_names')]
    joined = np.concatenate([np.zeros((len(logs), 1), np.uint8), *texts], axis=1)
    _, first, alike = np.unique(joined, axis=0, return_index=True, return_inverse=True)
    for number, row in enumerate(first.tolist()):
        names = tuple(t[row].tobytes().rstrip(b'\0').decode('utf-8', 'replace') for t in texts)
        names = names or tuple(f'{topic}[{i}]' for i in range(values.shape[1]))
        rows = alike.reshape(-1) == number
        if len(names) == values.shape[1] > 0:
            yield Series(stamps[rows], values[rows].astype(np.float32), names)


@dataclass
class Episode:
    """Features of one bag, each at its own rate, and the times (n,) of its frames (ns)."""

    path: Path
    tactile: dict[str, Series]  # in windows
    hand: dict[str, Series]  # held
    images: dict[str, Images]
    times: Integers

    @classmethod
    def read(
        cls, bag: HandBag, fps: int, pipelines: Sequence[Pipeline], done: export.Export
    ) -> Episode:
        """Read a bag; RecordingError if it has no frame, or stamps that jump far."""
        parts, forces = dict[str, list[Series]](), dict[str, export.TaxelForces]()
        for space, piece in bag:
            one, name = piece.recording, export.plain_name(piece.name)
            assert one.stamp_ns is not None
            if space not in forces:
                forces[space] = export.TaxelForces(pipelines, piece)
                bag.note_forces(space, forces[space])
            for what, values in (('', one.values), ('_force', forces[space].of(piece))):
                if values is not None:
                    with np.errstate(over='ignore'):
                        single = values.astype(np.float32)
                    part = Series(one.stamp_ns, single, (), one.layout)
                    parts.setdefault(f'observation.tactile{what}.{name}', []).append(part)
        hand = {feature: bag.joints(feature) for feature in ('observation.state', 'action')}
        done.add_bag(bag)
        tactile = {key: Series.join(part) for key, part in sorted(parts.items())}
        stamps = [one.stamp_ns for one in tactile.values()]
        begin, most = min(int(s[0]) for s in stamps), max(map(len, stamps))
        span = max(int(s[-1]) for s in stamps) - begin
        count = -(-span * fps // NS_PER_S) + 1
        if count > UNEVEN * (most + fps):
            msg = (
                f'{bag.path.name}: its {most} frames are spread over {span / NS_PER_S:.3g} s; '
                '`tactile doctor BAG` shows where stamps jump'
            )
            raise RecordingError(msg)
        images = {export.plain_name(topic): one for topic, one in bag.images.items() if one.shape}
        return cls(
            bag.path, tactile, {feature: one for feature, one in hand.items() if one is not None},
            {f'observation.images.{topic}': one for topic, one in images.items()},
            begin - (-np.arange(count, dtype=np.int64) * NS_PER_S // fps),
        )  # fmt: skip

    def largest_window(self, key: str) -> int:
        """Largest number of new samples of a frame; RecordingError where stamps stand still."""
        new = np.diff(self.tactile[key].ends(self.times), prepend=0)
        if new.max() > UNEVEN * (1 + new.mean()):
            msg = (
                f'{self.path.name}: {new.max()} frames of {key} have nearly the same stamp; '
                '`tactile doctor BAG` shows where they stand still'
            )
            raise RecordingError(msg)
        return int(new.max())

    def features(self, widths: dict[str, int]) -> dict[str, Feature]:
        """Types and shapes of all features, in the order of the columns."""
        found: dict[str, Feature] = {}
        for key, one in self.tactile.items():
            assert one.layout is not None
            found[key] = {
                'dtype': 'float32', 'shape': [widths[key], *one.values.shape[1:]],
                'names': ['frame', 'taxel', 'channel'], 'info': export.described(one.layout),
            }  # fmt: skip
            if 'tactile_force' in key:
                found[key]['info'].update(unit='N', channels=['x', 'y', 'z'])
            else:
                stem = key.removeprefix('observation.')
                found[f'{stem}.stamp_ns'] = _feature('int64', [widths[key]])
                found[f'{stem}.new'] = _feature('int64', [1])
        for key, one in self.hand.items():
            found[key] = _feature('float32', [len(one.names)], list(one.names))
        for key, images in self.images.items():
            found[key] = _feature('image', [*images.shape], ['height', 'width', 'channels'])
        found['timestamp'] = _feature('float32', [1])
        counted = ('stamp_ns', 'frame_index', 'episode_index', 'index', 'task_index')
        return {**found, **{key: _feature('int64', [1]) for key in counted}}

    def columns(self, number: int, start: int, widths: dict[str, int]) -> Columns:
        """Numbers of all frames, but for the readings in windows."""
        times, found = self.times, Columns()
        for key, one in self.tactile.items():
            if 'tactile_force' not in key:
                stem, width = key.removeprefix('observation.'), widths[key]
                found[f'{stem}.stamp_ns'] = one.stamp_ns[self.window(key, width)]
                found[f'{stem}.new'] = np.diff(one.ends(times), prepend=0)
        index = np.arange(len(times))
        return {
            **found, **{key: one.held(times) for key, one in self.hand.items()},
            'timestamp': ((times - times[0]) / NS_PER_S).astype(np.float32), 'stamp_ns': times,
            'frame_index': index, 'episode_index': np.full_like(index, number),
            'index': index + start, 'task_index': np.zeros_like(index),
        }  # fmt: skip

    def window(self, key: str, width: int) -> Integers:
        """Numbers (n, k) of the samples in the window of every frame."""
        ends = self.tactile[key].ends(self.times)
        return np.asarray(np.maximum(ends[:, None] - width + np.arange(width), 0))


def _feature(dtype: str, shape: list[int], names: list[str] | None = None) -> Feature:
    return {'dtype': dtype, 'shape': shape, 'names': names}


def statistics(values: Column, count: int) -> Statistics:
    """Statistics of every entry of the last axis, where it is finite, as of `count` frames."""
    found: dict[str, list[float]] = {key: [] for key in ('min', 'max', 'mean', 'std', *QUANTILES)}
    table = values.reshape(-1, values.shape[-1] if values.ndim > 1 else 1)
    for column in table.T:
        good = column[np.isfinite(column)]
        good = good if len(good) else np.zeros(1)
        some = good[:: -(-len(good) // MOST_SAMPLED)].astype(float)
        figures = [good.min(), good.max(), good.mean(dtype=float), good.std(dtype=float)]
        figures += np.quantile(some, [*QUANTILES.values()]).tolist()
        for key, figure in zip(found, figures, strict=True):
            found[key].append(float(figure))
    return {**found, 'count': [count]}


def pooled(parts: Sequence[Statistics]) -> Statistics:
    """Statistics of several episodes together; quantiles become bounds, as the format has it."""
    table = {key: np.array([part[key] for part in parts], float) for key in parts[0]}
    counts = table['count'].reshape(-1, *[1] * (table['mean'].ndim - 1))
    share = counts / counts.sum()
    found = {k: v.min(axis=0) if k in LOWER else v.max(axis=0) for k, v in table.items()}
    found['mean'] = (table['mean'] * share).sum(axis=0)
    variance = table['std'] ** 2 + (table['mean'] - found['mean']) ** 2
    found['std'] = np.sqrt((variance * share).sum(axis=0))
    return {**{k: v.tolist() for k, v in found.items()}, 'count': [int(counts.sum())]}


class DataSet:
    """LeRobotDataset v3.0 in a new folder, an episode after the other."""

    def __init__(self, folder: Path, fps: int, task: str, widths: dict[str, int]) -> None:
        self._folder, self._fps, self._task, self._widths = folder, fps, task, widths
        self._frames = self._file = 0
        self._features: dict[str, Feature] = {}
        self._rows: list[dict[str, Any]] = []
        self._stats: list[dict[str, Statistics]] = []
        self._writer: export.ParquetFile | None = None

    def add(self, episode: Episode) -> None:
        """Write the frames of an episode; RecordingError if it has other features."""
        self._check(episode)
        count, number = len(episode.times), len(self._rows)
        columns = episode.columns(number, self._frames, self._widths)
        self._write(episode, columns)
        stats = {key: statistics(column, count) for key, column in columns.items()}
        stats |= {key: statistics(s.values, count) for key, s in episode.tactile.items()}
        stats |= {key: images.statistics(count) for key, images in episode.images.items()}
        self._stats.append(stats)
        chunk, file = divmod(self._file, FILES)
        begin, self._frames = self._frames, self._frames + count
        self._rows.append({
            'episode_index': number, 'tasks': [self._task], 'length': count,
            'data/chunk_index': chunk, 'data/file_index': file,
            'dataset_from_index': begin, 'dataset_to_index': self._frames,
            'meta/episodes/chunk_index': 0, 'meta/episodes/file_index': 0,
            **{f'stats/{k}/{name}': v for k, one in stats.items() for name, v in one.items()},
        })  # fmt: skip
        if self._path.stat().st_size > FILE_BYTES:
            self._end_file()

    @property
    def _path(self) -> Path:
        return self._folder / PLACE.format('data', *divmod(self._file, FILES))

    def _check(self, episode: Episode) -> None:
        features = episode.features(self._widths)
        self._features = self._features or features
        ours, theirs = (
            {key: (one['shape'], one['names']) for key, one in listed.items()}
            for listed in (self._features, features)
        )
        if differ := sorted(k for k in {*ours, *theirs} if ours.get(k) != theirs.get(k)):
            named = ', '.join(differ)
            msg = f'{episode.path.name} differs from the first bag in {named}; export it apart'
            raise RecordingError(msg)

    def _write(self, episode: Episode, columns: Columns) -> None:
        windows = {key: episode.window(key, self._widths[key]) for key in episode.tactile}
        step = IMAGE_ROWS if episode.images else ROWS
        for first in range(0, len(episode.times), step):
            rows = slice(first, first + step)
            table: dict[str, Arrow] = {key: column[rows] for key, column in columns.items()}
            for key, window in windows.items():
                table[key] = episode.tactile[key].values[window[rows]]
            for key, images in episode.images.items():
                table[key] = images.column(episode.times[rows])
            if self._writer is None:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._writer = export.ParquetFile(self._path)
            self._writer.write({key: table[key] for key in self._features})

    def _end_file(self) -> None:
        if self._writer is not None:
            self._writer.close()
            self._writer, self._file = None, self._file + 1

    def close(self) -> None:
        """Write what describes all episodes."""
        self._end_file()
        pa, meta = export.arrow(), self._folder / 'meta'
        path = meta / PLACE.format('episodes', 0, 0)
        path.parent.mkdir(parents=True)
        pa.parquet.write_table(pa.Table.from_pylist(self._rows), path)
        tasks = pa.table({'task_index': [0], 'task': [self._task]})
        listed = (('task_index', 'int64', 'int64'), ('task', 'unicode', 'object'))
        index = {'columns': [
            {'name': n, 'field_name': n, 'pandas_type': p, 'numpy_type': t, 'metadata': None}
            for n, p, t in listed
        ], 'index_columns': ['task'], 'column_indexes': []}  # fmt: skip
        tasks = tasks.replace_schema_metadata({'pandas': json.dumps(index)})
        pa.parquet.write_table(tasks, meta / 'tasks.parquet')
        stats = {key: pooled([one[key] for one in self._stats]) for key in self._stats[0]}
        info = {
            'codebase_version': 'v3.0', 'robot_type': None, 'total_episodes': len(self._rows),
            'total_frames': self._frames, 'total_tasks': 1, 'chunks_size': FILES,
            'data_files_size_in_mb': 100, 'video_files_size_in_mb': 200, 'fps': self._fps,
            'splits': {'train': f'0:{len(self._rows)}'},
            'data_path': 'data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet',
            'video_path': None, 'features': self._features,
        }  # fmt: skip
        for name, content in (('info', info), ('stats', stats)):
            write_atomically(meta / f'{name}.json', json.dumps(content, indent=2).encode())


def write_dataset(
    paths: Sequence[Path], target: Path, fps: int, task: str, pipelines: Sequence[Pipeline]
) -> export.Export:
    """Write bags as the episodes of a data set into a new folder.

    Frames of all bags are held in memory in single precision, images on the disk. Raises
    TactileError if `target` is there already, cannot be written, or a bag has no frame, features
    that the first one has not, or stamps that make no sense.
    """
    export.arrow()
    done = export.Export()
    with temporary_folder(target) as fresh, tempfile.TemporaryFile() as file:
        bags = (HandBag(path, file) for path in paths)
        episodes = [Episode.read(bag, fps, pipelines, done) for bag in bags]
        widths: dict[str, int] = {}
        for one in episodes:
            widths.update({k: max(widths.get(k, 0), one.largest_window(k)) for k in one.tactile})
        dataset = DataSet(fresh, fps, task, widths)
        for one in episodes:
            dataset.add(one)
            listed = {**one.tactile, **one.hand, **{k: i.numbers for k, i in one.images.items()}}
            done.rows += [
                (one.path.name, key, len(found.stamp_ns), len(one.times), widths.get(key, 1))
                for key, found in listed.items()
            ]
        dataset.close()
    return done
