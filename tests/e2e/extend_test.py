"""Sessions that extend a map: found in it and added to it, with another camera, in another place, and from a room of its
own into the one that is mapped."""
import pathlib
import shutil
import tempfile
import unittest

from cairn_cli import cairn, must


def render(folder, world, seed, session, *more):
    out = folder / f'{world}_{seed}_{session}'
    must('synth', world, '--seed', seed, '--session', session, '--out', out, *more)
    return out


class Office(unittest.TestCase):
    """Two visits to an office and one to another, in one map; each run extends what the one before left."""

    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        narrow = ['--image-size', 800, 500, '--focal', 640, '--gamma', 1.5, '--light', 0.7]
        cls.visits = [render(cls.folder, 'office', 3, 1, '--duration', 8), render(cls.folder, 'office', 3, 2, '--duration', 5, *narrow),
                      render(cls.folder, 'office', 77, 1, '--duration', 5)]
        cls.map, cls.reports, cls.revisions = cls.folder / 'office.cairn', [], []
        for k, visit in enumerate(cls.visits):
            cls.reports.append(must('run', visit, '--map', cls.map, '--trajectory', cls.frames(k), '--deterministic',
                                    *(['--extend'] if k else [])))
            cls.revisions.append(must('info', cls.map)['revision'])
            if k == 0:
                must('align', cls.map, '--component', 1, '--groundtruth', visit / 'groundtruth_cam0.txt')
                cls.first_only = shutil.copy(cls.map, cls.folder / 'first.cairn')
        cls.info = must('info', cls.map)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    @classmethod
    def frames(cls, k):
        return cls.folder / f'frames_{k}.txt'

    def test_a_map_that_exists_is_neither_extended_nor_replaced_unasked(self):
        answer = cairn('run', self.visits[1], '--map', self.map)
        self.assertEqual(answer.code, 1)
        self.assertIn('--extend', answer.json['error'])
        self.assertIn('--overwrite', answer.json['error'])
        answer = cairn('run', self.visits[1], '--map', self.folder / 'none.cairn', '--extend')
        self.assertEqual(answer.code, 1)
        self.assertFalse((self.folder / 'none.cairn').exists())
        self.assertEqual(cairn('run', self.visits[1], '--map', self.map, '--extend', '--name', 'other').code, 2)
        self.assertEqual(must('info', self.map)['revision'], self.revisions[-1])

    def test_another_camera_is_found_in_the_map_and_extends_it(self):
        report = self.reports[1]
        self.assertEqual(report['component'], 1)
        self.assertLess(report['located_after_s'], 1.0)
        self.assertEqual([(join['component'], join['into']) for join in report['joined']], [(2, 1)])
        self.assertGreaterEqual(report['tracked_share'], 0.95)
        self.assertEqual(len(self.info['cameras']), 2)
        self.assertEqual([session['camera'] for session in self.info['sessions']], [1, 2, 1])

    def test_its_poses_are_those_of_the_map(self):
        """In a map that is aligned by the first visit the frames of the second are where they were."""
        poses = self.folder / 'located.txt'
        must('localize', self.visits[1], '--stride', 5, '--map', self.map, '--independent', '--out', poses)
        result = must('eval', 'localization', poses, self.visits[1] / 'groundtruth_cam0.txt')
        self.assertGreaterEqual(result['answered'], 15)
        self.assertEqual(result['wrong'], 0)
        self.assertLess(result['error_m']['median'], 0.02)
        ate = must('eval', 'ate', self.frames(1), self.visits[1] / 'groundtruth_cam0.txt')
        self.assertLess(ate['ate_m'], 0.02)

    def test_another_place_stays_a_component_of_its_own_and_can_be_asked(self):
        report = self.reports[2]
        self.assertEqual(report['component'], 3)
        self.assertIsNone(report['located_after_s'])
        self.assertEqual(report['joined'], [])
        components = {component['id']: component for component in self.info['components']}
        self.assertEqual({id: component['joined_into'] for id, component in components.items()}, {1: None, 2: 1, 3: None})
        self.assertEqual({id: component['sessions'] for id, component in components.items()}, {1: [1, 2], 2: [], 3: [3]})
        self.assertTrue(components[1]['aligned'])
        self.assertFalse(components[3]['aligned'])
        self.assertEqual(components[1]['keyframes'] + components[3]['keyframes'], self.info['keyframes'])
        answer = must('localize', self.visits[2], '--stride', 10, '--map', self.map, '--independent')
        self.assertGreaterEqual(answer['localized'], 5)

    def test_info_lists_the_sessions(self):
        self.assertEqual([session['id'] for session in self.info['sessions']], [1, 2, 3])
        self.assertEqual([session['source'] for session in self.info['sessions']], [visit.name for visit in self.visits])
        self.assertEqual([session['components'] for session in self.info['sessions']], [[1], [1, 2], [3]])
        self.assertEqual(sum(session['keyframes'] for session in self.info['sessions']), self.info['keyframes'])
        self.assertTrue(all(session['complete'] for session in self.info['sessions']))

    def test_a_calibration_of_another_camera_is_not_believed(self):
        """What is mapped with it would be wrong in the map, and everyone who is located there as well."""
        camera = self.folder / 'wrong.yaml'
        camera.write_text('model: pinhole\nresolution_px: [800, 500]\nintrinsics_px: [610, 610, 399.5, 249.5]\n')
        file = pathlib.Path(shutil.copy(self.first_only, self.folder / 'wrong.cairn'))
        report = must('run', self.visits[1], '--map', file, '--extend', '--camera', camera, '--deterministic')
        self.assertEqual((report['result'], report['joined']), ('apart', []))
        self.assertTrue(any('calibrat' in reason for reason in report['joins_rejected']), report['joins_rejected'])
        self.assertTrue(report['calibration_contradicted'], report['joins_rejected'])

    def test_a_camera_that_is_known_keeps_its_name(self):
        file = pathlib.Path(shutil.copy(self.first_only, self.folder / 'named.cairn'))
        answer = cairn('run', self.visits[2], '--map', file, '--extend', '--camera-name', 'another', '--until', 1)
        self.assertEqual(answer.code, 1)
        self.assertIn('not as "another"', answer.json['error'])

    def test_a_session_that_is_not_there_has_no_changes(self):
        answer = cairn('log', self.map, '--session', 9)
        self.assertEqual(answer.code, 1)
        self.assertIn('has no session 9', answer.json['error'])

    def test_given_poses_are_held_against_the_map(self):
        """One place must not be in the map twice."""
        poses = [line.split() for line in open(self.visits[1] / 'groundtruth_cam0.txt') if not line.startswith('#')]
        for shift, code in ((1.5, 1), (0.0, 0)):
            given = self.folder / 'given.txt'
            given.write_text(''.join(' '.join([t, str(float(x) + shift), *rest]) + '\n' for t, x, *rest in poses))
            file = pathlib.Path(shutil.copy(self.first_only, self.folder / 'given.cairn'))
            answer = cairn('run', self.visits[1], '--poses', given, '--map', file, '--extend', '--stride', 8)
            self.assertEqual(answer.code, code, answer.err)
            if code:
                self.assertIn('contradict the map', answer.json['error'])
                self.assertEqual(must('info', file)['keyframes'], must('info', self.first_only)['keyframes'])
            else:
                self.assertGreater(answer.json['images_found_in_map'], 3)

    def test_people_are_told_where_the_session_is(self):
        for visit, says in ((self.visits[1], r'looks like component 1 after \d+\.\d s'), (self.visits[2], r'component 2, a place of its own')):
            file = pathlib.Path(shutil.copy(self.first_only, self.folder / 'people.cairn'))
            answer = cairn('run', visit, '--until', 3, '--map', file, '--extend', json_output=False)
            self.assertEqual(answer.code, 0, answer.err)
            self.assertRegex(answer.out + answer.err, says)

    def test_extending_is_deterministic(self):
        digests = []
        for name in ('one', 'two'):
            file = pathlib.Path(shutil.copy(self.first_only, self.folder / f'{name}.cairn'))
            must('run', self.visits[1], '--until', 3, '--map', file, '--extend', '--deterministic')
            digests.append(must('info', file, '--digest')['digest'])
        self.assertEqual(*digests)


