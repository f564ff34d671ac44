"""Following a camera where it is hardest: out of the mapped area and back, in a map that grows, in a large one, on a medium that
cannot be written, and with images of other sizes."""
import os
import shutil
import statistics
import subprocess
import tempfile
import time

import numpy as np
from PIL import Image

from .tracking import FROM_S, KITCHEN, REFERENCE, errors, read_states
from .trajectories import read_poses
from .work import DATA, Failed, Skipped, cairn, rendered, start

MAPPED_S = 5.0
LARGE, HUGE = 1000, 10000  # keyframes
GROWING_S = 12.0  # of redkitchen, while the rest of it is added


def longest_run(states, name):
    """Of a list of states: first and last of the longest run of one."""
    best, begin = None, None
    for i, state in enumerate([*states, None]):
        if state == name and begin is None:
            begin = i
        elif state != name and begin is not None:
            best = max(best or (0, -1), (begin, i - 1), key=lambda run: run[1] - run[0])
            begin = None
    return best


def resized(folder, width):
    """The query images of redkitchen at another width, and their camera."""
    source = DATA / 'redkitchen'
    (folder / 'rgb').mkdir(parents=True)
    lines = []
    for line in open(source / 'rgb.txt'):
        if line.startswith('#') or not line.strip() or float(line.split()[0]) < FROM_S:
            continue
        name = line.split()[1]
        image = Image.open(source / name).convert('L')
        image.resize((width, width * 3 // 4), Image.BICUBIC if width > 640 else Image.BOX).save(folder / name, quality=98)
        lines.append(line)
    (folder / 'rgb.txt').write_text(''.join(lines))
    # Pixel centres are at integer coordinates.
    zoom = width / 640
    focal, centre = 525 * zoom, [(c + 0.5) * zoom - 0.5 for c in (320, 240)]
    (folder / 'camera.yaml').write_text(f'model: pinhole\nresolution_px: [{width}, {width * 3 // 4}]\n'
                                        f'intrinsics_px: [{focal}, {focal}, {centre[0]}, {centre[1]}]\ndistortion: []\nrate_hz: 30\n')
    return folder


def broken_stream(folder, kind):
    """The query images of redkitchen as a camera gives them that stops its clock: after every 36 images it repeats the last one for
    a second while the world goes on ('frozen'), jumps a second on ('missing') or 34 images back ('jumping'), and stamps all 1/30 s
    apart. The folder, and its reference."""
    source = DATA / 'redkitchen'
    (folder / 'rgb').mkdir(parents=True)
    truth = {round(1000 * time): pose for time, pose in read_poses_as_text(REFERENCE)}
    names = [line.split() for line in open(source / 'rgb.txt') if not line.startswith('#') and float(line.split()[0]) >= FROM_S]
    shown, at, since = [], 0, 0
    while at < len(names) and len(shown) < len(names):
        shown.append(names[at])
        at, since = at + 1, since + 1
        if since == 36:
            since = 0
            if kind == 'frozen':
                shown += [shown[-1]] * 30
            at += {'frozen': 30, 'missing': 30, 'jumping': -34}[kind]
    images, reference = [], []
    for i, (time, name) in enumerate(shown):
        stamp = 1.0 + i / 30
        (folder / 'rgb' / f'{stamp:.6f}.jpg').symlink_to((source / name).resolve())
        images.append(f'{stamp:.6f} rgb/{stamp:.6f}.jpg\n')
        pose = truth.get(round(1000 * float(time)))
        if pose:
            reference.append(f'{stamp:.6f} {pose}\n')
    (folder / 'rgb.txt').write_text(''.join(images))
    (folder / 'reference.txt').write_text(''.join(reference))
    return folder, folder / 'reference.txt'


def read_poses_as_text(path):
    for line in open(path):
        if not line.startswith('#') and line.strip():
            time, pose = line.strip().split(maxsplit=1)
            yield float(time), pose


class TrackingEdges:
    def broken(self, kind, *mode):
        def one():
            folder, reference = self.once(f'{kind} stream', lambda: broken_stream(self.path(f'{kind}_stream'), kind))
            name = '_'.join([kind, *(word.strip('-') for word in mode)])
            answer, rows = self.track(name, folder, self.kitchen_map(0), reference, *KITCHEN, *mode, '--deterministic')
            return {'wrong': answer['wrong'] / len(rows), 'unsure': sum(row[3] > 25 for row in rows) / len(rows)}
        return self.once(' '.join([kind, *mode]), one)

    def leaving(self):
        """A rendered room of which the first third of a round is mapped, and one and a half rounds are followed."""
        def one(seed):
            visit = rendered(self.worlds / f'leaving_{seed}', 'office', '--seed', seed, '--laps', 1.5, '--image-size', 480, 360,
                             '--focal', 315)
            truth = visit / 'groundtruth_cam0.txt'
            map_file = self.path(f'leaving_{seed}.cairn')
            cairn('run', visit, *self.mode, '--until', MAPPED_S, '--map', map_file, '--overwrite')
            cairn('align', map_file, '--groundtruth', truth)
            answer, rows = self.track(f'leaving_{seed}', visit, map_file, truth)
            estimate, true = read_poses(self.path(f'leaving_{seed}.txt')), read_poses(truth)
            times = np.array([time for time, _ in true])
            places = np.array([true[int(np.abs(times - time).argmin())][1][:3, 3] for time, _ in estimate])
            off = np.array([pose[:3, 3] for _, pose in estimate]) - places
            away = longest_run([row[0] for row in rows], 'carried')
            if not away or away[1] + 1 >= len(estimate):
                raise Failed(f'seed {seed}: never carried, or never back')
            first, last = away
            seconds = estimate[last][0] - estimate[first][0]
            way = float(np.linalg.norm(np.diff(places[first:last + 1], axis=0), axis=1).sum())
            steps = np.linalg.norm(np.diff(off, axis=0), axis=1)
            result = {'seconds': seconds, 'jump': float(steps[last:last + 20].max()),
                      'share': float(np.linalg.norm(off[last])) / way, 'posed': answer['with_pose_share'],
                      'nees': statistics.mean(row[3] for row in rows[first:last + 1]) / 3}
            print(f'        seed {seed}: carried for {seconds:.1f} s and {way:.1f} m, {100 * result["share"]:.2f} % off at the end, '
                  f'greatest step at the return {result["jump"]:.4f} m, normalized error {result["nees"]:.2f}', flush=True)
            return result

        def all_seeds():
            results = [one(seed) for seed in range(1, self.seeds + 1)]
            return {'seconds': min(r['seconds'] for r in results), 'jump': max(r['jump'] for r in results),
                    'share': max(r['share'] for r in results), 'median_share': statistics.median(r['share'] for r in results),
                    'posed': min(r['posed'] for r in results), 'nees': statistics.mean(r['nees'] for r in results)}
        return self.once('leaving', all_seeds)

    def large_map(self):
        """The kitchen's map among copies of it that look otherwise: about a thousand keyframes."""
        large = self.path('large.cairn')
        if not large.exists():
            cairn('synth', 'map', '--like', self.kitchen_map(0), '--keyframes', LARGE, '--out', large)
        return large

    def large(self):
        """Memory of `cairn track` as a whole, in a large map and in a small one."""
        def one():
            large, small = self.large_map(), self.kitchen_map(0)
            answer, _ = self.track('large', DATA / 'redkitchen', large, REFERENCE, *KITCHEN, '--from', FROM_S)
            alone, _ = self.track('small', DATA / 'redkitchen', small, REFERENCE, *KITCHEN, '--from', FROM_S)
            return {'peak_mb': answer['peak_mb'], 'small_mb': alone['peak_mb'], 'posed': answer['with_pose_share'],
                    'keyframes': cairn('info', large)['keyframes'], 'same': float(answer['same'])}
        return self.once('large map', one)

    def huge(self):
        """One photo in a map of so many keyframes, by a process that does nothing else."""
        def one():
            small, huge = self.kitchen_map(0), self.path('huge.cairn')
            if not huge.exists():
                cairn('synth', 'map', '--like', small, '--keyframes', HUGE, '--out', huge)
            photo = min((DATA / 'redkitchen' / 'rgb').iterdir(), key=lambda path: abs(float(path.stem) - 25))
            times, answer = [], None
            for _ in range(3):
                start_s = time.monotonic()
                answer = cairn('localize', photo, *KITCHEN, '--map', huge, expect=(0, 4))
                times.append(time.monotonic() - start_s)
            return {'open_s': min(times), 'peak_mb': answer['peak_mb'], 'located': float(answer['exit'] == 0)}
        return self.once('huge map', one)

    def growing(self):
        """As a live camera, while a session adds the rest of the sequence in another process, live as well."""
        def one():
            map_file = self.path('growing.cairn')
            cairn('run', DATA / 'redkitchen', *KITCHEN, *self.mode, '--until', GROWING_S, '--map', map_file, '--overwrite')
            before = cairn('info', map_file)['revision']
            session = start('run', DATA / 'redkitchen', *KITCHEN, '--from', GROWING_S, '--realtime', '--map', map_file, '--extend')
            states = self.path('growing_states.txt')
            try:
                cairn('track', DATA / 'redkitchen', *KITCHEN, '--from', GROWING_S, '--realtime', '--map', map_file, '--states', states,
                      '--overwrite')
            finally:
                session.wait()
            rows = [line.split(' ', 8) for line in open(states) if not line.startswith('#')]
            found = next(i for i, row in enumerate(rows) if row[1] != 'lost')
            calls = [float(row[7]) for row in rows[found + 1:]]
            revisions = [int(row[6]) for row in rows]
            refreshed = [float(b[7]) for a, b in zip(rows, rows[1:]) if a[6] != b[6]]
            return {'revisions': float(revisions[-1] - before), 'max_ms': max(calls),
                    'refreshed_ms': max(refreshed, default=float('nan')), 'posed': sum(row[1] != 'lost' for row in rows) / len(rows)}
        return self.once('growing', one)

    def read_only(self):
        """On a medium that is mounted read-only."""
        def one():
            source = self.kitchen_map(0)
            folder = tempfile.mkdtemp(prefix='cairn-read-only-')
            shutil.copy(source, folder)
            for command in (['mount', '--bind', folder, folder], ['mount', '-o', 'remount,ro,bind', folder]):
                done = subprocess.run(command, capture_output=True, text=True)
                if done.returncode != 0:
                    subprocess.run(['umount', folder], capture_output=True)
                    shutil.rmtree(folder, ignore_errors=True)
                    raise Skipped(f'no read-only mount: {done.stderr.strip()}')
            try:
                map_file = os.path.join(folder, os.path.basename(source))
                if os.access(folder, os.W_OK):
                    raise Failed(f'{folder} can be written')
                answer, _ = self.track('read_only', DATA / 'redkitchen', map_file, REFERENCE, *KITCHEN, '--from', FROM_S)
                return {'posed': answer['with_pose_share'], 'same': float(answer['same']), 'files': float(len(os.listdir(folder)))}
            finally:
                subprocess.run(['umount', folder], check=True)
                shutil.rmtree(folder)
        return self.once('read-only', one)

    def sized(self, width):
        def one():
            folder = self.path(f'width_{width}')
            if not folder.exists():
                resized(folder, width)
            result = {}
            for name, sequence, camera in (('here', folder, folder / 'camera.yaml'), ('full', DATA / 'redkitchen', KITCHEN[1])):
                poses, states = self.path(f'width_{width}_{name}.txt'), self.path(f'width_{width}_{name}_states.txt')
                answer = cairn('track', sequence, '--camera', camera, '--map', self.kitchen_map(0), '--out', poses, '--states', states,
                               '--overwrite', '--from', 0 if name == 'here' else FROM_S)
                rows = errors(poses, REFERENCE, read_states(states))
                result[name] = answer['with_pose_share'] if rows else 0.0
                result[f'{name}_median'] = statistics.median(row[1] for row in rows)
            return {**result, 'behind': result['full'] - result['here']}
        return self.once(f'width {width}', one)
