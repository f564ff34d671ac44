"""The odometry alone: accuracy from many starts, speed, memory, and the kernels."""
import json
import statistics
import subprocess

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
