"""A round through a corridor that ends where it began: the loop is found, closed, stored and reported."""
import math
import pathlib
import shutil
import statistics
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
        for name, extra in (('closed', ['--live-poses', cls.folder / 'live.txt']), ('open', ['--vo'])):
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

    def test_live_poses_follow_the_correction(self):
        """While the map drifts, so does what is known of the camera; after the loop it is right at once."""
        def positions(name):
            lines = (line.split() for line in open(self.folder / name) if not line.startswith('#'))
            return {round(float(t), 3): (float(x), float(y), float(z)) for t, x, y, z, *_ in lines}
        live, final = positions('live.txt'), positions('closed.txt')
        report, start = self.reports['closed'], min(final)
        self.assertEqual(len(live), report['live_poses'])
        self.assertGreater(len(live), 0.85 * report['frames'])
        loop_s, end_s = report['loops'][0]['at_s'], max(final) - start

        def moved_since(begin_s, to_s):
            return statistics.mean(math.dist(live[t], final[t]) for t in live if begin_s <= t - start < to_s)
        self.assertLess(moved_since(end_s - 3, end_s + 1), 0.5 * moved_since(loop_s - 4, loop_s - 1))

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
