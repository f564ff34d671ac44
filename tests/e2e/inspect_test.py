"""Looking inside a map: info, ls."""
import os
import pathlib
import shutil
import tempfile
import unittest

from cairn_cli import cairn, must


class Inspection(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.office, cls.map = cls.folder / 'office', cls.folder / 'office.cairn'
        must('synth', 'office', '--seed', 3, '--duration', 6, '--out', cls.office)
        cls.report = must('run', cls.office, '--map', cls.map, '--deterministic')

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def text(self, *arguments, code=0):
        """What a person gets: no line is wider than a terminal, no escape code is sent, twice the same."""
        answer = cairn(*arguments, json_output=False)
        self.assertEqual(answer.code, code, answer.out + answer.err)
        for line in answer.out.splitlines():
            self.assertLessEqual(len(line), max(80, len(str(self.map)) + 40), line)
        self.assertNotIn('\x1b', answer.out)
        self.assertEqual(cairn(*arguments, json_output=False).out, answer.out)
        return answer.out

    # info

    def test_info_fits_a_screen_and_its_parts_come_to_the_file(self):
        text = self.text('info', self.map)
        self.assertLessEqual(len(text.splitlines()), 24)
        info = must('info', self.map)
        self.assertEqual(info['bytes'], os.path.getsize(self.map))
        self.assertEqual(sum(part['bytes'] for part in info['sizes']), info['bytes'])
        self.assertAlmostEqual(sum(part['percent'] for part in info['sizes']), 100, delta=1)
        self.assertEqual(info['keyframes_looked_at'], info['keyframes'])
        self.assertTrue(0 < info['reprojection_median_px'] <= info['reprojection_rms_px'] < 2)

    def test_info_does_not_load_the_map(self):
        # A point that does not check out keeps the map from being loaded; info does not look there.
        damaged = self.folder / 'damaged.cairn'
        shutil.copy(self.map, damaged)
        import sqlite3
        with sqlite3.connect(damaged) as database:
            database.execute('UPDATE points SET times_visible = times_visible + 1 WHERE id = (SELECT max(id) FROM points)')
        database.close()
        self.assertEqual(cairn('info', damaged).code, 0)
        self.assertEqual(cairn('info', damaged, '--digest').code, 3)

    # ls

    def test_ls_tells_the_keyframes_of_a_map(self):
        listed = must('ls', self.map, 'keyframes')
        self.assertEqual(listed['total'], must('info', self.map)['keyframes'])
        self.assertEqual(len(listed['keyframes']), listed['total'])
        worst = must('ls', self.map, 'keyframes', '--sort', 'error_px', '--reverse', '--limit', 3)
        self.assertEqual(worst['total'], listed['total'])
        errors = sorted((keyframe['error_px'] for keyframe in listed['keyframes']), reverse=True)
        self.assertEqual([keyframe['error_px'] for keyframe in worst['keyframes']], errors[:3])
        self.assertIn('3 of', self.text('ls', self.map, 'keyframes', '--limit', 3))

    def test_ls_filters(self):
        points = must('ls', self.map, 'points')['points']
        few = must('ls', self.map, 'points', '--filter', 'observations<4', '--filter', 'error_px>0.5')['points']
        self.assertEqual([point['id'] for point in few],
                         [point['id'] for point in points if point['observations'] < 4 and point['error_px'] > 0.5])
        self.assertTrue(few)

    def test_every_kind_is_listed_and_fits_the_terminal(self):
        for kind in ('keyframes', 'points', 'sessions', 'components', 'cameras'):
            self.text('ls', self.map, kind, '--limit', 5)
            self.assertGreater(must('ls', self.map, kind)['total'], 0)
        self.assertIn('office', self.text('ls', self.folder))

    def test_what_ls_cannot_do_is_a_usage_error(self):
        for arguments in (['ls', self.map, 'keyframes', '--sort', 'beauty'], ['ls', self.map, 'keyframes', '--filter', 'points'],
                          ['ls', self.map, 'windows'], ['ls', self.folder, '--sort', 'error_px'], ['ls']):
            answer = cairn(*arguments)
            self.assertEqual(answer.code, 2, arguments)
            self.assertTrue(answer.json['error'])
        self.assertEqual(cairn('ls', self.folder / 'none.cairn', 'points').code, 1)


if __name__ == '__main__':
    unittest.main(verbosity=2)
