"""Rendered worlds with exact ground truth, over --seeds: odometry, photometric calibration, loops, growth."""
import statistics

import numpy as np

from .sequences import loop_times
from .trajectories import distance_between, read_positions, scale_drift
from .work import cairn


# What `cairn synth` is asked for, by the name of the folder.
KINDS = {
    'office': ['office'],
    'plain': ['plain'],  # 30 % of its walls are blank
    'corridor': ['corridor'],
    'aliasing': ['aliasing'],
    'photometric': ['office', '--format', 'tum_mono', '--effects', 'response', 'vignette', 'exposure', 'noise'],
    'laps': ['office', '--laps', '10'],
}


def path_length(truth):
    return float(np.linalg.norm(np.diff(read_positions(truth)[:, 1:], axis=0), axis=1).sum())


class Worlds:
    def world(self, kind, seed):
        """A rendered recording; kept in --worlds and used again."""
        folder = self.worlds / f'{kind}_{seed}'
        if not folder.exists():
            partial = self.worlds / f'{kind}_{seed}.partial'
            cairn('synth', *KINDS[kind], '--seed', seed, '--out', partial, '--overwrite')
            partial.rename(folder)
        return folder

    @staticmethod
    def truth(folder):
        return next(path for path in (folder / 'groundtruth_cam0.txt', folder / 'groundtruth.txt') if path.exists())

    def odometry(self, kind):
        """The odometry alone, per seed: share of frames tracked, error as a share of the path."""
        def one(seed):
            folder, frames = self.world(kind, seed), self.path(f'odometry_{kind}_{seed}.txt')
            report = cairn('run', folder, '--odometry-only', *self.mode, '--trajectory', frames, '--overwrite')
            ate = cairn('eval', 'ate', frames, self.truth(folder))['ate_m']
            result = {'tracked': report['tracked_share'], 'share': ate / path_length(self.truth(folder))}
            print(f'        {kind} {seed}: {100 * result["tracked"]:.1f} % tracked, ATE {100 * result["share"]:.2f} % '
                  'of the path', flush=True)
            return result

        def all_seeds():
            results = [one(seed) for seed in range(1, self.seeds + 1)]
            return {'tracked': min(r['tracked'] for r in results), 'worst': max(r['share'] for r in results),
                    'median': statistics.median(r['share'] for r in results),
                    'met': sum(r['tracked'] >= 0.95 and r['share'] <= 0.01 for r in results) / len(results)}
        return self.once(f'odometry {kind}', all_seeds)

    def laps(self):
        """Ten rounds through a room against the first: what the map has, and its error."""
        def mapped(name, *until):
            folder, frames = self.world('laps', 1), self.path(f'laps_{name}.txt')
            report = cairn('run', folder, *self.mode, *until, '--map', self.path(f'laps_{name}.cairn'), '--trajectory',
                           frames, '--overwrite')
            return {'keyframes': report['keyframes'], 'points': report['points'],
                    'ate': cairn('eval', 'ate', frames, self.truth(folder))['ate_m']}

        def one():
            times = read_positions(self.truth(self.world('laps', 1)))[:, 0]
            first, tenth = mapped('first', '--until', (times[-1] - times[0]) / 10), mapped('all')
            print(f'        first lap: {first}, ten: {tenth}', flush=True)
            return {key: tenth[key] / first[key] for key in first}
        return self.once('laps', one)

    def photometric(self):
        """Synthetic offices seen by a camera with strong response, vignette and exposure changes: the odometry alone
        with the true calibration, with none, and with the one that Cairn estimates without exposure times."""
        def one_seed(seed):
            world = self.world('photometric', seed)
            bare, estimated = (self.path(f'photometric_{seed}_{name}') for name in ('bare', 'estimated'))
            bare.mkdir(exist_ok=True)
            for name in ('images', 'camera.txt'):
                if not (bare / name).exists():
                    (bare / name).symlink_to((world / name).resolve())
            lines = [line.split()[:2] for line in open(world / 'times.txt')]
            (bare / 'times.txt').write_text(''.join(f'{" ".join(fields)}\n' for fields in lines))
            cairn('camera', 'calibrate-photometric', bare, '--out', estimated, '--overwrite')

            def ate(name, sequence, *arguments):
                poses = self.path(f'photometric_{seed}_{name}.txt')
                report = cairn('run', sequence, *arguments, '--odometry-only', '--deterministic', '--trajectory', poses,
                               '--overwrite')
                answer = cairn('eval', 'ate', poses, world / 'groundtruth.txt')
                return answer['ate_m'], report['tracked_share']

            calibrated, _ = ate('calibrated', world)
            raw, tracked = ate('raw', bare)
            own, _ = ate('own', bare, '--photometric', estimated)
            result = {'calibrated': calibrated, 'raw': raw, 'own': own, 'tracked': tracked}
            print(f'        photometric {seed}: {result}', flush=True)
            return result

        def one():
            seeds = [one_seed(seed) for seed in range(1, self.seeds + 1)]
            median = {key: statistics.median(s[key] for s in seeds) for key in seeds[0]}
            return {**median, 'tracked': min(s['tracked'] for s in seeds), 'gain': median['raw'] / median['calibrated'],
                    'own_gain': median['raw'] / median['own']}
        return self.once('photometric', one)

    def loops(self, preset):
        """Maps a corridor per seed, with and without loop closing."""
        def one(seed):
            folder = self.world(preset, seed)
            truth, result = folder / 'groundtruth_cam0.txt', {}
            for name, extra in (('after', []), ('before', ['--vo'])):
                frames = self.path(f'{preset}_{seed}_{name}.txt')
                report = cairn('run', folder, *self.mode, '--map', self.path(f'{preset}_{seed}_{name}.cairn'),
                               '--trajectory', frames, '--overwrite', *extra)
                result[name] = cairn('eval', 'ate', frames, truth)['ate_m']
                if name == 'after':
                    result['tracked'] = report['tracked_share']
                    result['drift'] = scale_drift(frames, truth)
                    result['loops'], result['false'] = 0, 0
                    for loop in loop_times(self.path(f'{preset}_{seed}_{name}.cairn')):
                        apart = distance_between(truth, *loop)
                        result['loops' if apart < 5.0 else 'false'] += 1
            print(f'        {preset} {seed}: {result}', flush=True)
            return result

        def all_seeds():
            results = [one(seed) for seed in range(1, self.seeds + 1)]
            return {'closed': statistics.mean(r['loops'] > 0 for r in results),
                    'without_false': statistics.mean(r['false'] == 0 for r in results),
                    'ratio': max(r['after'] / r['before'] for r in results),
                    'median_ratio': statistics.median(r['after'] / r['before'] for r in results),
                    'worst': max(r['after'] for r in results),
                    'drift': max(r['drift'] for r in results)}
        return self.once(f'loops {preset}', all_seeds)
