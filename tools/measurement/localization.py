"""Finding the camera in a map, and reproducing the paper's published medians."""
import statistics

import numpy as np
from PIL import Image

from .trajectories import (angle_deg, apply_similarity, cam1_from_cam0, matrix_from_quaternion, read_poses, read_times, similarity,
                           white_noise)
from .work import DATA, cairn, median_of_runs, rendered

# Of the kitchen's images: how Pillow makes them, and the camera that they are from then.
CHANGES = {
    'halved': (lambda image: image.resize((320, 240), Image.BOX), (320, 240), (262.5, 262.5, 159.75, 119.75)),
    'doubled': (lambda image: image.resize((1280, 960), Image.BICUBIC), (1280, 960), (1050.0, 1050.0, 640.5, 480.5)),
    'turned by 90 degrees': (lambda image: image.transpose(Image.ROTATE_270), (480, 640), (525.0, 525.0, 239.0, 320.0)),
    'turned by 180 degrees': (lambda image: image.transpose(Image.ROTATE_180), (640, 480), (525.0, 525.0, 319.0, 239.0)),
}


# Recordings of which a first part is mapped: their ground truth, and how many seconds that is.
FIRST_PARTS = {'redkitchen': ('reference_sfm.txt', 20), 'fr1_desk': ('groundtruth.txt', 1.9), 'apriltag': ('groundtruth.txt', 4),
               'euroc_v101_moving': ('groundtruth_cam0.txt', 2.5)}


def changed_kitchen(folder, change):
    """Every second image of the kitchen from 20 s on, changed; its folder with a camera file."""
    function, size, intrinsics = CHANGES[change]
    (folder / 'rgb').mkdir(parents=True)
    source = DATA / 'redkitchen'
    lines = [line for line in open(source / 'rgb.txt') if not line.startswith('#') and float(line.split()[0]) >= 20.0][::2]
    for line in lines:
        name = line.split()[1]
        function(Image.open(source / name)).save(folder / name, quality=95)
    (folder / 'rgb.txt').write_text(''.join(lines))
    (folder / 'camera.yaml').write_text(
        f'model: pinhole\nresolution_px: {list(size)}\nintrinsics_px: {list(intrinsics)}\ndistortion: []\n')
    return folder


def judged(answer, reference, max_dt=0.006):
    """Of the images located: position error, angle in degrees, and both squared over their variance."""
    true = read_poses(reference)
    times = np.array([time for time, _ in true])
    rows = []
    for image in answer['images']:
        at = int(np.abs(times - image['time_s']).argmin())
        if not image['localized'] or abs(times[at] - image['time_s']) > max_dt:
            continue
        apart = float(np.linalg.norm(np.array(image['position']) - true[at][1][:3, 3]))
        turned = angle_deg(matrix_from_quaternion(*image['quaternion_xyzw']).T @ true[at][1][:3, :3])
        rows.append((apart, turned, (apart / image['position_sigma']) ** 2, (turned / image['rotation_sigma_deg']) ** 2))
    return rows