class Rooms(unittest.TestCase):
    def test_rooms_with_the_same_furniture_are_not_taken_for_one(self):
        with tempfile.TemporaryDirectory(prefix='cairn-e2e-') as name:
            folder = pathlib.Path(name)
            rooms = [render(folder, 'alike', seed, 1, '--catalogue', 7, '--duration', 9) for seed in (701, 702)]
            file = folder / 'alike.cairn'
            must('run', rooms[0], '--map', file, '--deterministic')
            report = must('run', rooms[1], '--map', file, '--extend', '--deterministic')
            self.assertEqual((report['result'], report['joined'], report['located_after_s']), ('apart', [], None))
            answer = cairn('localize', rooms[1], '--map', file, '--independent', '--stride', 10, '--verbose')
            self.assertEqual({image['component'] for image in answer.json['images'] if image['localized']}, {2})

    def test_a_session_from_another_room_joins_when_it_walks_in(self):
        with tempfile.TemporaryDirectory(prefix='cairn-e2e-') as name:
            folder = pathlib.Path(name)
            first = render(folder, 'rooms', 1, 1, '--rate', 15)
            second = render(folder, 'rooms', 1, 2, '--rate', 15, '--overlap-with', 1)
            shared = [float(line.split()[1]) for line in (second / 'overlap.txt').read_text().splitlines() if not line.startswith('#')]
            self.assertEqual(shared[0], 0.0)
            begins_s = next(k for k in range(len(shared)) if min(shared[k:k + 8]) >= 0.3) / 15
            file, frames = folder / 'rooms.cairn', folder / 'frames.txt'
            must('run', first, '--map', file, '--deterministic')
            must('align', file, '--component', 1, '--groundtruth', first / 'groundtruth_cam0.txt')
            report = must('run', second, '--map', file, '--extend', '--trajectory', frames, '--deterministic')
            self.assertGreater(report['located_after_s'], begins_s - 4)
            self.assertEqual(report['component'], 1)
            self.assertEqual([(join['component'], join['into']) for join in report['joined']], [(2, 1)])
            self.assertLess(report['joined'][0]['at_s'], begins_s + 2.5)
            components = {component['id']: component for component in must('info', file)['components']}
            self.assertEqual(components[2]['joined_into'], 1)
            self.assertEqual(components[2]['keyframes'], 0)
            ate = must('eval', 'ate', frames, second / 'groundtruth_cam0.txt')
            self.assertEqual(ate['associated'], report['frames_tracked'])
            self.assertLess(ate['ate_m'], 0.003 * 16)  # of the way
            # All of it is in the first room's frame: images of either session are located where they were.
            for visit in (first, second):
                poses = folder / 'poses.txt'
                must('localize', visit, '--stride', 20, '--map', file, '--independent', '--out', poses, '--overwrite')
                result = must('eval', 'localization', poses, visit / 'groundtruth_cam0.txt')
                self.assertEqual(result['wrong'], 0)
                self.assertGreaterEqual(result['answered'], 6)  # of 9 and 18: some look along bare walls


if __name__ == '__main__':
    unittest.main(verbosity=2)
