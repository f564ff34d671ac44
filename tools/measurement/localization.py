"""Finding the camera in a map, and reproducing the paper's published medians."""
from .trajectories import cam1_from_cam0, read_times
from .work import DATA, cairn, median_of_runs


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