class Localization:
    def relocalization(self):
        def one(run):
            folder, map_file = DATA / 'redkitchen', self.path(f'kitchen20_{run}.cairn')
            poses = self.path(f'kitchen20_poses_{run}.txt')
            camera = ['--camera', folder / 'camera.yaml']
            reference = folder / 'reference_sfm.txt'
            cairn('run', folder, *camera, *self.mode, '--until', 20, '--map', map_file, '--overwrite')
            cairn('align', map_file, '--groundtruth', reference, '--max-dt', 0.005)
            located = cairn('localize', folder, *camera, '--from', 20, '--map', map_file, '--independent', '--out', poses,
                            '--overwrite', expect=(0, 4))
            covered = cairn('eval', 'localization', poses, reference, '--queries', folder / 'covered_map_t20.txt')
            every = cairn('eval', 'localization', poses, reference)
            with_reference = sum(1 for t in read_times(reference) if t >= 20.0)
            return {'covered': covered['within_share'], 'wrong': every['wrong_share_of_answered'],
                    'all': every['within'] / with_reference, 'p50_ms': located['latency_ms']['median'],
                    'p99_ms': located['latency_ms']['p99']}
        return self.once('relocalization', lambda: median_of_runs(self.runs, one))

    def images(self, folder, map_file, *arguments):
        return cairn('localize', folder, '--map', map_file, '--independent', '--verbose', *arguments, expect=(0, 4))

    def single_images(self):
        """Of redkitchen from 20 s on in the map of its first 20 s; of kitti00, which it cannot know."""
        def one(run):
            folder, map_file = DATA / 'redkitchen', self.kitchen_map(run)
            located = self.images(folder, map_file, '--camera', folder / 'camera.yaml', '--from', 20)
            rows = judged(located, folder / 'reference_sfm.txt')
            elsewhere = self.images(DATA / 'kitti00', map_file, '--stride', 2)
            return {'located': located['localized_share'], 'p50_ms': located['latency_ms']['median'],
                    'nees': statistics.mean(row[2] for row in rows), 'nees_rotation': statistics.mean(row[3] for row in rows),
                    'median': statistics.median(row[0] for row in rows), 'answers': float(elsewhere['localized']),
                    'miss_ms': elsewhere['latency_ms']['median']}
        return self.once('single images', lambda: median_of_runs(self.runs, one))

    def first_part(self, name):
        """Every image of a recording in the map of its first part: error over the sigma that is claimed, after the similarity
        that fits those of that part to the truth, whose own white noise counts with sigma."""
        def one(run):
            truth, until = FIRST_PARTS[name]
            map_file, folder = self.path(f'first_{name}_{run}.cairn'), DATA / name
            if not map_file.exists():
                cairn('run', folder, *self.mode, '--until', until, '--map', map_file)
            answer, true = self.images(folder, map_file), read_poses(DATA / name / truth)
            times, positions = np.array([time for time, _ in true]), np.array([pose[:3, 3] for _, pose in true])
            located, at = [], []
            for image in answer['images']:
                nearest = int(np.abs(times - image['time_s']).argmin())
                if image['localized'] and abs(times[nearest] - image['time_s']) < 0.006:
                    located.append((image['time_s'] - answer['images'][0]['time_s'], image['position_sigma'], *image['position']))
                    at.append(positions[nearest])
            located, at = np.array(located), np.array(at)
            mapped = located[:, 0] < until
            transform = similarity(at[mapped], located[mapped, 2:])
            sigma = np.hypot(transform[0] * located[:, 1], white_noise(positions))
            over = np.linalg.norm(apply_similarity(transform, located[:, 2:]) - at, axis=1) / sigma
            return {'mapped': float(np.median(over[mapped])), 'mapped_nees': float(np.mean(over[mapped] ** 2)),
                    'later': float(np.median(over[~mapped])), 'later_nees': float(np.mean(over[~mapped] ** 2))}
        return self.once(f'first part {name}', lambda: median_of_runs(self.runs, one))

    def coverage(self, cell_m=0.4, min_queries=5):
        """Redkitchen's first 20 s: what coverage says of each cell, and what share of later images is located there."""
        def one(run):
            folder, map_file = DATA / 'redkitchen', self.kitchen_map(run)
            reference = folder / 'reference_sfm.txt'
            said = cairn('coverage', map_file, '--cell', cell_m)
            ground = np.array([said['right'], said['ahead']])
            located = self.images(folder, map_file, '--camera', folder / 'camera.yaml', '--from', 20)
            true, cells = read_poses(reference), {}
            times = np.array([time for time, _ in true])
            for image in located['images']:
                at = int(np.abs(times - image['time_s']).argmin())
                if abs(times[at] - image['time_s']) > 0.006:
                    continue
                pose = true[at][1]
                right = image['localized'] and np.linalg.norm(np.array(image['position']) - pose[:3, 3]) < 0.1
                cells.setdefault(tuple(np.floor(ground @ pose[:3, 3] / cell_m).astype(int)), []).append(bool(right))
            pairs = [(cell['share'], statistics.mean(cells[cell['x'], cell['y']])) for cell in said['cells']
                     if len(cells.get((cell['x'], cell['y']), [])) >= min_queries]
            # Where every image is located there is nothing to correlate with: the difference says as much.
            predicted, found = np.array(pairs).T
            varies = predicted.std() > 0 and found.std() > 0
            return {'correlation': float(np.corrcoef(predicted, found)[0, 1]) if varies else float('nan'),
                    'apart': float(np.abs(predicted - found).mean()), 'cells': float(len(pairs)),
                    'said': said['share'], 'true': located['localized_share']}
        return self.once('coverage', lambda: median_of_runs(self.runs, one))

    def changed_images(self, change):
        """How many points of a hundred fewer are located than of the same images as they are."""
        def one(run):
            source, map_file = DATA / 'redkitchen', self.kitchen_map(run)
            folder = self.once(f'kitchen {change}', lambda: changed_kitchen(self.path(change.replace(' ', '_')), change))
            usual = self.images(source, map_file, '--camera', source / 'camera.yaml', '--from', 20, '--stride', 2)
            located = self.images(folder, map_file, '--camera', folder / 'camera.yaml')
            return {'lost': 100 * (usual['localized_share'] - located['localized_share'])}
        return self.once(f'changed {change}', lambda: median_of_runs(self.runs, one))

    def alike_rooms(self):
        """Every second image of a room in the map of another one with the same furniture."""
        def one(seed):
            first, second = (rendered(self.worlds / f'alike_{100 * seed + place}_1', 'alike', '--seed', 100 * seed + place,
                                      '--catalogue', seed, '--session', 1, '--duration', 9) for place in (1, 2))
            map_file = self.path(f'alike_room_{seed}.cairn')
            cairn('run', first, *self.mode, '--map', map_file, '--overwrite')
            answer = self.images(second, map_file, '--stride', 2)
            return answer['localized'], answer['frames']

        def all_seeds():
            results = [one(seed) for seed in range(1, self.seeds + 1)]
            return {'answered': sum(r[0] for r in results) / sum(r[1] for r in results)}
        return self.once('alike rooms', all_seeds)

    def wrong_focal(self, off):
        """Every third image of a second visit to a rendered room, said to be of a longer lens."""
        def one():
            first = rendered(self.worlds / 'office_1', 'office', '--seed', 1)
            visit = rendered(self.worlds / 'track_office_1_2', 'office', '--seed', 1, '--session', 2, '--duration', 12)
            map_file, camera = self.path('focal_office.cairn'), self.path(f'focal_{off}.yaml')
            if not map_file.exists():
                cairn('run', first, *self.mode, '--map', map_file)
                cairn('align', map_file, '--groundtruth', first / 'groundtruth_cam0.txt')
            camera.write_text('model: pinhole\nresolution_px: [640, 480]\n'
                              f'intrinsics_px: [{420 * off}, {420 * off}, 319.5, 239.5]\ndistortion: []\n')
            answer = self.images(visit, map_file, '--stride', 3, '--camera', camera)
            rows = judged(answer, visit / 'groundtruth_cam0.txt')
            return {'told': sum('focal_factor' in image for image in answer['images']) / max(1, answer['localized']),
                    'unsure': sum(row[2] > 25 for row in rows) / max(1, len(rows))}
        return self.once(f'focal {off}', one)

    def kitchen_focal(self, off):
        """Every sixth later image of the kitchen, with a focal length that is another one: what no answer may be silent about."""
        def one(run):
            folder, map_file, camera = DATA / 'redkitchen', self.kitchen_map(run), self.path(f'kitchen_focal_{off}.yaml')
            camera.write_text('model: pinhole\nresolution_px: [640, 480]\n'
                              f'intrinsics_px: [{525 * off}, {525 * off}, 320, 240]\ndistortion: []\n')
            answer = self.images(folder, map_file, '--camera', camera, '--from', 20, '--stride', 1 if off == 1 else 6)
            told = [image for image in answer['images'] if 'focal_factor' in image]
            silent = [image for image in answer['images'] if 'focal_factor' not in image]
            rows = judged({'images': silent}, folder / 'reference_sfm.txt')
            return {'told': sum(image['localized'] for image in told) / max(1, answer['localized']),
                    'silent': float(sum(row[2] > 25 for row in rows)), 'located': answer['localized_share']}
        return self.once(f'kitchen focal {off}', lambda: median_of_runs(self.runs, one))

    def alike_corridors(self):
        """Images of another visit to a corridor with two sides that are exactly alike, in the map of both."""
        def one(seed):
            folder = rendered(self.worlds / f'aliasing_{seed}', 'aliasing', '--seed', seed)
            visit = rendered(self.worlds / f'aliasing_{seed}_2', 'aliasing', '--seed', seed, '--session', 2, '--duration', 40,
                             '--rate', 5)
            map_file = self.path(f'alike_corridor_{seed}.cairn')
            cairn('run', folder, *self.mode, '--map', map_file, '--overwrite')
            cairn('align', map_file, '--groundtruth', folder / 'groundtruth_cam0.txt')
            answer = self.images(visit, map_file)
            rows = judged(answer, visit / 'groundtruth_cam0.txt')
            wrong = sum(row[0] > 0.5 for row in rows)
            ambiguous = sum('ambiguous' in image for image in answer['images'])
            print(f'        corridor {seed}: {len(rows)} located, {wrong} in the wrong side, {ambiguous} ambiguous of '
                  f'{answer["frames"]}', flush=True)
            return {'wrong': wrong, 'told': (len(rows) + ambiguous) / answer['frames']}

        def all_seeds():
            results = [one(seed) for seed in range(1, self.seeds + 1)]
            return {'wrong': sum(r['wrong'] for r in results), 'told': min(r['told'] for r in results)}
        return self.once('alike corridors', all_seeds)

    def office_images(self):
        """Every third image of a second visit to a rendered room in the map of the first."""
        def one(seed):
            first = rendered(self.worlds / f'office_{seed}', 'office', '--seed', seed)
            visit = rendered(self.worlds / f'track_office_{seed}_2', 'office', '--seed', seed, '--session', 2, '--duration', 12)
            map_file = self.path(f'images_office_{seed}.cairn')
            cairn('run', first, *self.mode, '--map', map_file, '--overwrite')
            cairn('align', map_file, '--groundtruth', first / 'groundtruth_cam0.txt')
            return judged(self.images(visit, map_file, '--stride', 3), visit / 'groundtruth_cam0.txt')

        def all_seeds():
            rows = [row for seed in range(1, self.seeds + 1) for row in one(seed)]
            return {'nees': statistics.mean(row[2] for row in rows), 'nees_rotation': statistics.mean(row[3] for row in rows)}
        return self.once('office images', all_seeds)

    def stereo(self):
        def one():
            folder, map_file, poses = DATA / 'euroc_v101_keyframes', self.path('stills.cairn'), self.path('cam1.txt')
            cam0_truth, cam1_truth = folder / 'groundtruth_cam0.txt', self.path('groundtruth_cam1.txt')
            cam1_from_cam0(folder, cam0_truth, cam1_truth)
            cairn('run', folder, '--poses', cam0_truth, '--map', map_file, '--overwrite')
            cairn('localize', folder, '--camera-index', 1, '--map', map_file, '--independent', '--out', poses,
                  '--overwrite', expect=(0, 4))
            result = cairn('eval', 'localization', poses, cam1_truth, '--queries', cam1_truth, '--within-m', 0.15,
                           '--within-deg', 3)
            return {'located': result['within_share'], 'wrong': result['wrong_share_of_answered']}
        return self.once('stereo', one)

    def paper(self):
        def one():
            folder = DATA / 'paper_trajectories'
            euroc = {system: cairn('eval', 'ate', folder / 'euroc_V1_01_left' / system,
                                   folder / 'euroc_V1_01_left' / 'groundtruth.csv')['median']
                     for system in ('our_slam', 'orb_slam', 'dso_reduced')}
            mono = {system: cairn('eval', 'loop', folder / 'tum_mono_40' / system,
                                  folder / 'tum_mono_40' / 'groundtruth.txt')['median']
                    for system in ('our_slam', 'dso_default')}
            want = {'our_slam': 0.0899, 'orb_slam': 0.0967, 'dso_reduced': 0.1152}
            want_mono = {'our_slam': 0.1637, 'dso_default': 1.8053}
            right = sum(round(euroc[s], 4) == v for s, v in want.items()) + sum(
                round(mono[s], 4) == v for s, v in want_mono.items())
            return {'right': right}
        return self.once('paper', one)
