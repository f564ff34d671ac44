"""Sessions that extend a map: real ones and rendered ones that share a world, its frame and its ground truth.

Errors of several sessions together: all frames, with one similarity to the common truth for all of them. The frames of an
earlier session are in a file that was written before later ones changed the map; each is carried along by the change of
the keyframe nearest in time, between the map as it was when that file was written and the map at the end."""
import contextlib
import pathlib
import shutil
import sqlite3
import statistics

import numpy as np

from .trajectories import (angle_deg, apply_similarity, matrix_from_quaternion, mean_rotation, read_poses, read_positions,
                           similarity, write_poses)
from .work import DATA, Failed, Skipped, cairn, median_of_runs, rendered
from .worlds import path_length

KITCHEN = ['--camera', DATA / 'redkitchen' / 'camera.yaml']
WIDE, NARROW = [], ['--image-size', 1280, 800, '--focal', 1000]
# Visits to the rendered office: what differs but for the path, which differs by itself.
OFFICE = {1: WIDE, 2: [*WIDE, '--gamma', 1.6, '--light', 0.7], 3: [*NARROW, '--gamma', 1.3, '--light', 0.85],
          4: [*WIDE, '--gamma', 2.2, '--light', 0.5], 5: [*NARROW, '--light', 1.1], 6: [*WIDE, '--gamma', 1.2, '--light', 0.9]}
OVERLAP, OVERLAP_S = 0.3, 0.5  # sessions see the same if so much of the view is shared, for so long
FIRST_VISIT_S, RETURN_S = 9, 5  # lengths of the visits to places


def remove_map(map_file):
    for end in ('', '-wal', '-shm', '-lock'):
        pathlib.Path(f'{map_file}{end}').unlink(missing_ok=True)


def read(map_file, sql, *values):
    with contextlib.closing(sqlite3.connect(f'{pathlib.Path(map_file).resolve().as_uri()}?mode=ro', uri=True, timeout=10)) as database:
        return database.execute(sql, values).fetchall()


def keyframe_poses(map_file, session=None):
    """By id: time in seconds, map_from_camera."""
    poses = {}
    for id, of, time_ns, qx, qy, qz, qw, tx, ty, tz in read(map_file, (
            'SELECT id, session, time_ns, camera_from_map_qx, camera_from_map_qy, camera_from_map_qz, camera_from_map_qw, '
            'camera_from_map_tx, camera_from_map_ty, camera_from_map_tz FROM keyframes')):
        if session in (None, of):
            pose = np.eye(4)
            pose[:3, :3] = matrix_from_quaternion(qx, qy, qz, qw).T
            pose[:3, 3] = -pose[:3, :3] @ np.array([tx, ty, tz])
            poses[id] = (time_ns * 1e-9, pose)
    return poses


def world_positions(map_file, session):
    """Of the session's keyframes, by id, once the map is aligned."""
    return {id: np.array(position) for id, *position in read(
        map_file, 'SELECT keyframe, world_x_m, world_y_m, world_z_m FROM keyframe_positions WHERE session = ?', session)}


def carried(frames, before, after):
    """Times and positions of a session's frames in the map `after`: a file in the map `before` and both maps' keyframes."""
    common = sorted(before.keys() & after.keys(), key=lambda id: before[id][0])
    if not common:
        raise Failed(f'none of the keyframes of {frames} is left')
    times = np.array([before[id][0] for id in common])
    rows = []
    for time, pose in read_poses(frames):
        id = common[int(np.abs(times - time).argmin())]
        moved = after[id][1] @ np.linalg.inv(before[id][1]) @ pose
        rows.append([time, *moved[:3, 3]])
    return np.array(rows)


def associated(positions, truth, max_dt):
    """Pairs of estimated and true positions."""
    true = read_positions(truth) if not isinstance(truth, np.ndarray) else truth
    at = np.searchsorted(true[:, 0], positions[:, 0]).clip(1, len(true) - 1)
    at -= positions[:, 0] - true[at - 1, 0] < true[at, 0] - positions[:, 0]
    near = np.abs(true[at, 0] - positions[:, 0]) <= max_dt
    return positions[near, 1:], true[at[near], 1:]


def error_together(parts, max_dt=0.005):
    """RMSE of all (positions, truth) after one similarity for all of them; m."""
    pairs = [associated(positions, truth, max_dt) for positions, truth in parts]
    estimated, true = (np.concatenate(column) for column in zip(*pairs))
    moved = apply_similarity(similarity(true, estimated), estimated)
    return float(np.sqrt(((moved - true) ** 2).sum(axis=1).mean()))


def overlap_begins(folder, share=OVERLAP):
    """Seconds after the first image from which on the session sees what the other has seen: `share` of the view, for
    OVERLAP_S."""
    rows = np.array([[float(x) for x in line.split()] for line in open(folder / 'overlap.txt') if not line.startswith('#')])
    times, enough = rows[:, 0] - rows[0, 0], rows[:, 1] >= share
    for time in times:
        if enough[(times >= time) & (times < time + OVERLAP_S)].all():
            return float(time)
    raise Failed(f'{folder}: the sessions never see the same')


