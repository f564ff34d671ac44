"""Photos of a real place whose camera is not the one that was given: no answer is far off without a word."""
import math
import os
import pathlib
import shutil
import sys
import tempfile
import unittest

from cairn_cli import cairn, must

DATA = pathlib.Path(os.environ.get('CAIRN_DATA_DIR', ''))
KITCHEN = DATA / 'redkitchen'


class WrongCalibrations(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-data-'))
        cls.map_file = cls.folder / 'kitchen.cairn'
        must('run', KITCHEN, '--until', 20, '--map', cls.map_file, '--deterministic')
        must('align', cls.map_file, '--groundtruth', KITCHEN / 'reference_sfm.txt', '--max-dt', 0.005)
        rows = [line.split() for line in open(KITCHEN / 'reference_sfm.txt') if not line.startswith('#')]
        cls.true = [(float(row[0]), [float(value) for value in row[1:4]]) for row in rows]

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def located(self, begin, end, focal=1.0, up=0.0):
        """Of the images between two times: (time, error over sigma, whether the calibration is said not to fit). Those that are
        refused because it does not fit, which ones of maps that differ a little do, are told as well."""
        camera = self.folder / 'camera.yaml'
        camera.write_text('model: pinhole\nresolution_px: [640, 480]\ndistortion: []\n'
                          f'intrinsics_px: [{525 * focal}, {525 * focal}, 320, {240 + 640 * up}]\n')
        answer = cairn('localize', KITCHEN, '--map', self.map_file, '--independent', '--verbose', '--camera', camera,
                       '--from', begin, '--until', end)
        self.assertIn(answer.code, (0, 4), answer.out)
        rows = []
        for image in answer.json['images']:
            time, position = min(self.true, key=lambda row: abs(row[0] - image['time_s']))
            if image['localized'] and abs(time - image['time_s']) < 0.006:
                rows.append((time, math.dist(position, image['position']) / image['position_sigma'],
                             'focal_factor' in image))
            elif image.get('reason', '').startswith('the calibration does not fit'):
                rows.append((time, 0.0, True))
        return rows

    def test_none_is_far_off_without_a_word(self):
        # Where more than half of the matches, of a small part of the view, agree with a pose that is wrong.
        for begin, end, focal, up in ((31.6, 32.6, 0.7, 0), (20.9, 21.2, 0.85, 0), (22.3, 22.7, 1.1, 0), (22.3, 22.7, 1.25, 0),
                                      (23.8, 24.2, 1.52, 0), (23.1, 23.8, 1, 0.1), (23.1, 23.5, 1, 0.15)):
            rows = self.located(begin, end, focal, up)
            self.assertGreaterEqual(len(rows), 3)
            silent = [row for row in rows if row[1] > 5 and not row[2]]
            self.assertEqual(silent, [], f'focal length x {focal}, principal point {up} of the width too low')

    def test_the_right_one_is_not_doubted(self):
        rows = self.located(20, 24)
        self.assertGreater(len(rows), 40)
        self.assertFalse([row for row in rows if row[2]])
        self.assertLess(max(row[1] for row in rows), 5)


if __name__ == '__main__':
    if not DATA.is_dir() or not str(DATA) or str(DATA) == '.':
        print('skipped: CAIRN_DATA_DIR does not name a folder of real sequences')
        sys.exit(77)
    unittest.main(verbosity=2)
