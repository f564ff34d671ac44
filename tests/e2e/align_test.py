"""References as people have them: of the camera, of a body, without orientations, with errors, of another place."""
import math
import pathlib
import random
import shutil
import tempfile
import unittest

from cairn_cli import cairn, must
from served_maps import Server


def read_poses(path):
    """Rows of t x y z qx qy qz qw, as numbers."""
    return [[float(field) for field in line.split()] for line in path.read_text().splitlines()
            if line and not line.startswith('#')]


class Align(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.recording, cls.map, cls.frames = (cls.folder / name for name in ('visit', 'visit.cairn', 'frames.txt'))
        must('synth', 'office', '--seed', 3, '--session', 1, '--duration', 5, '--effects', 'noise', '--out', cls.recording)
        must('run', cls.recording, '--map', cls.map, '--trajectory', cls.frames, '--deterministic')
        cls.camera = cls.recording / 'groundtruth_cam0.txt'
        cls.body = cls.recording / 'mav0' / 'state_groundtruth_estimate0' / 'data.csv'
        cls.truth = cls.align(cls.camera)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    @classmethod
    def copy(cls):
        copy = cls.folder / 'copy.cairn'
        shutil.copy(cls.map, copy)
        return copy

    @classmethod
    def align(cls, reference, *options):
        return must('align', cls.copy(), '--groundtruth', reference, *options)

    def refused(self, map_file, reference, *options):
        """The message of an alignment that must not happen; the map stays as it is."""
        before = must('info', map_file, '--digest')['digest']
        answer = cairn('align', map_file, '--groundtruth', reference, *options)
        self.assertEqual(answer.code, 1, answer.out)
        self.assertEqual(must('info', map_file, '--digest')['digest'], before)
        return answer.json['error']

    def write(self, name, poses):
        path = self.folder / name
        path.write_text(''.join(' '.join(f'{value:.9f}' for value in pose) + '\n' for pose in poses))
        return path

    def test_a_session_can_be_named_and_few_keyframes_are_not_enough(self):
        self.assertIn('no session 9', self.refused(self.map, self.camera, '--session', 9))
        few = self.write('few.txt', [pose for pose in read_poses(self.camera) if pose[0] < read_poses(self.camera)[0][0] + 1.5])
        self.assertIn('at least 7', self.refused(self.map, few))
        self.assertEqual(self.align(self.camera, '--session', 1)['component'], 1)

    def test_the_cameras_poses(self):
        self.assertEqual(self.truth['orientations'], 'camera')
        self.assertEqual(self.truth['inliers'], self.truth['keyframes_used'])
        self.assertEqual(self.truth['misfits_s'], [])
        self.assertLess(self.truth['rmse_m'], 0.01)
        self.assertLess(self.truth['rotation_sigma_deg'], 0.5)
        self.assertGreater(self.truth['position_sigma_m'], 0)
        self.assertIsNone(self.truth['sensor'])

    def test_a_bodys_poses_get_the_cameras_place_on_it(self):
        known = self.align(self.body)
        self.assertTrue(known['sensor'].endswith('sensor.yaml'))
        self.assertEqual(known['orientations'], 'camera')
        self.assertAlmostEqual(known['scale'], self.truth['scale'], delta=0.002 * self.truth['scale'])
        # Not known: found by the way it turns.
        found = self.align(self.body, '--sensor', 'none')
        self.assertEqual(found['orientations'], 'body')
        self.assertAlmostEqual(found['body_turned_deg'], 120, delta=1)
        self.assertAlmostEqual(found['body_distance_m'], 0.055, delta=0.02)
        self.assertAlmostEqual(found['scale'], self.truth['scale'], delta=0.02 * self.truth['scale'])
        given = self.align(self.body, '--sensor', self.recording / 'mav0' / 'cam0' / 'sensor.yaml')
        self.assertEqual(given['scale'], known['scale'])

    def test_evaluation_does_the_same(self):
        camera = must('eval', 'ate', self.frames, self.camera)
        body = must('eval', 'ate', self.frames, self.body)
        self.assertAlmostEqual(body['ate_m'], camera['ate_m'], delta=0.001)
        self.assertAlmostEqual(body['rotation_deg']['median'], camera['rotation_deg']['median'], delta=0.05)
        self.assertTrue(body['reference']['sensor'].endswith('sensor.yaml'))
        unknown = must('eval', 'ate', self.frames, self.body, '--sensor', 'none')
        self.assertEqual(unknown['reference']['orientations'], 'body')
        self.assertLess(unknown['rotation_deg']['median'], 1)
        for verb in (['rpe', '--delta', 0.5], ['localization']):
            aligned = self.folder / 'aligned.txt'
            estimate = self.frames
            if verb[0] == 'localization':
                estimate = aligned
                aligned.write_text(self.camera.read_text())
            answer = must('eval', verb[0], estimate, self.body, *verb[1:])
            rotation = answer['error_deg'] if verb[0] == 'localization' else answer['rpe'][0]['rotation_deg']
            self.assertLess(rotation['median'], 1, verb)
            self.assertIsNotNone(answer['reference']['sensor'], verb)

    def test_orientations_that_mean_nothing_are_found_out(self):
        identity = self.write('identity.txt', [pose[:4] + [0, 0, 0, 1] for pose in read_poses(self.camera)])
        answer = self.align(identity)
        self.assertEqual(answer['orientations'], 'constant')
        self.assertAlmostEqual(answer['scale'], self.truth['scale'], delta=0.01 * self.truth['scale'])
        self.assertIn('positions alone', cairn('align', self.copy(), '--groundtruth', identity, json_output=False).out)
        ate = must('eval', 'ate', self.frames, identity)
        self.assertIsNone(ate['rotation_deg'])
        self.assertEqual(ate['ate_m'], must('eval', 'ate', self.frames, self.camera)['ate_m'])

    def test_positions_that_do_not_fit_are_named(self):
        poses = read_poses(self.camera)
        for pose in poses:
            if pose[0] > poses[-1][0] - 1.2:
                pose[1] += 2
        answer = self.align(self.write('shifted.txt', poses))
        self.assertEqual(answer['inliers'] + len(answer['misfits_s']), answer['keyframes_used'])
        self.assertGreaterEqual(len(answer['misfits_s']), 1)
        self.assertGreater(min(answer['misfits_s']), poses[-1][0] - 1.2)
        self.assertGreater(answer['rmse_all_m'], 10 * answer['rmse_m'])

    def test_noise_as_given_or_as_found(self):
        noise = random.Random(1)
        noisy = [pose[:1] + [value + noise.gauss(0, 0.02) for value in pose[1:4]] + pose[4:] for pose in read_poses(self.camera)]
        found = self.align(self.write('noisy.txt', noisy))
        self.assertAlmostEqual(found['noise_position_m'], 0.02, delta=0.01)
        given = self.align(self.write('noisy.txt', noisy), '--sigma-position', 0.1, '--sigma-rotation', 1)
        self.assertGreater(given['scale_sigma'], 2 * found['scale_sigma'])

    def test_another_place_is_refused(self):
        times = [pose[0] for pose in read_poses(self.camera)]
        elsewhere = []
        for i, time in enumerate(times):
            yaw = 0.004 * i if i < 60 else 0.24 + 0.03 * (i - 60)
            elsewhere.append([time, 40 * math.sin(yaw), 0.1 * math.sin(i), 0.9 * i, 0, math.sin(yaw / 2), 0, math.cos(yaw / 2)])
        reference = self.write('elsewhere.txt', elsewhere)
        message = self.refused(self.copy(), reference)
        self.assertIn('as it was', message)
        aligned = self.copy()
        must('align', aligned, '--groundtruth', self.camera)
        self.assertIn('as it was', self.refused(aligned, reference, '--overwrite'))

    def test_another_scale_than_that_of_the_alignment_there_is(self):
        tripled = self.write('tripled.txt', [pose[:1] + [3 * value for value in pose[1:4]] + pose[4:] for pose in read_poses(self.camera)])
        aligned = self.copy()
        must('align', aligned, '--groundtruth', self.camera)
        self.assertIn('--overwrite', self.refused(aligned, tripled))
        self.assertIn('3 times larger', self.refused(aligned, tripled, '--overwrite'))
        forced = must('align', aligned, '--groundtruth', tripled, '--overwrite', '--force')
        self.assertAlmostEqual(forced['scale'], 3 * self.truth['scale'], delta=0.01 * forced['scale'])
        self.assertGreater(forced['moved_m'], 0.1)

    def test_a_component_that_is_not_there(self):
        message = self.refused(self.copy(), self.camera, '--component', 7)
        self.assertIn('no component 7', message)
        self.assertEqual(self.align(self.camera, '--component', 1)['scale'], self.truth['scale'])

    def test_each_component_is_aligned_by_its_own_reference(self):
        elsewhere, two = self.folder / 'elsewhere', self.copy()
        must('synth', 'office', '--seed', 99, '--duration', 3, '--out', elsewhere)
        must('run', elsewhere, '--map', two, '--extend', '--deterministic')
        reference = elsewhere / 'groundtruth_cam0.txt'
        self.assertIn('--component 2', self.refused(two, reference, '--component', 1))
        self.refused(two, self.camera, '--component', 2)
        second = must('align', two, '--groundtruth', reference, '--component', 2)
        self.assertEqual(second['component'], 2)
        self.assertEqual([(c['component'], c['aligned']) for c in second['other_components']], [(1, False)])
        first = must('align', two, '--groundtruth', self.camera)
        self.assertEqual(first['component'], 1)
        self.assertEqual(first['scale'], self.truth['scale'])
        self.assertEqual([(c['component'], c['aligned']) for c in first['other_components']], [(2, True)])

    def test_what_is_not_determined_is_refused(self):
        still = self.write('still.txt', [pose[:1] + [1, 2, 3] + pose[4:] for pose in read_poses(self.camera)])
        self.assertIn('scale', self.refused(self.copy(), still))
        noise = random.Random(2)
        jitter = [pose[:1] + [noise.gauss(0, 0.01) for _ in range(3)] + pose[4:] for pose in read_poses(self.camera)]
        self.assertRegex(self.refused(self.copy(), self.write('jitter.txt', jitter)), r'scale is not determined: .* \+- ')

    # What somebody has measured: places of points and cameras, distances, which way is up.

    def surveyed(self):
        """Points of the map by where the poses of the recording put them: those that are seen most, far from each other."""
        truth = self.copy()
        must('align', truth, '--groundtruth', self.camera)
        points = must('ls', truth, 'points', '--sort', 'observations', '--reverse', '--limit', 60)['points']
        far = [points[0]]
        while len(far) < 5:
            far.append(max(points, key=lambda p: min(math.dist(at(p), at(q)) for q in far)))
        return far, {k['id']: at(k) for k in must('ls', truth, 'keyframes')['keyframes']}

    def moved(self, map_file, cameras):
        """How far the cameras are from where they should be: median and most, metres."""
        off = sorted(math.dist(at(k), cameras[k['id']]) for k in must('ls', map_file, 'keyframes')['keyframes'])
        return off[len(off) // 2], off[-1]

    def test_surveyed_places_align_a_map(self):
        points, cameras = self.surveyed()
        lines = [f"point {p['id']} {p['x']} {p['y']} {p['z']}" for p in points[:3]]
        keyframe = max(cameras)
        lines.append(f'keyframe {keyframe} ' + ' '.join(map(str, cameras[keyframe])))
        survey, map_file = self.folder / 'survey.txt', self.copy()
        survey.write_text('\n'.join(['# what was measured', *lines]) + '\n')
        aligned = must('align', map_file, '--points', survey)
        self.assertAlmostEqual(aligned['scale'], self.truth['scale'], delta=1e-4 * self.truth['scale'])
        self.assertEqual(len(aligned['errors_m']), 4)
        self.assertLess(aligned['rmse_m'], 1e-3)
        self.assertLess(self.moved(map_file, cameras)[1], 2e-3)
        self.assertEqual(must('verify', map_file, '--deep')['findings'], [])
        # One that is a metre off is told, and changes nothing.
        wrong = self.copy()
        survey.write_text('\n'.join([*lines[:3], f"point {points[3]['id']} {points[3]['x'] + 1} {points[3]['y']} {points[3]['z']}",
                                     f"point {points[4]['id']} {points[4]['x']} {points[4]['y']} {points[4]['z']}"]))
        before = must('info', wrong, '--digest')['digest']
        answer = cairn('align', wrong, '--points', survey)
        self.assertEqual(answer.code, 1, answer.out)
        self.assertEqual(must('info', wrong, '--digest')['digest'], before)
        # Numbers with decimal commas are more columns, of other numbers.
        survey.write_text('\n'.join([*lines[:2], 'point 1 0,5 1 2']) + '\n')
        self.assertIn('the decimal sign is a point', cairn('align', wrong, '--points', survey).json['error'])
        for text, columns in (('1 60.17 24.93 500,323', 5), ('2 60,17 24,93 500,3', 7), ('3 60.17 24.93 500 7', 5)):
            survey.write_text(f'keyframe latitude longitude height\n1 60.17 24.93 500\n{text}\n')
            error = cairn('align', wrong, '--geo-positions', survey).json['error']
            self.assertIn(f':3: {columns} columns, and `keyframe latitude longitude height` are 4', error)
        for text in (lines[0], 'point 999999 0 0 0', 'point 1 0 0', 'tower 1 0 0 0'):
            survey.write_text('\n'.join([*lines[:2], text]) + '\n')
            self.assertIn(cairn('align', wrong, '--points', survey).code, (1, 2), text)

    def test_mistakes_of_the_call_are_usage_errors(self):
        for options in (['--distance', 'x'], ['--distance', 'point 1 point 1 2'], ['--distance', 'point 1 point 2 0'],
                        ['--distance', 'point 1 point 2 -1'], ['--distance', 'point 1 point 2 nan'], ['--gravity', '0 0 0'],
                        ['--gravity', '0 nan 1'], ['--gravity', 'down'], ['--geo', '1 2'], ['--geo', '100 0 0'],
                        ['--points', 'x', '--gravity', 'cameras'], ['--groundtruth', self.camera, '--max-dt', -1]):
            answer = cairn('align', self.copy(), *options)
            self.assertEqual((answer.code, answer.json['fault']), (2, 'usage'), f'{options}: {answer.out}')
        self.assertIn('--gravity', cairn('align', self.copy()).json['error'])
        survey = self.folder / 'mistakes.txt'
        good = [f'keyframe {k} {k} 0 0' for k in (1, 2)]
        for line, said in (('point 1 nan 0 0', 'mistakes.txt:4: three numbers X Y Z are needed, not "nan 0 0"'),
                           ('point 999999 0 0 0', 'known position 3: ')):
            survey.write_text('\n'.join(['# a survey', *good, line]) + '\n')
            answer = cairn('align', self.copy(), '--points', survey)
            self.assertEqual(answer.code, 1, answer.out)
            self.assertIn(said, answer.json['error'])
        self.assertIn('point 999999', answer.json['error'])

    def test_a_distance_and_gravity_align_a_map(self):
        points, cameras = self.surveyed()
        apart = math.dist(at(points[0]), at(points[1]))
        distance = f"point {points[0]['id']} point {points[1]['id']} {apart}"
        map_file = self.copy()
        aligned = must('align', map_file, '--distance', distance, '--gravity', 'cameras')
        self.assertAlmostEqual(aligned['scale'], self.truth['scale'], delta=1e-4 * self.truth['scale'])
        # The world's z axis points upwards: cameras that look ahead stand as high as each other, as they do in the room.
        there = {k['id']: at(k) for k in must('ls', map_file, 'keyframes')['keyframes']}
        ids = sorted(there)
        for a, b in ((ids[0], ids[-1]), (ids[0], ids[len(ids) // 2])):
            self.assertAlmostEqual(math.dist(there[a], there[b]), math.dist(cameras[a], cameras[b]), delta=2e-3)
            self.assertAlmostEqual(there[a][2] - there[b][2], cameras[a][2] - cameras[b][2], delta=0.15)
        # A distance alone scales what is aligned, and says so first.
        self.assertEqual(cairn('align', map_file, '--distance', distance).code, 1)
        doubled = ('align', map_file, '--distance', f"point {points[0]['id']} point {points[1]['id']} {2 * apart}", '--overwrite')
        refused = cairn(*doubled)
        self.assertEqual(refused.code, 1, refused.out)
        self.assertIn('2 times larger', refused.json['error'])
        twice = must(*doubled, '--force')
        self.assertAlmostEqual(twice['scale'], 2 * aligned['scale'], delta=1e-3 * aligned['scale'])
        # The same through a server.
        maps = self.folder / 'served'
        maps.mkdir()
        shutil.copy(self.copy(), maps / 'office.cairn')
        server = Server(maps)
        served = must('--server', server.address, 'align', 'office', '--distance', distance, '--gravity', 'cameras')
        self.assertEqual(server.stop(), 0)
        self.assertEqual((served['scale'], served['component']), (aligned['scale'], aligned['component']))


def at(row):
    return [row['x'], row['y'], row['z']]


if __name__ == '__main__':
    unittest.main(verbosity=2)
