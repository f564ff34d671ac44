"""Following a camera in a map that is not touched: the real kitchen, whole and with black images, and rendered worlds."""
import statistics

import numpy as np
from PIL import Image

from .trajectories import angle_deg, matrix_from_quaternion, read_poses, read_times
from .work import DATA, cairn, median_of_runs, rendered

FROM_S = 20.0
BLACK_EVERY, BLACK = 20, 3
KITCHEN = ['--camera', DATA / 'redkitchen' / 'camera.yaml']
REFERENCE = DATA / 'redkitchen' / 'reference_sfm.txt'
SEMI_DIRECT, FEATURES = ['--mode', 'semi_direct'], ['--mode', 'features']


def read_states(path):
    """By time in ms: state, position sigma, rotation sigma in degrees (None without a pose)."""
    states = {}
    for line in open(path):
        if not line.startswith('#'):
            time, state, position, rotation, *_ = line.split(' ', 4)
            sigmas = (None, None) if state == 'lost' else (float(position), float(rotation))
            states[round(1000 * float(time))] = (state, *sigmas)
    return states


def errors(estimate, reference, states, max_dt=0.005):
    """Per pose with a reference: state, position error, angle in degrees, and both squared over their variance."""
    true = read_poses(reference)
    times = np.array([time for time, _ in true])
    rows = []
    for time, pose in read_poses(estimate):
        at = int(np.abs(times - time).argmin())
        if abs(times[at] - time) > max_dt:
            continue
        state, sigma, sigma_deg = states[round(1000 * time)]
        apart = float(np.linalg.norm(pose[:3, 3] - true[at][1][:3, 3]))
        turned = angle_deg(pose[:3, :3].T @ true[at][1][:3, :3])
        rows.append((state, apart, turned, (apart / sigma) ** 2, (turned / sigma_deg) ** 2))
    return rows


def blinded(folder):
    """The query images of redkitchen, of which three are black every so often. The times of those and of the others."""
    source = DATA / 'redkitchen'
    (folder / 'rgb').mkdir(parents=True)
    lines, black, seen = [], [], []
    for line in open(source / 'rgb.txt'):
        if line.startswith('#') or not line.strip() or float(line.split()[0]) < FROM_S:
            continue
        time, name = line.split()
        target = folder / name
        count = len(black) + len(seen)
        if count % BLACK_EVERY >= BLACK_EVERY - BLACK:
            black.append(float(time))
            Image.fromarray(np.zeros_like(np.array(Image.open(source / name)))).save(target, format='PNG')
        else:
            seen.append(float(time))
            target.symlink_to((source / name).resolve())
        lines.append(line)
    (folder / 'rgb.txt').write_text(''.join(lines))
    return black, seen


