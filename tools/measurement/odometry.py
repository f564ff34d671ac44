"""The odometry alone: accuracy from many starts, speed, memory, and the kernels."""
import json
import statistics
import subprocess

import numpy as np

from .trajectories import read_positions, similarity, white_noise
from .work import CAIRN, DATA, ROOT, Failed, Skipped, cairn, median_of_runs


class Odometry:
    def pieces(self):
        """Ten starts of the odometry along redkitchen, 6.7 s each."""
        def one():
            folder, frames, errors = DATA / 'redkitchen', self.path('piece.txt'), []
            for i in range(10):
                start = 15 * i / 9
                cairn('run', folder, '--camera', folder / 'camera.yaml', '--odometry-only', '--deterministic', '--from', start,
                      '--until', start + 6.7, '--trajectory', frames, '--overwrite')
                errors.append(cairn('eval', 'ate', frames, folder / 'reference_sfm.txt', '--max-dt', 0.005)['ate_m'])
            return {'median': statistics.median(errors), 'worst': max(errors)}
        return self.once('pieces', one)

    def alone(self, name, truth=None):
        """Share of the frames tracked, and ATE over them."""
        def one(run):
            frames, camera = self.path(f'alone_{name}_{run}.txt'), DATA / name / 'camera.yaml'
            report = cairn('run', DATA / name, *(['--camera', camera] if camera.exists() else []), '--odometry-only',
                           *self.mode, '--trajectory', frames, '--overwrite')
            result = {'tracked': report['tracked_share']}
            if truth:
                result['ate'] = cairn('eval', 'ate', frames, DATA / name / truth, '--max-dt', 0.02)['ate_m']
            return result
        return self.once(f'alone {name}', lambda: median_of_runs(self.runs, one))

    def noise(self, name, truth):
        """Noise from image to image of the truth's positions, and of the odometry's in its scale."""
        def one():
            self.alone(name, truth)
            estimated, true = read_positions(self.path(f'alone_{name}_0.txt')), read_positions(DATA / name / truth)
            true = true[np.abs(true[:, 0][None, :] - estimated[:, 0][:, None]).argmin(axis=1), 1:]
            scale = similarity(true, estimated[:, 1:])[0]
            return {'truth': white_noise(true), 'own': scale * white_noise(estimated[:, 1:])}
        return self.once(f'noise {name}', one)

    def scale(self):
        """How much the scale of the second 5 s of redkitchen differs from that of the first."""
        def one():
            folder, frames = DATA / 'redkitchen', self.path('scale.txt')
            cairn('run', folder, '--camera', folder / 'camera.yaml', '--odometry-only', '--deterministic', '--until', 11,
                  '--trajectory', frames, '--overwrite')
            estimated, true = read_positions(frames), read_positions(folder / 'reference_sfm.txt')
            nearest = np.abs(true[:, 0][None, :] - estimated[:, 0][:, None]).argmin(axis=1)
            paired = np.abs(true[nearest, 0] - estimated[:, 0]) < 0.011
            since = estimated[:, 0] - estimated[0, 0]
            first, second = (similarity(true[nearest[part], 1:], estimated[part, 1:])[0]
                             for part in (paired & (since < 5.0), paired & (since >= 5.0) & (since < 10.0)))
            return {'change': abs(second / first - 1.0)}
        return self.once('scale', one)

    def bench(self, *options):
        def one(run):
            report = cairn('bench', 'direct', DATA / 'redkitchen', '--camera', DATA / 'redkitchen' / 'camera.yaml', *options)
            frame = report['stages_ms']['frame']
            return {'median': frame['median'], 'mean': frame['mean'], 'p99': frame['p99'],
                    'track': report['stages_ms']['track']['mean'], 'dropped': report['frames_dropped'],
                    'realtime': report['realtime_factor'], 'memory': report['peak_memory_mb']}
        return self.once(f'bench{options}', lambda: median_of_runs(self.runs, one))

    def simd(self):
        """How many times as fast as the baseline the AVX2 kernels are: the least, and the pyramid, which memory bounds."""
        def one():
            if not (CAIRN.parent / 'direct_benchmark').exists() or not (CAIRN.parent / 'image_benchmark').exists():
                raise Skipped('the benchmarks are not built (-DCAIRN_BUILD_BENCHMARKS=ON)')
            out = self.path('simd.json')
            command = [str(ROOT / 'tools' / 'simd_ratios'), '--bin', str(CAIRN.parent), '--json', str(out)]
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode != 0:
                raise Failed(done.stderr.strip()[-300:])
            times = json.loads(out.read_text())
            if any('avx2' not in levels for levels in times.values()):
                raise Skipped('this processor has no AVX2')
            ratios = {kernel: levels['baseline'] / levels['avx2'] for kernel, levels in times.items()}
            bound = ('pyramid', 'pyramid_from_floats', 'pyramid_full', 'gradients')
            return {'least': min(r for kernel, r in ratios.items() if kernel not in bound), 'pyramid': ratios['pyramid']}
        return self.once('simd', one)
