"""A round through a corridor that ends where it began: the loop is found, closed, stored and reported."""
import pathlib
import shutil
import tempfile
import unittest

from cairn_cli import cairn, must


class Loop(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.corridor = cls.folder / 'corridor'
        must('synth', 'corridor', '--seed', 2, '--size', 12, 9, '--laps', 1.3, '--out', cls.corridor)
        cls.reports, cls.ate = {}, {}
        for name, extra in (('closed', []), ('open', ['--vo'])):
            frames = cls.folder / f'{name}.txt'
            cls.reports[name] = must('run', cls.corridor, '--deterministic', *extra, '--map', cls.map(name), '--trajectory',
                                     frames)
            cls.ate[name] = must('eval', 'ate', frames, cls.corridor / 'groundtruth_cam0.txt')['ate_m']

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    @classmethod
    def map(cls, name):
        return cls.folder / f'{name}.cairn'

    def test_the_loop_is_closed_and_the_map_is_better_for_it(self):
        self.assertGreaterEqual(len(self.reports['closed']['loops']), 1)
        self.assertGreaterEqual(self.reports['closed']['tracked_share'], 0.95)
        self.assertLess(self.ate['closed'], 0.5 * self.ate['open'])
        self.assertLess(self.ate['closed'], 0.02)

    def test_the_file_tells_of_it(self):
        sessions = must('info', self.map('closed'))['sessions']
        self.assertEqual(len(sessions[0]['loops']), len(self.reports['closed']['loops']))
        text = cairn('info', self.map('closed'), json_output=False).out
        self.assertIn('loop', text)

    def test_vo_closes_none(self):
        self.assertEqual(self.reports['open']['loops'], [])
        self.assertEqual(must('info', self.map('open'))['sessions'][0]['loops'], [])


if __name__ == '__main__':
    unittest.main(verbosity=2)