class Sessions:
    def visit(self, kind, seed, session, *more):
        """A rendered session of a world that others visit, too; kept in --worlds and used again."""
        name = f'{kind}_{seed}_{session}'
        return rendered(self.worlds / name, kind, '--seed', seed, '--session', session, *more)

    def mapped(self, folder, map_file, frames, *arguments):
        return cairn('run', folder, *self.mode, *arguments, '--map', map_file, '--trajectory', frames, '--overwrite')

    def extended(self, folder, map_file, frames, *arguments):
        """The report of a session that extends the map."""
        pathlib.Path(frames).unlink(missing_ok=True)
        return cairn('run', folder, *self.mode, *arguments, '--map', map_file, '--extend', '--trajectory', frames)

    def kitchen_extended(self, order):
        """redkitchen as two sessions: 'on': t < 15 s, then t >= 12 s; 'back': t >= 20 s, then t < 20 s."""
        first, second = {'on': (['--until', 15], ['--from', 12]), 'back': (['--from', 20], ['--until', 20])}[order]

        if not DATA.is_dir():
            raise Skipped(f'no sequences at {DATA}')

        def one(run):
            file, frames = self.path(f'kitchen_{order}_{run}.cairn'), [self.path(f'kitchen_{order}_{run}_{k}.txt') for k in (1, 2)]
            self.mapped(DATA / 'redkitchen', file, frames[0], *KITCHEN, *first)
            before = keyframe_poses(file)
            report = self.extended(DATA / 'redkitchen', file, frames[1], *KITCHEN, *second)
            truth = DATA / 'redkitchen' / 'reference_sfm.txt'
            ate = error_together([(carried(frames[0], before, keyframe_poses(file)), truth),
                                  (read_positions(frames[1]), truth)])
            located = report['located_after_s']
            print(f'        kitchen {order}: located after {located} s, joined {report["joined"]}, ATE {ate:.4f} m', flush=True)
            return {'located_s': np.inf if located is None else located, 'ate': ate,
                    'found': float(located is not None or len(report['joined']) > 0)}
        return self.once(f'kitchen {order}', lambda: median_of_runs(self.runs, one))

    def rooms(self):
        """Session 2 begins in another room and walks into the one that session 1 has mapped."""
        def one(seed):
            visits = [self.visit('rooms', seed, 1, '--rate', 15), self.visit('rooms', seed, 2, '--rate', 15, '--overlap-with', 1)]
            file, frames = self.path(f'rooms_{seed}.cairn'), [self.path(f'rooms_{seed}_{k}.txt') for k in (1, 2)]
            self.mapped(visits[0], file, frames[0])
            before, killed = keyframe_poses(file), self.path(f'rooms_{seed}_killed.cairn')
            shutil.copy(file, killed)
            kept = self.killed_in_the_other_room(visits[1], killed)
            report = self.extended(visits[1], file, frames[1])
            truths = [self.truth(visit) for visit in visits]
            ate = error_together([(carried(frames[0], before, keyframe_poses(file)), truths[0]),
                                  (read_positions(frames[1]), truths[1])])
            begins = overlap_begins(visits[1])
            joined = [j['at_s'] for j in report['joined']]
            located = report['located_after_s']
            # Of its own: begun by it, and not taken for a part of the other before they share anything in view.
            own = len(report['components']) > 1 and (located is None or located >= overlap_begins(visits[1], 0.001))
            result = {'own': bool(own), 'kept': kept, 'located_s': located,
                      'late_s': joined[0] - begins if joined else np.inf, 'overlap_s': begins,
                      'share': ate / sum(map(path_length, truths))}
            print(f'        rooms {seed}: {result}', flush=True)
            return result

        def all_seeds():
            results = [one(seed) for seed in range(1, self.seeds + 1)]
            return {'own': statistics.mean(r['own'] for r in results), 'kept': statistics.mean(r['kept'] for r in results),
                    'joined': statistics.mean(r['late_s'] <= 1.0 for r in results),
                    'late_s': max(r['late_s'] for r in results), 'share': max(r['share'] for r in results)}
        return self.once('rooms', all_seeds)

    def office_visits(self, run, align=False, visits=(1, 2, 3, 4, 5)):
        """The office's visits into one map: its file, and of each its folder, frames, report and the keyframes after it."""
        name = f'visits_{"aligned_" if align else ""}{run}'
        file, done = self.path(f'{name}.cairn'), []
        for k in visits:
            folder, frames = self.visit('office', 1, k, *OFFICE[k]), self.path(f'{name}_{k}.txt')
            report = (self.mapped if not done else self.extended)(folder, file, frames)
            if align and not done:
                cairn('align', file, '--groundtruth', self.truth(folder))
            done.append({'folder': folder, 'frames': frames, 'report': report, 'keyframes': keyframe_poses(file),
                         'world': world_positions(file, 1) if align else None})
        return file, done

    def office(self):
        """Five visits, each in the map of all and alone."""
        def one(run):
            file, visits = self.office_visits(run)
            final, ratios, parts = keyframe_poses(file), [], []
            for k, visit in enumerate(visits, 1):
                alone, truth = self.path(f'alone_{run}_{k}.txt'), self.truth(visit['folder'])
                self.mapped(visit['folder'], self.path(f'alone_{run}_{k}.cairn'), alone)
                parts.append((carried(visit['frames'], visit['keyframes'], final), truth))
                ratios.append(error_together(parts[-1:]) / error_together([(read_positions(alone), truth)]))
            joined = sum(visit['report']['component'] == 1 for visit in visits[1:])
            grown = cairn('info', file)['keyframes'] / visits[0]['report']['keyframes']
            result = {'joined': joined, 'grown': grown, 'worst': max(ratios), 'together': error_together(parts)}
            print(f'        office: {result}, each against alone {[round(r, 2) for r in ratios]}', flush=True)
            return result
        return self.once('office', lambda: median_of_runs(self.runs, one))

    def aligned(self):
        """An aligned map that five visits extend: how far the first session's keyframes move in the world."""
        def one(run):
            _, visits = self.office_visits(run, align=True, visits=(1, 2, 3, 4, 5, 6))
            first, last = visits[0]['world'], visits[-1]['world']
            moved = [float(np.linalg.norm(last[id] - first[id])) for id in first.keys() & last.keys()]
            print(f'        aligned: {len(moved)} of {len(first)} keyframes left, moved by {max(moved):.4f} m at most', flush=True)
            return {'median': statistics.median(moved), 'most': max(moved)}
        return self.once('aligned', lambda: median_of_runs(self.runs, one))

    def places(self, kind):
        """Places that have nothing in common ('office': three) or look alike ('alike': two) in one file, and a return to
        one of them."""
        count = {'office': 3, 'alike': 2}[kind]

        def one(seed):
            file = self.path(f'places_{kind}_{seed}.cairn')

            def visit(place, session, duration_s):
                more = ['--catalogue', seed] if kind == 'alike' else []
                return self.visit(kind, 100 * seed + place, session, '--duration', duration_s, *more)
            reports = []
            for place in range(1, count + 1):
                run = self.mapped if place == 1 else self.extended
                reports.append(run(visit(place, 1, FIRST_VISIT_S), file, self.path(f'places_{kind}_{seed}_{place}.txt')))
            apart = len([c for c in cairn('info', file)['components'] if c['joined_into'] is None])
            false = sum(report['located_after_s'] is not None or len(report['joined']) for report in reports[1:])
            place = 1 + seed % count
            back = self.extended(visit(place, 2, RETURN_S), file, self.path(f'places_{kind}_{seed}_back.txt'))
            right = 1 if place == 1 else reports[place - 1]['component']
            result = {'components': apart, 'false': false + (back['component'] not in (right, None)),
                      'returned': back['component'] == right, 'located_s': back['located_after_s']}
            print(f'        {kind} {seed}: {result}', flush=True)
            return result

        def all_seeds():
            results = [one(seed) for seed in range(1, self.seeds + 1)]
            return {'apart': statistics.mean(r['components'] == count for r in results),
                    'false': sum(r['false'] for r in results), 'returned': statistics.mean(r['returned'] for r in results)}
        return self.once(f'places {kind}', all_seeds)

    def turning(self):
        """A recording that turns within 0.15 m, aligned to positions with 1 cm of noise (and exact orientations)."""
        def one(seed):
            folder, file, frames = self.world('turning', seed), self.path(f'turning_{seed}.cairn'), self.path(f'turning_{seed}.txt')
            self.mapped(folder, file, frames)
            truth, noise = read_poses(self.truth(folder)), np.random.default_rng(seed)
            noisy = self.path(f'turning_{seed}_reference.txt')
            moved = [(time, np.array(pose)) for time, pose in truth]
            for _, pose in moved:
                pose[:3, 3] += noise.normal(0, 0.01, 3)
            write_poses(noisy, moved)
            cairn('align', file, '--groundtruth', noisy)
            x, y, z, w = world_rotation(cairn('info', file))
            true = {round(time, 4): pose for time, pose in truth}
            right = mean_rotation([true[round(time, 4)][:3, :3] @ pose[:3, :3].T for time, pose in read_poses(frames)])
            wrong = angle_deg(matrix_from_quaternion(x, y, z, w) @ right.T)
            print(f'        turning {seed}: turned by {wrong:.3f} deg', flush=True)
            return wrong
        return self.once('turning', lambda: {'worst': max(one(seed) for seed in range(1, self.seeds + 1))})


def world_rotation(info):
    """Quaternion x, y, z, w of the alignment of component 1."""
    for component in info.get('components', []):
        world = component.get('world_from_component') or component.get('world_from_map')
        if component['id'] == 1 and world:
            return world['quaternion_xyzw']
    return info['world_from_map']['quaternion_xyzw']