class Tracking:
    def kitchen_map(self, run):
        """Of redkitchen's first 20 s, aligned to the reference."""
        def one():
            map_file = self.path(f'track20_{run}.cairn')
            cairn('run', DATA / 'redkitchen', *KITCHEN, *self.mode, '--until', FROM_S, '--map', map_file, '--overwrite')
            cairn('align', map_file, '--groundtruth', REFERENCE, '--max-dt', 0.005)
            return map_file
        return self.once(f'kitchen map {run}', one)

    def track(self, name, folder, map_file, reference, *arguments, max_dt=0.005):
        """The answer of a run, with the errors of its poses as the map places them."""
        poses, states = self.path(f'{name}.txt'), self.path(f'{name}_states.txt')
        before = cairn('info', map_file, '--digest')['digest']
        answer = cairn('track', folder, *arguments, '--map', map_file, '--out', poses, '--states', states, '--overwrite',
                       expect=(0, 4))
        rows = errors(poses, reference, read_states(states), max_dt)
        answer['same'] = before == cairn('info', map_file, '--digest')['digest']
        answer['ate'] = cairn('eval', 'ate', poses, reference, '--max-dt', max_dt)['ate_m']
        answer['median'] = statistics.median(row[1] for row in rows)
        answer['wrong'] = sum(row[1] > 0.2 or row[2] > 10 for row in rows)
        # Of three degrees of freedom each.
        answer['nees'] = statistics.mean(row[3] for row in rows) / 3
        answer['nees_rotation'] = statistics.mean(row[4] for row in rows) / 3
        return answer, rows

    def kitchen_tracked(self, *mode):
        name = '_'.join(['tracked', *(word.strip('-') for word in mode)])

        def one(run):
            answer, _ = self.track(f'{name}_{run}', DATA / 'redkitchen', self.kitchen_map(run), REFERENCE, *KITCHEN, '--from',
                                   FROM_S, *mode)
            return {'posed': answer['with_pose_share'], 'p50_ms': answer['track_ms']['median'],
                    'p99_ms': answer['track_ms']['p99'], 'cpu': answer['cpu_s_per_s'],
                    **{key: float(answer[key]) for key in ('ate', 'median', 'wrong', 'same', 'nees', 'nees_rotation')}}
        return self.once(name, lambda: median_of_runs(self.runs, one))

    def kitchen_blinded(self, *mode):
        """Three black images every twenty."""
        name = '_'.join(['blinded', *(word.strip('-') for word in mode)])

        def images():
            folder = self.path('blinded')
            return folder, blinded(folder)

        def one(run):
            folder, (black, seen) = self.once('blinded images', images)
            answer, rows = self.track(f'{name}_{run}', folder, self.kitchen_map(run), REFERENCE, *KITCHEN, *mode)
            states = read_states(self.path(f'{name}_{run}_states.txt'))
            near = np.array(read_times(DATA / 'redkitchen' / 'covered_map_t20.txt'))
            covered = [abs(near - time).min() < 0.005 for time in seen]
            posed = [states.get(round(1000 * time), ('lost',))[0] != 'lost' for time in seen]
            first = [any(b < time for b in black) and (i == 0 or any(seen[i - 1] < b < time for b in black))
                     for i, time in enumerate(seen)]

            def share(chosen):
                return statistics.mean(p for p, c in zip(posed, chosen) if c)
            carried = [row for row in rows if row[0] == 'carried']
            return {'first_covered': share([f and c for f, c in zip(first, covered)]),
                    'first_others': share([f and not c for f, c in zip(first, covered)]),
                    'covered': share(covered), 'others': share([not c for c in covered]), 'wrong': float(answer['wrong']),
                    'carried_off': float(sum(row[1] > 0.05 or row[2] > 3 for row in carried))}
        return self.once(name, lambda: median_of_runs(self.runs, one))

    def office_tracked(self):
        """A second visit to a rendered room, and one with another camera, in the map of the first, over --seeds."""
        def one(seed):
            results = []
            first = rendered(self.worlds / f'office_{seed}', 'office', '--seed', seed)
            map_file = self.path(f'track_office_{seed}.cairn')
            cairn('run', first, *self.mode, '--map', map_file, '--overwrite')
            cairn('align', map_file, '--groundtruth', first / 'groundtruth_cam0.txt')
            for session, more in ((2, []), (3, ['--image-size', 960, 600, '--focal', 700])):
                visit = rendered(self.worlds / f'track_office_{seed}_{session}', 'office', '--seed', seed, '--session', session,
                                 '--duration', 12, *more)
                truth = visit / 'groundtruth_cam0.txt'
                answer, _ = self.track(f'office_{seed}_{session}', visit, map_file, truth)
                print(f'        office {seed}, visit {session}: {100 * answer["with_pose_share"]:.1f} % with a pose, '
                      f'{answer["carried"]} carried, median error {answer["median"]:.4f} m, normalized errors '
                      f'{answer["nees"]:.2f}, {answer["nees_rotation"]:.2f}', flush=True)
                results.append(answer)
            return results

        def all_seeds():
            results = [result for seed in range(1, self.seeds + 1) for result in one(seed)]
            return {'posed': min(r['with_pose_share'] for r in results), 'median': max(r['median'] for r in results),
                    'wrong': sum(r['wrong'] for r in results), 'nees': statistics.mean(r['nees'] for r in results),
                    'nees_rotation': statistics.mean(r['nees_rotation'] for r in results)}
        return self.once('office tracked', all_seeds)
