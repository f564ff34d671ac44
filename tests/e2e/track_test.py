"""A second visit to a rendered room is followed in the map of the first, which is not touched."""
import pathlib
import shutil
import tempfile
import unittest

from cairn_cli import cairn, must


def poses(path):
    return {round(float(row[0]), 3): tuple(map(float, row[1:4])) for row in
            (line.split() for line in open(path) if not line.startswith('#'))}


class Track(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.first, cls.second, cls.map = cls.folder / 'first', cls.folder / 'second', cls.folder / 'office.cairn'
        size = ['--image-size', 480, 360, '--focal', 315]
        must('synth', 'office', '--seed', 4, '--duration', 9, *size, '--out', cls.first)
        must('synth', 'office', '--seed', 4, '--session', 2, '--duration', 5, *size, '--out', cls.second)
        must('run', cls.first, '--deterministic', '--map', cls.map)
        must('align', cls.map, '--groundtruth', cls.first / 'groundtruth_cam0.txt')
        cls.digest = must('info', cls.map, '--digest')['digest']

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def track(self, name, *arguments):
        """The answer, the poses and the lines of states."""
        out, states = self.folder / f'{name}.txt', self.folder / f'{name}_states.txt'
        answer = must('track', self.second, '--map', self.map, '--out', out, '--states', states, '--overwrite', *arguments)
        self.assertEqual(must('info', self.map, '--digest')['digest'], self.digest, 'the map is not touched')
        return answer, poses(out), [line.split(' ', 8) for line in open(states) if not line.startswith('#')]

    def test_every_frame_of_both_modes(self):
        for mode in ('semi_direct', 'features'):
            answer, found, states = self.track(mode, '--mode', mode)
            self.assertEqual(answer['with_pose_share'], 1.0)
            self.assertEqual(answer['located'], 1)
            self.assertEqual(answer['frame'], 'world')
            self.assertEqual(len(found), answer['frames'])
            self.assertEqual(len(states), answer['frames'])
            truth = poses(self.second / 'groundtruth_cam0.txt')
            for state in states:
                time = round(float(state[0]), 3)
                apart = sum((a - b) ** 2 for a, b in zip(found[time], truth[time])) ** 0.5
                self.assertLess(apart, 0.05, f'{mode} at {time}: {state}')
                self.assertLess(apart, 8 * float(state[2]) + 1e-3, f'{mode} at {time}: surer than right')

    def test_the_same_input_gives_the_same_output(self):
        for name in ('once', 'again'):
            self.track(name, '--deterministic')
        self.assertEqual((self.folder / 'once.txt').read_text(), (self.folder / 'again.txt').read_text())

    def test_as_a_live_camera(self):
        answer, _, _ = self.track('live', '--realtime', 2)
        self.assertGreater(answer['with_pose_share'], 0.9)
        self.assertGreater(answer['frames'], 20)

    def test_on_a_read_only_file_and_where_nothing_is_known(self):
        self.map.chmod(0o444)
        self.assertEqual(self.track('read_only')[0]['with_pose_share'], 1.0)
        must('synth', 'corridor', '--seed', 9, '--duration', 1, '--out', self.folder / 'elsewhere')
        elsewhere = cairn('track', self.folder / 'elsewhere', '--map', self.map)
        self.assertEqual(elsewhere.code, 4)
        self.assertEqual(elsewhere.json['lost_share'], 1.0)
        self.assertTrue(elsewhere.json['losses'])

    def test_refuses_what_it_should(self):
        self.assertEqual(cairn('track', self.second, '--map', self.folder / 'none.cairn').code, 1)
        self.assertEqual(cairn('track', self.second, '--map', self.map, '--mode', 'sideways').code, 2)
        self.assertEqual(cairn('track', self.second, '--map', self.map, '--realtime', '--deterministic').code, 2)
        self.assertNotEqual(cairn('track', self.second, '--map', self.map, '--out', self.map, '--overwrite').code, 0)


if __name__ == '__main__':
    unittest.main(verbosity=2)
