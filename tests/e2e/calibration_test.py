"""A camera that is not calibrated as it says is told: no answer is silently wrong."""
import pathlib
import shutil
import tempfile
import unittest

from cairn_cli import cairn, must


def positions(path):
    return {round(float(row[0]), 3): tuple(map(float, row[1:4])) for row in
            (line.split() for line in open(path) if not line.startswith('#'))}


class Calibration(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix='cairn-e2e-'))
        first, cls.visit, cls.map = cls.folder / 'first', cls.folder / 'visit', cls.folder / 'office.cairn'
        size = ['--image-size', 480, 360, '--focal', 315]
        must('synth', 'office', '--seed', 4, '--duration', 9, *size, '--out', first)
        must('synth', 'office', '--seed', 4, '--session', 2, '--duration', 5, *size, '--out', cls.visit)
        must('run', first, '--deterministic', '--map', cls.map)
        must('align', cls.map, '--groundtruth', first / 'groundtruth_cam0.txt')
        cls.truth = positions(cls.visit / 'groundtruth_cam0.txt')

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def camera(self, factor=1.0, shift=0.0):
        path = self.folder / f'camera_{factor}_{shift}.yaml'
        path.write_text(f'model: pinhole\nresolution_px: [480, 360]\n'
                        f'intrinsics_px: [{315 * factor}, {315 * factor}, {239.5 + 480 * shift}, 179.5]\n')
        return path

    def localize(self, *camera):
        return cairn('localize', self.visit, '--map', self.map, '--camera', self.camera(*camera), '--stride', 12,
                     '--verbose', '--independent').json

    def test_every_answer_is_right_or_told(self):
        for camera in ((0.5,), (0.65,), (0.8,), (0.9,), (0.95,), (1.05,), (1.1,), (1.25,), (1.5,), (1.6,), (1.0, 0.1), (1.0, -0.15)):
            answer = self.localize(*camera)
            for image in answer['images']:
                told = 'focal_factor' in image
                if not image['localized']:
                    self.assertEqual('calibration' in image['reason'], told, image)
                    continue
                apart = sum((a - b) ** 2 for a, b in
                            zip(image['position'], self.truth[round(image['time_s'], 3)])) ** 0.5
                self.assertTrue(told or apart < 5 * image['position_sigma'], f'{camera}: {apart} m off at {image}')
            if camera[0] <= 0.8 or camera[0] >= 1.25:
                self.assertTrue(answer['calibration_contradicted'], camera)

    def test_a_right_one_is_not_doubted(self):
        answer = self.localize()
        self.assertEqual(answer['localized'], answer['frames'])
        self.assertFalse(answer['calibration_contradicted'])
        self.assertFalse([image for image in answer['images'] if 'focal_factor' in image])
        for mode in ('semi_direct', 'features'):
            tracked = must('track', self.visit, '--map', self.map, '--camera', self.camera(), '--mode', mode)
            self.assertFalse(tracked['calibration_contradicted'])

    def test_a_tracker_tells_it(self):
        for mode in ('semi_direct', 'features'):
            for factor in (0.8, 1.25):
                arguments = ['track', self.visit, '--map', self.map, '--camera', self.camera(factor), '--mode', mode]
                tracked = must(*arguments)
                self.assertTrue(tracked['calibration_contradicted'], (mode, factor))
                self.assertAlmostEqual(tracked['focal_factor'] * factor, 1.0, delta=0.15)
        self.assertIn('WARNING: the calibration does not fit', cairn(*arguments, json_output=False).out)


if __name__ == '__main__':
    unittest.main()
