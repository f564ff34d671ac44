"""Rendered worlds with exact ground truth, over --seeds: odometry, photometric calibration, loops, growth."""
import contextlib
import sqlite3
import statistics

import numpy as np

from .sequences import loop_times
from .trajectories import distance_between, read_positions, scale_drift
from .work import cairn, median_of_runs, rendered


# What `cairn synth` is asked for, by the name of the folder.
KINDS = {
    'office': ['office'],
    'plain': ['plain'],  # 30 % of its walls are blank
    'corridor': ['corridor'],
    'aliasing': ['aliasing'],
    'photometric': ['office', '--format', 'tum_mono', '--effects', 'response', 'vignette', 'exposure', 'noise'],
    'laps': ['office', '--laps', '10'],
    'soft': ['soft', '--duration', '28'],  # its second side has next to no corners
    'turning': ['turning'],
    'desk': ['desk'],
    'spin': ['spin'],
    'aside': ['aside', '--rate', '15'],
    'ahead': ['ahead', '--rate', '15'],
    'rich': ['corridor', '--size', '14', '13', '--duration', '28'],  # the same with corners everywhere
}


def path_length(truth):
    return float(np.linalg.norm(np.diff(read_positions(truth)[:, 1:], axis=0), axis=1).sum())


def roots(map_file):
    """Keyframes that hang on no other."""
    with contextlib.closing(sqlite3.connect(f'file:{map_file}?mode=ro', uri=True)) as database:
        return database.execute('SELECT COUNT(*) FROM keyframes WHERE parent IS NULL').fetchone()[0]


class Worlds:
    def world(self, kind, seed):
        """A rendered recording; kept in --worlds and used again."""
        return rendered(self.worlds / f'{kind}_{seed}', *KINDS[kind], '--seed', seed)

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

    def soft(self):
        """Corridors with a side without corners, and without: what the feature module says of itself, and what becomes
        of the map."""
        def one(seed):
            result = {}
            for kind in ('soft', 'rich'):
                folder, frames, file = self.world(kind, seed), self.path(f'{kind}_{seed}.txt'), self.path(f'{kind}_{seed}.cairn')
                report = cairn('run', folder, *self.mode, '--map', file, '--trajectory', frames, '--overwrite')
                result[kind] = cairn('eval', 'ate', frames, self.truth(folder))['ate_m']
                if kind == 'rich':
                    continue
                states = report['keyframe_states']
                lost = [k['t'] for k in states if k['state'] == 'lost']
                restarts = [k['t'] for k in states if k['restarted']]
                result.update(tracked=report['tracked_share'], lost_s=max(lost) - min(lost) if lost else 0.0,
                              share=result['soft'] / path_length(self.truth(folder)),
                              linked=bool(restarts) and states[-1]['state'] == 'good' and roots(file) == 1)
            result['ratio'] = result['soft'] / result['rich']
            print(f'        soft {seed}: {result}', flush=True)
            return result

        def all_seeds():
            results = [one(seed) for seed in range(1, self.seeds + 1)]
            return {'share': max(r['share'] for r in results), 'tracked': min(r['tracked'] for r in results),
                    'lost_s': min(r['lost_s'] for r in results), 'linked': statistics.mean(r['linked'] for r in results),
                    'ratio': statistics.median(r['ratio'] for r in results)}
        return self.once('soft', all_seeds)

    def loop_live(self):
        """The first corridor at the pace of its recording: how long a frame call takes while its loop is corrected."""
        def one(run):
            folder, file = self.world('corridor', 1), self.path(f'live_{run}.cairn')
            report = cairn('run', folder, '--realtime', '--map', file, '--overwrite')
            print(f'        live loop: {len(report["loops"])} closed, correction {report["loop_correction_ms"]}, adjustment '
                  f'{report["loop_adjustment_ms"]}, frames {report["frame_ms"]}, while correcting '
                  f'{report["frame_ms_correcting"]}', flush=True)
            return {'correcting_max': report['frame_ms_correcting']['max'],
                    'correcting_p99': report['frame_ms_correcting']['p99'], 'p99': report['frame_ms']['p99']}
        return self.once('live loop', lambda: median_of_runs(self.runs, one))

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
        """A corridor per seed: the odometry alone (before), mapped without (open) and with loop closing (after)."""
        def one(seed):
            folder = self.world(preset, seed)
            truth, result = folder / 'groundtruth_cam0.txt', {}
            for name in ('after', 'open', 'before'):
                frames, file = (self.path(f'{preset}_{seed}_{name}.{ending}') for ending in ('txt', 'cairn'))
                way = {'after': ['--map', file], 'open': ['--map', file, '--vo'], 'before': ['--odometry-only']}[name]
                report = cairn('run', folder, *self.mode, *way, '--trajectory', frames, '--overwrite')
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
                    'worst': max(r['after'] for r in results), 'open': statistics.median(r['open'] for r in results),
                    'drift': max(r['drift'] for r in results)}
        return self.once(f'loops {preset}', all_seeds)
