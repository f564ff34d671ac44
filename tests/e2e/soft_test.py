"""A corridor of which one side has nothing but soft-edged stripes: for more than five seconds there is enough to track by,
and nothing for the feature module, which starts again from the odometry's depths when texture returns."""
import contextlib
import pathlib
import shutil
import sqlite3
import tempfile
import unittest

from cairn_cli import must


class Soft(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.reports, cls.ate = {}, {}
        for name, world in (('soft', ['soft']), ('rich', ['corridor', '--size', 14, 13])):
            recording, frames = cls.folder / name, cls.folder / f'{name}.txt'
            must('synth', *world, '--seed', 1, '--duration', 24, '--out', recording)
            cls.reports[name] = must('run', recording, '--deterministic', '--map', cls.folder / f'{name}.cairn',
                                     '--trajectory', frames)
            cls.ate[name] = must('eval', 'ate', frames, recording / 'groundtruth_cam0.txt')['ate_m']
        cls.states = cls.reports['soft']['keyframe_states']

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def test_the_odometry_carries_on(self):
        self.assertEqual(self.reports['soft']['tracked_share'], 1.0)
        self.assertEqual(self.reports['soft']['segments'], 1)

    def test_the_feature_module_says_that_it_is_lost_and_starts_again(self):
        lost = [k['t'] for k in self.states if k['state'] == 'lost']
        self.assertGreaterEqual(max(lost) - min(lost), 5.0)
        before = [k['state'] for k in self.states if k['t'] < min(lost)]
        after = [k for k in self.states if k['t'] > max(lost)]
        self.assertGreater(before.count('good'), 5)
        self.assertEqual(sum(k['restarted'] for k in after), 1)
        self.assertGreater([k['state'] for k in after].count('good'), 3)
        self.assertEqual(self.states[-1]['state'], 'good')
        self.assertEqual(self.reports['soft']['feature_losses'], 1)
        rich = [k['state'] for k in self.reports['rich']['keyframe_states']]
        self.assertEqual(rich.count('lost'), 0)

    def test_what_comes_after_is_linked_to_the_map_before(self):
        restart = next(k['t'] for k in self.states if k['restarted'])
        with contextlib.closing(sqlite3.connect(self.folder / 'soft.cairn')) as database:
            rows = {id: (time * 1e-9, parent) for id, time, parent in
                    database.execute('SELECT id, time_ns, parent FROM keyframes')}
        self.assertEqual(sum(parent is None for _, parent in rows.values()), 1)
        after = [id for id, (time, _) in rows.items() if time > restart - 1e-3]
        self.assertGreater(len(after), 3)
        for id in after:
            while rows[id][0] > restart - 1e-3:
                id = rows[id][1]  # ends in the map before the stretch: it holds the only root

    def test_it_costs_little_accuracy(self):
        self.assertLess(self.ate['rich'], 0.1)
        self.assertLess(self.ate['soft'], 0.1)  # of a path of 26 m


if __name__ == '__main__':
    unittest.main(verbosity=2)
