"""Files for other programs: every format is written, and COLMAP (skipped where it is not installed) takes a model and finds the errors that Cairn finds."""
import json
import os
import pathlib
import re
import shutil
import subprocess
import tempfile
import unittest

from cairn_cli import cairn, must

DATA = os.environ.get('CAIRN_DATA_DIR', '')


def colmap(*arguments):
    done = subprocess.run(['colmap', *map(str, arguments)], capture_output=True, text=True, timeout=300,
                          env={**os.environ, 'QT_QPA_PLATFORM': 'offscreen'})
    if done.returncode != 0:
        raise AssertionError(f'colmap {arguments}: {done.stdout}{done.stderr}')
    return done.stdout + done.stderr


class Export(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        cls.office, cls.map = cls.folder / 'office', cls.folder / 'office.cairn'
        must('synth', 'office', '--seed', 3, '--duration', 6, '--out', cls.office)
        must('run', cls.office, '--map', cls.map, '--deterministic')

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def path(self, name):
        return self.folder / name

    def check_with_colmap(self, report, model):
        """COLMAP reads the model, and computes from its poses and points what Cairn says."""
        if shutil.which('colmap') is None:
            self.skipTest('colmap is not installed (tools/install_packages --dev)')
        told = colmap('model_analyzer', '--path', model)
        number = lambda name: float(re.search(rf'{name}: ([0-9.]+)', told)[1])
        self.assertEqual(number('Registered images'), report['keyframes'])
        self.assertEqual(number('Points'), report['points'])
        self.assertEqual(number('Observations'), report['observations'])
        self.assertAlmostEqual(number('Mean reprojection error'), report['error_mean_of_points_px'], delta=0.05)
        refined = self.path(f'refined_{model.name}')
        refined.mkdir()
        told = colmap('bundle_adjuster', '--input_path', model, '--output_path', refined,
                      '--BundleAdjustment.max_num_iterations', 5, '--BundleAdjustment.refine_focal_length', 0,
                      '--BundleAdjustment.refine_extra_params', 0)
        # The root of half the mean square of residuals, of which there are two per observation.
        initial = float(re.search(r'Initial cost : ([0-9.]+)', told)[1])
        self.assertAlmostEqual(initial, report['error_rms_px'] / 2, delta=0.05)
        self.assertTrue((refined / 'points3D.bin').exists())

    def test_colmap_takes_the_model(self):
        model = self.path('binary')
        report = must('export', self.map, model, '--format', 'colmap', '--images', self.office)
        self.assertEqual(report['images_written'], report['keyframes'])
        self.assertEqual(len(list((model / 'images').glob('*.png'))), report['keyframes'])
        self.check_with_colmap(report, model)

    def test_colmap_takes_the_text_too(self):
        model = self.path('text')
        self.check_with_colmap(must('export', self.map, model, '--format', 'colmap-text'), model)

    def test_a_real_map_with_a_corrected_lens(self):
        if not DATA:
            self.skipTest('CAIRN_DATA_DIR is not set')
        kitchen, map_file, model = pathlib.Path(DATA) / 'redkitchen', self.path('kitchen.cairn'), self.path('kitchen')
        must('run', kitchen, '--until', 8, '--map', map_file, '--deterministic')
        report = must('export', map_file, model, '--format', 'colmap', '--images', kitchen)
        self.assertEqual(report['images_written'], report['keyframes'])
        self.check_with_colmap(report, model)

    def test_every_format_is_written(self):
        for name in ('keyframes.csv', 'keyframes.kitti', 'graph.g2o', 'model.json'):
            report = must('export', self.map, self.path(name))
            self.assertGreater(self.path(name).stat().st_size, 100, name)
            self.assertEqual(report['frame'], 'map')
        for name in ('office.ply', 'keyframes.txt'):
            self.assertEqual(must('export', self.map, self.path(name))['bytes'], self.path(name).stat().st_size)
            report = must('export', self.map, self.path(f'model_{name}'), '--component', 1)
            self.assertGreater(self.path(f'model_{name}').stat().st_size, 100)
        keyframes = must('info', self.map)['keyframes']
        for name, said in (('points.ply', f"{must('info', self.map)['points']} points, in"), ('keyframes.txt', f'poses of {keyframes} keyframes, in')):
            told = cairn('export', self.map, self.path(f'told_{name}'), json_output=False)
            self.assertIn(said, told.out)
            self.assertRegex(told.out, 'the world, metres|map units')
        self.assertEqual(sum(not line.startswith('#') for line in open(self.path('keyframes.txt'))), keyframes)
        self.assertEqual(len(open(self.path('keyframes.kitti')).readlines()), keyframes)
        self.assertEqual(len(json.load(open(self.path('model.json')))['keyframes']), keyframes)
        must('export', self.map, self.path('nerf'), '--format', 'nerfstudio', '--images', self.office)
        transforms = json.load(open(self.path('nerf/transforms.json')))
        self.assertTrue(all((self.path('nerf') / frame['file_path']).exists() for frame in transforms['frames']))

    def test_errors_mean_the_same_as_elsewhere(self):
        must('export', self.map, self.path('errors.json'))
        points = {point['id']: point for point in json.load(open(self.path('errors.json')))['points']}
        listed = must('ls', self.map, 'points')['points']
        self.assertEqual(len(points), len(listed))
        for point in listed:
            self.assertAlmostEqual(point['error_px'], points[point['id']]['error_px'], delta=1e-6)
        mean = sum(point['error_mean_px'] for point in points.values()) / len(points)
        told = cairn('export', self.map, self.path('told'), '--format', 'colmap', json_output=False).out
        self.assertIn(f'mean {mean:.3f} px over the points, as COLMAP has it', ' '.join(told.split()))

    def test_components_that_have_frames_of_their_own_are_not_left_out_silently(self):
        other, both = self.path('elsewhere'), self.path('both.cairn')
        must('synth', 'office', '--seed', 5, '--duration', 4, '--out', other)
        must('run', other, '--map', self.path('elsewhere.cairn'), '--deterministic')
        must('merge', self.map, self.path('elsewhere.cairn'), '--apart', '-o', both)
        counts = {component['id']: component['keyframes'] for component in must('info', both)['components']}
        self.assertEqual(len(counts), 2)
        left_out = min(counts.values())
        report = must('export', both, self.path('both.json'))
        self.assertEqual((report['components_left_out'], report['keyframes_left_out']), (1, left_out))
        self.assertEqual(report['keyframes'], max(counts.values()))
        told = cairn('export', both, self.path('both.g2o'), json_output=False).out
        self.assertIn(f'without {left_out} keyframes of 1 component in another frame', ' '.join(told.split()))
        for name in ('both.ply', 'both.txt'):
            self.assertEqual(must('export', both, self.path(name))['left_out'],
                             f'without {left_out} keyframes of 1 component in another frame')
            told = cairn('export', both, self.path(f'told_{name}'), json_output=False).out
            self.assertIn(f'without {left_out} keyframes', told)
        self.assertNotIn('left_out', must('export', self.map, self.path('whole.ply')))

    def test_what_cannot_be_exported_is_told(self):
        self.assertEqual(cairn('export', self.map, self.path('x.docx')).code, 2)
        self.assertEqual(cairn('export', self.map, self.path('x.ply'), '--component', 7).code, 1)
        must('export', self.map, self.path('twice.ply'))
        self.assertEqual(cairn('export', self.map, self.path('twice.ply')).code, 1)
        must('export', self.map, self.path('twice.ply'), '--overwrite')
        self.assertEqual(cairn('export', self.map, self.map, '--format', 'ply', '--overwrite').code, 1)
        other = self.folder / 'other'
        must('synth', 'office', '--seed', 4, '--duration', 1, '--out', other)
        answer = cairn('export', self.map, self.path('m'), '--format', 'colmap', '--images', other)
        self.assertEqual(answer.code, 1)
        self.assertIn('no keyframe that is exported comes from', answer.json['error'])


if __name__ == '__main__':
    unittest.main(verbosity=2)
