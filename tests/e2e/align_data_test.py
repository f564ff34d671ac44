"""Alignment of maps of real sequences: a body's ground truth, another place's, and a straight drive."""
import os
import pathlib
import shutil
import sys
import tempfile
import unittest

from cairn_cli import cairn, must

DATA = pathlib.Path(os.environ.get('CAIRN_DATA_DIR', ''))


class AlignRealSequences(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-data-'))

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def test_the_bodys_csv_is_as_good_as_the_cameras_poses(self):
        sequence, frames, map_file = DATA / 'euroc_v101_moving', self.folder / 'moving.txt', self.folder / 'moving.cairn'
        body, camera = sequence / 'mav0' / 'state_groundtruth_estimate0' / 'data.csv', sequence / 'groundtruth_cam0.txt'
        must('run', sequence, '--map', map_file, '--trajectory', frames, '--deterministic')
        of_body, of_camera = (must('eval', 'ate', frames, truth) for truth in (body, camera))
        self.assertAlmostEqual(of_body['ate_m'], of_camera['ate_m'], delta=0.0005)
        self.assertLess(of_body['rotation_deg']['median'], 1)
        unknown = must('eval', 'ate', frames, body, '--sensor', 'none')
        self.assertEqual(unknown['reference']['orientations'], 'body')
        self.assertLess(unknown['rotation_deg']['median'], 1)
        scales = {}
        for name, options in (('camera', (camera,)), ('body', (body,)), ('unknown', (body, '--sensor', 'none'))):
            copy = self.folder / f'{name}.cairn'
            shutil.copy(map_file, copy)
            scales[name] = must('align', copy, '--groundtruth', *options)['scale']
        self.assertAlmostEqual(scales['body'], scales['camera'], delta=0.002 * scales['camera'])
        self.assertAlmostEqual(scales['unknown'], scales['camera'], delta=0.02 * scales['camera'])

    def test_a_car_is_not_a_kitchen(self):
        sequence, map_file = DATA / 'redkitchen', self.folder / 'kitchen.cairn'
        must('run', sequence, '--until', 20, '--map', map_file, '--deterministic')
        good = must('align', map_file, '--groundtruth', sequence / 'reference_sfm.txt')
        self.assertEqual(good['orientations'], 'camera')
        self.assertLess(good['rotation_sigma_deg'], 0.5)
        before = must('info', map_file, '--digest')['digest']
        answer = cairn('align', map_file, '--groundtruth', DATA / 'kitti00' / 'poses.txt', '--overwrite')
        self.assertEqual(answer.code, 1, answer.out)
        self.assertIn('as it was', answer.json['error'])
        self.assertEqual(must('info', map_file, '--digest')['digest'], before)

    def test_a_straight_drive_is_not_rolled(self):
        # Straight up to frame 99: positions alone leave the roll open by tens of degrees.
        sequence, frames, map_file = DATA / 'kitti00', self.folder / 'straight.txt', self.folder / 'straight.cairn'
        must('run', sequence, '--until', 8, '--map', map_file, '--trajectory', frames, '--deterministic')
        copy = self.folder / 'positions.cairn'
        shutil.copy(map_file, copy)
        aligned = must('align', map_file, '--groundtruth', sequence / 'poses.txt')
        self.assertEqual(aligned['orientations'], 'camera')
        self.assertLess(aligned['rotation_sigma_deg'], 1)
        self.assertEqual(cairn('align', copy, '--groundtruth', sequence / 'poses.txt', '--positions-only').code, 1)
        self.assertLess(must('eval', 'ate', frames, sequence / 'poses.txt')['rotation_deg']['max'], 3)


if __name__ == '__main__':
    if not DATA.is_dir() or not str(DATA) or str(DATA) == '.':
        print('skipped: CAIRN_DATA_DIR does not name a folder of real sequences')
        sys.exit(77)
    unittest.main(verbosity=2)
