"""Maps of the real sequences: share of frames tracked, accuracy, time, growth."""
import contextlib
import re
import sqlite3

from .work import DATA, cairn, median_of_runs


def loop_times(map_file):
    with contextlib.closing(sqlite3.connect(f'file:{map_file}?mode=ro', uri=True)) as database:
        return [(a * 1e-9, b * 1e-9) for a, b in database.execute('SELECT keyframe_time_ns, loop_time_ns FROM loops')]


class Sequences:
    def sequence(self, name, truth, *, camera=True, max_dt=0.02, until=None):
        """Maps a sequence `runs` times: share of frames tracked and ATE over all of them."""
        tag = name if until is None else f'{name}_until_{until}'

        def one(run):
            frames = self.path(f'{tag}_{run}.txt')
            arguments = ['--camera', DATA / name / 'camera.yaml'] if camera else []
            arguments += [] if until is None else ['--until', until]
            report = cairn('run', DATA / name, *arguments, *self.mode, '--map', self.path(f'{tag}_{run}.cairn'), '--trajectory',
                           frames, '--overwrite')
            ate = cairn('eval', 'ate', frames, DATA / name / truth, '--max-dt', max_dt)
            return {'tracked': report['tracked_share'], 'ate': ate['ate_m'], 'frame_ms': report['frame_ms']['median'],
                    'track_ms': report['track_ms']['median'], 'keyframe_ms': report['keyframe_ms']['median'],
                    'keyframe_cpu_ms': report['keyframe_cpu_ms']['all']['median'],
                    'realtime': report['realtime_factor'], 'peak_mb': report['peak_mb']}
        return self.once(tag, lambda: median_of_runs(self.runs, one))

    def redkitchen(self):
        return self.sequence('redkitchen', 'reference_sfm.txt', max_dt=0.005)

    def redkitchen20(self):
        return self.sequence('redkitchen', 'reference_sfm.txt', max_dt=0.005, until=20)

    def euroc(self):
        return self.sequence('euroc_v101_moving', 'groundtruth_cam0.txt', camera=False, max_dt=0.01)

    def kitti00(self):
        return self.sequence('kitti00', 'poses.txt', camera=False)

    def apriltag(self):
        return self.sequence('apriltag', 'groundtruth.txt')

    def passes(self):
        """The first 8 s of redkitchen, forwards and backwards ten times: what the map has after one and after ten."""
        def grown(count):
            folder, times = self.path(f'passes_{count}'), DATA / 'redkitchen' / 'rgb.txt'
            folder.mkdir(exist_ok=True)
            images = [line.split() for line in open(times) if line.strip() and not line.startswith('#')]
            images = [(float(t), path) for t, path in images if float(t) - float(images[0][0]) < 8.0]
            lap = images + images[-2:0:-1]
            lines = [f'{i / 30.0:.6f} {DATA / "redkitchen" / path}' for i, (_, path) in
                     enumerate(lap * count + images[:1])]
            (folder / 'rgb.txt').write_text('\n'.join(lines) + '\n')
            truth = {float(line.split()[0]): line.split()[1:] for line in open(DATA / 'redkitchen' / 'reference_sfm.txt')
                     if line.strip() and not line.startswith('#')}
            with open(folder / 'truth.txt', 'w') as out:
                for i, (t, _) in enumerate(lap * count + images[:1]):
                    near = min(truth, key=lambda s: abs(s - t))
                    if abs(near - t) < 0.005:
                        out.write(f'{i / 30.0:.6f} {" ".join(truth[near])}\n')
            frames = folder / 'frames.txt'
            report = cairn('run', folder, '--camera', DATA / 'redkitchen' / 'camera.yaml', *self.mode, '--map', folder / 'map.cairn',
                           '--trajectory', frames, '--overwrite')
            ate = cairn('eval', 'ate', frames, folder / 'truth.txt', '--max-dt', 0.005)['ate_m']
            return report['keyframes'], report['points'], ate
        def one():
            first, tenth = grown(1), grown(10)
            return {'keyframes': tenth[0] / first[0], 'points': tenth[1] / first[1], 'ate': tenth[2] / first[2]}
        return self.once('passes', one)

    def still(self):
        def one():
            map_file = self.path('static.cairn')
            answer = cairn('run', DATA / 'euroc_v101_static', '--map', map_file, expect=(0, 1))
            says = re.search(r'not move(d)? enough', answer.get('error', '')) is not None
            return {'refused': float(answer['exit'] == 1 and not map_file.exists() and says)}
        return self.once('static', one)

    def joined(self):
        """Redkitchen: links of the map between its beginning and its end, or loops across."""
        self.redkitchen()

        def one(run):
            with contextlib.closing(sqlite3.connect(f'file:{self.path(f"redkitchen_{run}.cairn")}?mode=ro', uri=True)) as database:
                times = dict(database.execute('SELECT id, time_ns * 1e-9 FROM keyframes'))
                pairs = [(times[a], times[b]) for a, b, shared in database.execute(
                    'SELECT keyframe_a, keyframe_b, shared_points FROM covisibility') if shared >= 15]
            pairs += loop_times(self.path(f'redkitchen_{run}.cairn'))
            start = min(times.values())
            return {'links': sum(1 for a, b in pairs if min(a, b) < start + 10 and max(a, b) > start + 30)}
        return self.once('joined', lambda: median_of_runs(self.runs, one))

    def deterministic(self):
        def one():
            results = []
            for run in range(2):
                map_file, frames = self.path(f'det_{run}.cairn'), self.path(f'det_{run}.txt')
                report = cairn('run', DATA / 'redkitchen', '--camera', DATA / 'redkitchen' / 'camera.yaml', '--map', map_file,
                               '--trajectory', frames, '--deterministic', '--overwrite')
                digest = cairn('info', map_file, '--digest')['digest']
                results.append((frames.read_bytes(), digest, report))
            same = results[0][0] == results[1][0] and results[0][1] == results[1][1]
            return {'same': float(same), 'realtime': max(r[2]['realtime_factor'] for r in results),
                    'frame_ms': min(r[2]['frame_ms']['median'] for r in results)}
        return self.once('deterministic', one)
